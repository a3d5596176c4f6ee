//! The camera in the report: a table of its values by segment, and a table of its moves.

use roadplane_base::{CameraEstimate, CameraMove, CameraStatus, MoveKind};

use super::html::put;

/// Appends the table of the camera's values to the page, with one row per segment.
pub(super) fn cameras(page: &mut String, cameras: &[CameraEstimate]) {
    page.push_str(
        "<h2>Camera</h2>\n<div class=\"scroll\"><table><thead><tr><th>segment</th><th>from – to, s</th>\
         <th>focal length, px</th><th>distortion</th><th>height, m</th><th>tilt, °</th><th>roll, °</th><th>cars</th><th>frames</th>\
         <th>status</th></tr></thead>\n",
    );
    for (segment, camera) in cameras.iter().enumerate() {
        let sd = |i: usize| camera.covariance[(i, i)].max(0.0).sqrt();
        let params = &camera.params;
        let (focal, height) = (params.focal_px(), params.log_height.exp());
        put(
            page,
            format_args!(
                "<tr><td>{segment}</td><td>{:.1} – {:.1}</td><td>{focal:.0} ± {:.0}</td><td>{}</td><td>{height:.2} ± {:.2}</td>\
                 <td>{:.2} ± {:.2}</td><td>{:.2} ± {:.2}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                camera.span_s[0],
                camera.span_s[1],
                focal * sd(0),
                distortion_in_words(camera),
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
    if let Some(slope_rad) = cameras.iter().find_map(CameraEstimate::slope_rad) {
        let percent = 100.0 * slope_rad.abs().tan();
        let verb = if slope_rad > 0.0 { "rises" } else { "falls" };
        put(
            page,
            format_args!(
                "<p>The ground is two planes: beyond a line, it {verb} by {percent:.1} % relative to the first plane.</p>\n"
            ),
        );
    }
}

/// Returns the distortion coefficient and its standard deviation as text; `assumed zero` if the distortion was not
/// measured.
fn distortion_in_words(camera: &CameraEstimate) -> String {
    camera.distortion_sd.map_or_else(
        || "assumed zero".to_owned(),
        |sd| format!("{:.3} ± {sd:.3}", camera.lens.distortion(camera.image_size_px)),
    )
}

/// Appends the table of the camera's moves to the page, with one row per move.
pub(super) fn moves(page: &mut String, moves: &[CameraMove]) {
    if moves.is_empty() {
        return;
    }
    page.push_str(
        "<h3>Moves</h3>\n<div class=\"scroll\"><table><thead><tr><th>at, s</th><th>frame</th><th>move</th>\
         <th>shift right, down, px</th><th>zoom, %</th></tr></thead>\n",
    );
    for moved in moves {
        let kind = match moved.kind {
            MoveKind::Turned => "turned",
            MoveKind::Zoomed => "zoomed",
            MoveKind::Cut => "another scene",
            MoveKind::Moving => "starts to move",
        };
        let shift = moved.shift_px.map_or_else(|| "–".to_owned(), |[x, y]| format!("{x:.0}, {y:.0}"));
        let zoom = moved
            .log_scale
            .map_or_else(|| "–".to_owned(), |log_scale| format!("{:+.1}", 100.0 * log_scale.exp_m1()));
        put(
            page,
            format_args!(
                "<tr><td>{:.2}</td><td>{}</td><td>{kind}</td><td>{shift}</td><td>{zoom}</td></tr>\n",
                moved.since_s, moved.since_frame
            ),
        );
    }
    page.push_str("</table></div>\n");
}

/// Returns the source of the camera's values in words.
fn status_in_words(status: CameraStatus) -> &'static str {
    match status {
        CameraStatus::Estimated => "estimated from the cars",
        CameraStatus::FocalGiven => "focal length given",
        CameraStatus::FocalFromPrior => "focal length from the prior",
        CameraStatus::Unobservable => "unobservable: prior only",
    }
}
