//! `report.html`: one file to look at, without scripts or outside parts.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use roadplane_base::{CameraEstimate, CameraStatus, ImageSize, TrackRow};

use crate::ViewError;
use crate::activities::stretches;
use crate::birds_eye::birds_eye;
use crate::crops::best_views;
use crate::histogram::histogram;
use crate::overlay::track_colour;

/// JPEG quality of the pictures in the page.
const QUALITY: u8 = 82;
/// Widest picture in the page, px.
const MAX_WIDTH: u32 = 1280;
/// Speeds below this are a standing car's, m/s.
const STANDING_MPS: f64 = 0.3;

/// What a report shows.
#[derive(Debug)]
pub struct ReportInput<'a> {
    /// Name of the input.
    pub title: &'a str,
    /// The camera, per stretch of time.
    pub cameras: &'a [CameraEstimate],
    /// All rows, by frame, then by track.
    pub rows: &'a [TrackRow],
    /// Frames with overlays already drawn, by index.
    pub samples: &'a [(u64, RgbImage)],
    /// Reprojection errors of the tracked poses, px.
    pub reprojection_rms_px: &'a [f64],
    /// Lines of name and value: counts, times, versions.
    pub facts: &'a [(String, String)],
    /// What a reader should know.
    pub warnings: &'a [String],
    /// The place without what moves.
    pub background: Option<&'a RgbImage>,
    /// The place with the lines that tell its vertical, where there are any.
    pub scene_lines: Option<&'a RgbImage>,
    /// What the pictures say of the camera, a line each: moves, shake, nothing to see.
    pub camera_notes: &'a [String],
}

/// The page.
///
/// # Errors
/// [`ViewError::Compressing`].
pub fn report_html(input: &ReportInput<'_>) -> Result<String, ViewError> {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{0} · roadplane</title>\n<style>{STYLE}</style>\n<main>\n<h1>{0}</h1>\n",
        escape(input.title)
    );
    for warning in input.warnings {
        put(&mut page, format_args!("<p class=\"warning\">{}</p>\n", escape(warning)));
    }
    cameras(&mut page, input.cameras);
    page.push_str("<ul>\n");
    for note in input.camera_notes {
        put(&mut page, format_args!("<li>{}</li>\n", escape(note)));
    }
    page.push_str("</ul>\n");
    if let Some(estimate) = input.cameras.first() {
        let camera = estimate.camera();
        let size: ImageSize = estimate.image_size_px;
        page.push_str("<h2>From above</h2>\n");
        page.push_str(&birds_eye(input.rows, &camera, size));
        page.push_str("<p class=\"hint\">Cars at their last place, to scale; white ellipses are 2 standard deviations.</p>\n");
    }
    tracks(&mut page, input.rows);
    activities(&mut page, input.rows);
    cars(&mut page, input)?;
    page.push_str("<h2>In the picture</h2>\n");
    for (index, picture) in input.samples {
        let data = data_uri(picture)?;
        put(
            &mut page,
            format_args!(
                "<figure><img alt=\"frame {index}\" src=\"{data}\"><figcaption>frame {index}</figcaption></figure>\n"
            ),
        );
    }
    if let Some(background) = input.background {
        let data = data_uri(background)?;
        put(
            &mut page,
            format_args!(
                "<figure><img alt=\"background\" src=\"{data}\"><figcaption>the place without what moved</figcaption></figure>\n"
            ),
        );
    }
    if let Some(picture) = input.scene_lines {
        let data = data_uri(picture)?;
        put(
            &mut page,
            format_args!(
                "<figure><img alt=\"scene lines\" src=\"{data}\"><figcaption>edges of the scene: the green ones are vertical and \
                 speak of the focal length</figcaption></figure>\n"
            ),
        );
    }
    quality(&mut page, input.reprojection_rms_px);
    page.push_str("<h2>Run</h2>\n<table>\n");
    for (name, value) in input.facts {
        put(&mut page, format_args!("<tr><th>{}</th><td>{}</td></tr>\n", escape(name), escape(value)));
    }
    page.push_str("</table>\n</main></html>\n");
    Ok(page)
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:0;background:#f5f6f7;color:#1c2126}\
main{max-width:1000px;margin:0 auto;padding:24px}h1{font-size:24px}h2{font-size:18px;margin-top:32px}\
table{border-collapse:collapse;background:#fff}td,th{padding:4px 10px;border-bottom:1px solid #e3e6e9;text-align:right;\
font-variant-numeric:tabular-nums}th{text-align:left;font-weight:600}thead th{text-align:right}svg.birdseye,img{max-width:100%;\
height:auto;border-radius:6px}figure{margin:12px 0}figcaption,.hint{color:#66707a;font-size:13px}.warning{background:#fff3cd;\
border-left:4px solid #e0a800;padding:8px 12px}.dot{display:inline-block;width:10px;height:10px;border-radius:5px;\
margin-right:6px}.scroll{overflow-x:auto}.scroll td{white-space:nowrap}.cars{display:grid;grid-template-columns:repeat(auto-fill,minmax(220px,1fr));gap:12px}\
.cars figure{margin:0}.cars img{width:100%}";

/// Writing to a string cannot fail.
fn put(page: &mut String, text: std::fmt::Arguments<'_>) {
    let _infallible = page.write_fmt(text);
}

/// Text as HTML shows it.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn cameras(page: &mut String, cameras: &[CameraEstimate]) {
    page.push_str("<h2>Camera</h2>\n<div class=\"scroll\"><table><thead><tr><th>from – to, s</th><th>focal length, px</th><th>height, m</th><th>tilt, °</th><th>roll, °</th><th>cars</th><th>frames</th><th>status</th></tr></thead>\n");
    for camera in cameras {
        let sd = |i: usize| camera.covariance[(i, i)].max(0.0).sqrt();
        let params = &camera.params;
        let (focal, height) = (params.focal_px(), params.log_height.exp());
        put(
            page,
            format_args!(
                "<tr><td>{:.1} – {:.1}</td><td>{focal:.0} ± {:.0}</td><td>{height:.2} ± {:.2}</td><td>{:.2} ± {:.2}</td>\
                 <td>{:.2} ± {:.2}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                camera.span_s[0],
                camera.span_s[1],
                focal * sd(0),
                height * sd(3),
                params.tilt.to_degrees(),
                sd(1).to_degrees(),
                params.roll.to_degrees(),
                sd(2).to_degrees(),
                camera.cars_used,
                camera.frames_used,
                status_in_words(camera.status),
            ),
        );
    }
    page.push_str("</table></div>\n");
}

/// Each track's best view, enlarged: whether the wireframe sits on the car is seen at a glance.
fn cars(page: &mut String, input: &ReportInput<'_>) -> Result<(), ViewError> {
    let crops = best_views(input.rows, input.samples);
    if crops.is_empty() {
        return Ok(());
    }
    page.push_str("<h2>Car by car</h2>\n<div class=\"cars\">\n");
    for crop in crops {
        let ([r, g, b], data) = (track_colour(crop.track), data_uri(&crop.picture)?);
        put(
            page,
            format_args!(
                "<figure><img alt=\"track {0}\" src=\"{data}\"><figcaption><span class=\"dot\" \
                 style=\"background:rgb({r},{g},{b})\"></span>track {0}, frame {1}</figcaption></figure>\n",
                crop.track, crop.frame
            ),
        );
    }
    page.push_str("</div>\n");
    Ok(())
}

/// How the camera's numbers came about, in words.
fn status_in_words(status: CameraStatus) -> &'static str {
    match status {
        CameraStatus::Estimated => "estimated from the cars",
        CameraStatus::FocalGiven => "focal length given",
        CameraStatus::FocalFromPrior => "focal length from the prior",
        CameraStatus::Unobservable => "not observable: priors only",
    }
}

fn tracks(page: &mut String, rows: &[TrackRow]) {
    let tracks = by_track(rows);
    put(page, format_args!("<h2>{} tracks</h2>\n<div class=\"scroll\"><table><thead><tr>", tracks.len()));
    for head in [
        "track",
        "from – to, s",
        "seen",
        "length × width × height, m",
        "path, m",
        "top speed, m/s",
        "heading, °",
        "sd x, y, m",
        "sd heading, °",
        "speed over time",
    ] {
        put(page, format_args!("<th>{head}</th>"));
    }
    page.push_str("</tr></thead>\n");
    for (track, rows) in &tracks {
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { continue };
        let seen = rows.iter().filter(|row| row.observed).count();
        // + 0.0: the sum of nothing is −0.
        let path =
            0.0 + rows.windows(2).map(|w| (w[1].x_m - w[0].x_m).hypot(w[1].y_m - w[0].y_m)).sum::<f64>();
        let top = rows.iter().map(|row| row.speed_mps.abs()).fold(0.0, f64::max);
        let [r, g, b] = track_colour(*track);
        put(
            page,
            format_args!(
                "<tr><th><span class=\"dot\" style=\"background:rgb({r},{g},{b})\"></span>{track}</th><td>{:.1} – {:.1}</td>\
                 <td>{:.0} %</td><td>{:.2} × {:.2} × {:.2}</td><td>{path:.1}</td><td>{top:.1}</td><td>{:.0}</td>\
                 <td>{:.2}, {:.2}</td><td>{:.1}</td><td>{}</td></tr>\n",
                first.time_s,
                last.time_s,
                100.0 * seen as f64 / rows.len() as f64,
                last.length_m,
                last.width_m,
                last.height_m,
                last.heading_rad.to_degrees(),
                last.x_sd_m,
                last.y_sd_m,
                last.heading_sd_rad.to_degrees(),
                if top < STANDING_MPS { "stands".to_owned() } else { sparkline(rows, top) },
            ),
        );
    }
    page.push_str("</table></div>\n");
}

/// What each track does, besides standing and driving on.
fn activities(page: &mut String, rows: &[TrackRow]) {
    let mut lines = String::new();
    for (track, rows) in by_track(rows) {
        let told: Vec<String> = stretches(&rows).map(|stretch| stretch.in_words()).collect();
        if !told.is_empty() {
            let [r, g, b] = track_colour(track);
            put(
                &mut lines,
                format_args!(
                    "<tr><th><span class=\"dot\" style=\"background:rgb({r},{g},{b})\"></span>{track}</th>\
                     <td style=\"text-align:left\">{}</td></tr>\n",
                    escape(&told.join(" · "))
                ),
            );
        }
    }
    if !lines.is_empty() {
        put(
            page,
            format_args!(
                "<h2>Activities</h2>\n<table>\n{lines}</table>\n<p class=\"hint\">From – to, and how probable; standing \
                 and driving on are left out here, not in the files.</p>\n"
            ),
        );
    }
}

fn by_track(rows: &[TrackRow]) -> BTreeMap<u64, Vec<&TrackRow>> {
    let mut tracks: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        tracks.entry(row.track).or_default().push(row);
    }
    tracks
}

/// Speed over time as a small curve.
fn sparkline(rows: &[&TrackRow], top_mps: f64) -> String {
    let span = rows.last().map_or(0.0, |row| row.time_s) - rows.first().map_or(0.0, |row| row.time_s);
    let points: Vec<String> = rows
        .iter()
        .map(|row| {
            let t = if span > 0.0 { (row.time_s - rows[0].time_s) / span } else { 0.0 };
            format!("{:.1},{:.1}", 1.0 + 98.0 * t, 23.0 - 22.0 * row.speed_mps.abs() / top_mps)
        })
        .collect();
    format!(
        "<svg width=\"100\" height=\"24\"><polyline points=\"{}\" fill=\"none\" stroke=\"#2a6fb0\" stroke-width=\"1.5\"/></svg>",
        points.join(" ")
    )
}

fn quality(page: &mut String, rms_px: &[f64]) {
    if rms_px.is_empty() {
        return;
    }
    let mut sorted = rms_px.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    put(
        page,
        format_args!(
            "<h2>Quality</h2>\n<p>Distance of keypoints from the fitted cars' (rms per car and frame, px): median {:.1}, \
             90 % below {:.1}, worst {:.1}; {} poses.</p>\n",
            at(0.5),
            at(0.9),
            at(1.0),
            sorted.len()
        ),
    );
    page.push_str(&histogram(&sorted, "px"));
}

fn data_uri(picture: &RgbImage) -> Result<String, ViewError> {
    let mut jpeg = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
    if picture.width() > MAX_WIDTH {
        let height = u64::from(picture.height()) * u64::from(MAX_WIDTH) / u64::from(picture.width());
        let filter = image::imageops::FilterType::Triangle;
        image::imageops::resize(picture, MAX_WIDTH, height.max(1) as u32, filter)
            .write_with_encoder(encoder)?;
    } else {
        picture.write_with_encoder(encoder)?;
    }
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(&jpeg)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_stands_alone_and_escapes_names() {
        let samples = [(3, RgbImage::new(1600, 900))];
        let input = ReportInput {
            title: "<b>lot</b>",
            cameras: &[],
            rows: &[],
            samples: &samples,
            reprojection_rms_px: &[1.0, 2.0],
            facts: &[("frames".to_owned(), "5".to_owned())],
            warnings: &["a < b".to_owned()],
            background: None,
            scene_lines: None,
            camera_notes: &["the camera was turned".to_owned()],
        };
        let page = report_html(&input).unwrap();
        assert!(page.contains("&lt;b&gt;lot&lt;/b&gt;") && page.contains("a &lt; b"));
        assert!(!page.contains("http") && !page.contains("<script"));
        assert!(page.contains("data:image/jpeg;base64,"));
        assert!(page.contains("histogram") && !page.contains("Car by car"));
    }
}
