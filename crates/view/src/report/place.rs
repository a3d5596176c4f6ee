//! The camera on the map: a table of its position, and a table of the surveyed points.

use roadplane_geo::Fit;

use super::html::{escape, put};

/// Appends the camera's position on the map to the page, and the residual of each surveyed point.
pub(super) fn place(page: &mut String, fit: &Fit) {
    let ([latitude, longitude], [east, north], [east_sd, north_sd]) =
        (fit.camera_at, fit.camera_utm_m, fit.camera_sd_m);
    // With `--camera-at`, the position and the bearing are taken as exact.
    let with_sd = |value: f64, sd: f64, decimals: usize| {
        let sd = if sd > 0.0 { format!(" ± {sd:.decimals$}") } else { String::new() };
        format!("{value:.decimals$}{sd}")
    };
    page.push_str("<h2>On the map</h2>\n<div class=\"scroll\"><table class=\"facts\">\n");
    for (name, value) in [
        ("latitude, longitude of the camera, °", format!("{latitude:.7}, {longitude:.7}")),
        ("UTM zone", escape(&fit.zone)),
        ("easting of the camera, m", with_sd(east, east_sd, 2)),
        ("northing of the camera, m", with_sd(north, north_sd, 2)),
        ("bearing from grid north, °", with_sd(fit.bearing_deg, fit.bearing_sd_deg, 2)),
        ("focal length, px", with_sd(fit.focal_px, fit.focal_sd_px, 0)),
        ("height above the ground, m", with_sd(fit.height_m, fit.height_sd_m, 2)),
        ("metres on the map per metre of the run", format!("{:.3}", fit.scale)),
    ] {
        put(page, format_args!("<tr><th>{name}</th><td>{value}</td></tr>\n"));
    }
    page.push_str("</table></div>\n");
    for warning in &fit.warnings {
        put(page, format_args!("<p class=\"warning\">{}</p>\n", escape(warning)));
    }
    residuals(page, &fit.residuals_m);
}

/// Appends the residuals of the surveyed points (easting, northing), m.
fn residuals(page: &mut String, residuals_m: &[[f64; 2]]) {
    if residuals_m.is_empty() {
        return;
    }
    page.push_str(
        "<h3>Surveyed points</h3>\n<div class=\"scroll\"><table><thead><tr><th>point</th><th>residual east, m</th>\
         <th>residual north, m</th><th>distance, m</th></tr></thead>\n",
    );
    // Rounding can give −0. The addition of 0 changes it to 0.
    let rounded = |metres: f64| (metres * 100.0).round() / 100.0 + 0.0;
    for (i, [east, north]) in residuals_m.iter().enumerate() {
        put(
            page,
            format_args!(
                "<tr><th>{}</th><td>{:+.2}</td><td>{:+.2}</td><td>{:.2}</td></tr>\n",
                i + 1,
                rounded(*east),
                rounded(*north),
                east.hypot(*north)
            ),
        );
    }
    let square: f64 = residuals_m.iter().map(|[east, north]| east * east + north * north).sum();
    put(
        page,
        format_args!(
            "<tr><th>rms</th><td></td><td></td><td>{:.2}</td></tr>\n</table></div>\n<p class=\"hint\">A residual is the fitted \
             position minus the surveyed position.</p>\n",
            (square / residuals_m.len() as f64).sqrt()
        ),
    );
}
