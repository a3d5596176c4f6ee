//! Pictures in the report page.

use base64::{Engine as _, engine::general_purpose::STANDARD};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

use super::html::put;
use crate::ViewError;

/// JPEG quality of the pictures in the page, 0 to 100.
const QUALITY: u8 = 82;
/// Largest width of a picture in the page, px.
const MAX_WIDTH: u32 = 1280;

/// Appends a picture with a caption to the page. `name` is the alternative text of the picture.
pub(super) fn figure(
    page: &mut String,
    picture: &RgbImage,
    name: &str,
    caption: &str,
) -> Result<(), ViewError> {
    let data = data_uri(picture)?;
    put(
        page,
        format_args!(
            "<figure><img alt=\"{name}\" src=\"{data}\"><figcaption>{caption}</figcaption></figure>\n"
        ),
    );
    Ok(())
}

/// Returns a picture as a data URI with a JPEG file. A picture wider than [`MAX_WIDTH`] is reduced to that width.
pub(crate) fn data_uri(picture: &RgbImage) -> Result<String, ViewError> {
    data_uri_up_to(picture, MAX_WIDTH, QUALITY)
}

/// Returns a picture as a data URI with a JPEG file of this quality, 0 to 100. A picture wider than `max_width_px` is
/// reduced to that width.
pub(super) fn data_uri_up_to(
    picture: &RgbImage,
    max_width_px: u32,
    quality: u8,
) -> Result<String, ViewError> {
    let mut jpeg = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut jpeg, quality);
    if picture.width() > max_width_px {
        let height = u64::from(picture.height()) * u64::from(max_width_px) / u64::from(picture.width());
        let filter = image::imageops::FilterType::Triangle;
        image::imageops::resize(picture, max_width_px, height.max(1) as u32, filter)
            .write_with_encoder(encoder)?;
    } else {
        picture.write_with_encoder(encoder)?;
    }
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(&jpeg)))
}
