//! Assembly of the report page from its sections.

use super::html::{escape, put};
use super::input::ReportInput;
use super::pictures::figure;
use super::{camera, doubts, drawing, place, player, tracks};
use crate::ViewError;
use crate::birds_eye::birds_eye;
use crate::histogram::histogram;

/// Style sheet of the pages.
pub(crate) const STYLE: &str = include_str!("page.css");

/// Returns the report as HTML text.
///
/// # Errors
/// [`ViewError::Compressing`] if a picture cannot be compressed. [`ViewError::Data`] if the player's data cannot be
/// written as JSON.
pub fn report_html(input: &ReportInput<'_>) -> Result<String, ViewError> {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{0} · roadplane</title>\n<style>\n{STYLE}{1}</style>\n<main>\n<h1>{0}</h1>\n",
        escape(input.title),
        drawing::STYLE
    );
    for warning in input.warnings {
        put(&mut page, format_args!("<p class=\"warning\">{}</p>\n", escape(warning)));
    }
    page.push_str(&player::player(input)?);
    page.push_str(&drawing::drawing(input)?);
    camera::cameras(&mut page, input.cameras);
    camera::moves(&mut page, input.moves);
    sentences(&mut page, input.camera_notes);
    if let Some(fit) = input.place {
        place::place(&mut page, fit);
    }
    if let Some(estimate) = input.cameras.first() {
        let camera = estimate.camera();
        page.push_str("<h2>From above</h2>\n");
        put(
            &mut page,
            format_args!(
                "<div class=\"scroll\">{}</div>\n<p class=\"hint\">Vehicles at their last position, to scale. White \
                 ellipses show 2 standard deviations.</p>\n",
                birds_eye(input.rows, &camera, estimate.image_size_px)
            ),
        );
        let mut lines = input.losses.to_vec();
        lines.extend(doubts::doubts(input.rows, estimate.image_size_px));
        if !lines.is_empty() {
            page.push_str("<h2>Lost, left out or partly visible</h2>\n");
            sentences(&mut page, &lines);
        }
    }
    tracks::tracks(&mut page, input.rows);
    tracks::activities(&mut page, input.rows);
    page.push_str(input.traffic);
    tracks::cars(&mut page, input)?;
    page.push_str("<h2>In the picture</h2>\n");
    for (index, picture) in input.samples {
        let name = format!("frame {index}");
        figure(&mut page, picture, &name, &name)?;
    }
    if let Some(background) = input.background {
        figure(&mut page, background, "background", "background: the scene without moving objects")?;
    }
    if let Some(picture) = input.scene_lines {
        let caption = "Edges of the scene. The green ones are vertical and constrain the focal length.";
        figure(&mut page, picture, "scene lines", caption)?;
    }
    quality(&mut page, input.reprojection_rms_px);
    page.push_str("<h2>Run</h2>\n<div class=\"scroll\"><table class=\"facts\">\n");
    for (name, value) in input.facts {
        put(&mut page, format_args!("<tr><th>{}</th><td>{}</td></tr>\n", escape(name), escape(value)));
    }
    page.push_str("</table></div>\n</main></html>\n");
    Ok(page)
}

/// Appends a list to the page, with one item per entry of `lines`.
fn sentences(page: &mut String, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    page.push_str("<ul>\n");
    for line in lines {
        put(page, format_args!("<li>{}</li>\n", escape(line)));
    }
    page.push_str("</ul>\n");
}

/// Appends the quantiles and the histogram of the reprojection errors to the page.
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
            "<h2>Quality</h2>\n<p>Distance between the measured keypoints and those of the fitted cars (rms per car and frame, px): \
             median {:.1}, 90 % below {:.1}, largest {:.1}. {} poses.</p>\n",
            at(0.5),
            at(0.9),
            at(1.0),
            sorted.len()
        ),
    );
    page.push_str(&histogram(&sorted, "px"));
}

#[cfg(test)]
mod tests {
    use super::super::{PlainFrame, Still, TrackStill};
    use super::*;
    use image::RgbImage;
    use nalgebra::Matrix4;
    use roadplane_base::{
        CameraEstimate, CameraMove, CameraParams, CameraStatus, ImageSize, MoveKind, TrackRow,
    };
    use roadplane_geo::Fit;
    use roadplane_synth::stationary_row as row;

    fn camera() -> CameraEstimate {
        let size = ImageSize { width: 640, height: 360 };
        CameraEstimate {
            span_s: [0.0, 2.0],
            image_size_px: size,
            principal_point_px: size.centre_px(),
            lens: roadplane_base::Lens::STRAIGHT,
            distortion_sd: None,
            params: CameraParams { log_focal: 700f64.ln(), tilt: 0.3, roll: 0.0, log_height: 8f64.ln() },
            covariance: Matrix4::identity() * 1e-3,
            status: CameraStatus::Estimated,
            cars_used: 1,
            frames_used: 20,
            second_plane: None,
        }
    }

    fn empty() -> ReportInput<'static> {
        ReportInput {
            title: "<b>lot</b>",
            cameras: &[],
            rows: &[],
            samples: &[],
            frames: &[],
            stills: &[],
            still_motion: &[],
            views: &[],
            reprojection_rms_px: &[1.0, 2.0],
            facts: &[],
            warnings: &[],
            background: None,
            scene_lines: None,
            moves: &[],
            camera_notes: &[],
            losses: &[],
            traffic: "",
            place: None,
        }
    }

    #[test]
    fn the_page_is_self_contained_and_escapes_names() {
        let samples = [(3, RgbImage::new(1600, 900))];
        let input = ReportInput {
            samples: &samples,
            facts: &[("frames".to_owned(), "5".to_owned())],
            warnings: &["a < b".to_owned()],
            camera_notes: &["the camera was turned".to_owned()],
            ..empty()
        };
        let page = report_html(&input).unwrap();
        assert!(page.contains("&lt;b&gt;lot&lt;/b&gt;") && page.contains("a &lt; b"));
        assert!(!page.contains("http") && !page.contains("<script"), "no player");
        assert!(page.contains("data:image/jpeg;base64,"));
        assert!(page.contains("histogram") && !page.contains("Car by car"));
    }

    /// Returns a page with all sections: a stationary and a driving car, a camera move, pictures and notes.
    fn page_of_two_tracks() -> String {
        let rows: Vec<TrackRow> = (0..20_u64)
            .flat_map(|i| {
                let t = 0.1 * i as f64;
                let turning = Some("turning_left".to_owned());
                let driving = TrackRow {
                    y_m: 12.0 + 3.0 * t,
                    speed_mps: 3.0,
                    activity: turning,
                    activity_p: Some(0.9),
                    ..row(2, i, t)
                };
                let escaped = Some("a</script>b".to_owned());
                [TrackRow { activity: escaped, activity_p: Some(0.8), ..row(1, i, t) }, driving]
            })
            .collect();
        let still = |time_ms: i64| Still { time_ms, jpeg: vec![0xff, 0xd8, 1, 2, 3] };
        let moved = CameraMove {
            kind: MoveKind::Zoomed,
            since_frame: 12,
            since_s: 1.2,
            shift_px: Some([3.0, -4.0]),
            log_scale: Some(0.05),
        };
        let (picture, large) = (RgbImage::new(64, 36), RgbImage::new(2400, 1350));
        let fit = Fit {
            zone: "33N".to_owned(),
            camera_at: [51.106_752_5, 13.916_472_9],
            camera_utm_m: [424_144.89, 5_662_254.56],
            camera_sd_m: [0.4, 0.26],
            bearing_deg: 243.7,
            bearing_sd_deg: 0.56,
            focal_px: 613.0,
            focal_sd_px: 17.0,
            height_m: 3.98,
            height_sd_m: 0.12,
            scale: 0.987,
            residuals_m: vec![[0.3, -0.4], [-0.001, 0.2]],
            warnings: vec!["point 1 lies 0.50 m (3.1 sd) away from its fitted position".to_owned()],
        };
        report_html(&ReportInput {
            cameras: &[camera()],
            rows: &rows,
            samples: &[(3, RgbImage::new(640, 360))],
            frames: &[PlainFrame { frame: 3, time_s: 0.3, segment: Some(0), picture: &large }],
            stills: &[still(0), still(333)],
            still_motion: &[],
            views: &[TrackStill { track: 2, still: still(100) }],
            facts: &[("frames read".to_owned(), "20".to_owned())],
            warnings: &["The picture is dark.".to_owned()],
            background: Some(&picture),
            scene_lines: Some(&picture),
            moves: &[moved],
            camera_notes: &["The camera shakes by up to 2 px.".to_owned()],
            losses: &["12 of 32 frames could not be decoded.".to_owned()],
            traffic: "",
            place: Some(&fit),
            ..empty()
        })
        .unwrap()
    }

    /// Returns the HTML of the page without its scripts.
    fn without_scripts(page: &str) -> String {
        let mut parts = page.split("<script");
        let first = parts.next().unwrap().to_owned();
        parts.fold(first, |text, part| text + part.split_once("</script>").unwrap().1)
    }

    /// Returns the JSON of the script element with this id.
    fn json_of(page: &str, id: &str) -> serde_json::Value {
        let (_, rest) = page.split_once(&format!("<script type=\"application/json\" id=\"{id}\">")).unwrap();
        serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
    }

    #[test]
    fn the_page_contains_the_player_data_and_the_facts_as_text() {
        let page = page_of_two_tracks();
        assert!(!page.contains("http"), "no external parts");
        assert_eq!(
            page.matches("<script").count(),
            4,
            "data and program of the player and of the drawing part"
        );
        let data = json_of(&page, "player-data");
        assert_eq!(data["frames"].as_array().unwrap().len(), 2);
        assert_eq!(data["frames"][1][0], 0.333);
        assert_eq!(data["tracks"][0]["activity"][0], "a</script>b");
        assert_eq!(data["tracks"][1]["y"].as_array().unwrap().len(), 2, "a straight path at constant speed");
        assert_eq!(data["tracks"][1]["crops"][0][0], 0.1);
        // The point where the optical axis meets the ground is in the middle of the picture.
        let p: Vec<f64> =
            data["segments"][0]["p"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let y_m = 8.0 / 0.3f64.tan();
        let at = |row: usize| p[4 * row + 1] * y_m + p[4 * row + 3];
        assert!((at(0) / at(2) - 319.5).abs() < 0.1 && (at(1) / at(2) - 179.5).abs() < 0.1);
        let plain = without_scripts(&page);
        for text in ["2 tracks", "12 of 32 frames", "class=\"birdseye\"", "<td>zoomed</td>", "3, -4", "+5.1"]
        {
            assert!(plain.contains(text), "{text}");
        }
    }

    #[test]
    fn the_drawing_part_has_the_size_of_the_input_and_smaller_pictures() {
        let data = json_of(&page_of_two_tracks(), "draw-data");
        assert_eq!(data["size"], serde_json::json!([2400, 1350]));
        assert_eq!((&data["moving"], &data["stills"][0]["segment"]), (&false.into(), &0.into()));
        assert_eq!((&data["stills"][0]["frame"], &data["stills"][0]["time"]), (&3.into(), &0.3.into()));
        let picture = data["stills"][0]["picture"].as_str().unwrap().split_once(',').unwrap().1;
        let bytes = base64::Engine::decode(&base64::engine::general_purpose::STANDARD, picture).unwrap();
        let picture = image::load_from_memory(&bytes).unwrap();
        assert_eq!((picture.width(), picture.height()), (1920, 1080));
        let moving = ReportInput {
            frames: &[PlainFrame { frame: 0, time_s: 0.0, segment: None, picture: &RgbImage::new(64, 36) }],
            still_motion: &[None, Some([1.0, 0.0, 5.0, 0.0, 1.0, 0.0, 0.0, 0.0])],
            ..empty()
        };
        let data = json_of(&report_html(&moving).unwrap(), "draw-data");
        assert_eq!(data["moving"], true);
        assert!(data["stills"][0]["segment"].is_null(), "no camera was estimated");
    }

    #[test]
    fn the_text_of_the_page() {
        let page = without_scripts(&page_of_two_tracks());
        let (_, body) = page.split_once("</style>").unwrap();
        // Each row of a table becomes one line. Each other element becomes one line too.
        let spaced =
            body.replace("</td>", " | ").replace("</th>", " | ").replace('\n', " ").replace("</tr>", "\n");
        let mut text = String::new();
        for part in spaced.split('<') {
            let (tag, words) = part.split_once('>').unwrap_or(("", part));
            let is_cell = ["td", "th", "/", "span", "kbd", "svg width", "polyline"]
                .iter()
                .any(|name| tag.starts_with(name));
            text.push_str(if is_cell { "" } else { "\n" });
            text.push_str(words);
        }
        let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        insta::assert_snapshot!(lines.join("\n"));
    }
}
