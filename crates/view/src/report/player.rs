//! The interactive player of the report: its data and its HTML markup. The script `player.js` fills the markup with the
//! data.
//!
//! If the browser runs no scripts, the player is hidden.

use base64::{Engine as _, engine::general_purpose::STANDARD};
use nalgebra::Matrix3x4;
use roadplane_base::{CameraEstimate, TrackRow};
use serde::{Serialize, Serializer};

use super::gaps::hidden_intervals;
use super::input::{ReportInput, Still, by_track};
use super::thin::{Vertex, thinned};
use super::tracks::{path_m, top_mps};
use crate::ViewError;
use crate::activities::{SHOWN, activity_colour, words};
use crate::birds_eye::{bounds, hex};
use crate::overlay::track_colour;

/// Largest number of vertices in all trajectories of the page together. At this limit, the vertices need about 2 MB.
const MAX_VERTICES: usize = 30_000;
/// Largest number of doublings of the allowed interpolation error. The error is doubled while there are more than
/// [`MAX_VERTICES`] vertices.
const DOUBLINGS: u32 = 10;

/// HTML markup of the player.
const MARKUP: &str = include_str!("player.html");
/// Scripts of the player, in the order in which they run.
const SCRIPTS: [&str; 2] = [include_str!("player_draw.js"), include_str!("player.js")];

/// The data of the player, as JSON in the page.
#[derive(Serialize)]
struct Data<'a> {
    /// Width and height of the picture, px.
    size: [u32; 2],
    /// Left, right, bottom and top edges of the initial view from above in world coordinates, m.
    view: [Rounded<1>; 4],
    /// Each small frame: its time, s, its JPEG file in base64, and the motion of the camera. The motion has the first
    /// eight numbers of the matrix from pixels of the segment's camera to pixels of the frame. It is null at rest.
    frames: Vec<(Rounded<3>, String, Option<[f64; 8]>)>,
    segments: Vec<Segment>,
    /// Name, displayed text and colour of each activity, in the order of the legend.
    activities: Vec<(&'a str, String, String)>,
    tracks: Vec<TrackData<'a>>,
}

/// A camera segment: an interval in which the camera shows one scene.
///
/// `from` and `to` are its start and end, s. `p` contains the rows of the projection matrix from world coordinates (m)
/// to the picture (px), without distortion.
#[derive(Serialize)]
struct Segment {
    from: Rounded<3>,
    to: Rounded<3>,
    p: [f64; 12],
    /// Principal point, px, and the distortion of the lens, 1/px².
    lens: [f64; 3],
    /// Half the width of the field of view at a distance of 1 m from the camera, m.
    half: Rounded<4>,
}

/// The data of one track. The lists from `t` to `bbox` have one item per vertex of the trajectory.
#[derive(Default, Serialize)]
struct TrackData<'a> {
    id: u64,
    class: &'a str,
    colour: String,
    dims: [Rounded<2>; 3],
    path: Rounded<1>,
    top: Rounded<1>,
    /// Intervals in which the vehicle was hidden, s.
    hidden: Vec<[Rounded<2>; 2]>,
    t: Vec<Rounded<3>>,
    x: Vec<Rounded<2>>,
    y: Vec<Rounded<2>>,
    z: Vec<Rounded<2>>,
    heading: Vec<Rounded<3>>,
    speed: Vec<Rounded<2>>,
    x_sd: Vec<Rounded<2>>,
    y_sd: Vec<Rounded<2>>,
    heading_sd: Vec<Rounded<3>>,
    speed_sd: Vec<Rounded<2>>,
    segment: Vec<usize>,
    activity: Vec<Option<&'a str>>,
    bbox: Vec<[Rounded<0>; 4]>,
    crops: Vec<(Rounded<3>, String)>,
}

/// A number that is written with at most `DECIMALS` decimals.
#[derive(Clone, Copy, Debug, Default)]
struct Rounded<const DECIMALS: i32>(f64);

impl<const DECIMALS: i32> Serialize for Rounded<DECIMALS> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let scale = 10f64.powi(DECIMALS);
        let rounded = (self.0 * scale).round() / scale;
        if rounded.fract().abs() < f64::EPSILON && rounded.abs() < 1e15 {
            serializer.serialize_i64(rounded as i64)
        } else {
            serializer.serialize_f64(rounded)
        }
    }
}

/// Returns the HTML of the player. The text is empty if there is nothing to play.
pub(super) fn player(input: &ReportInput<'_>) -> Result<String, ViewError> {
    let Some(first) = input.cameras.first() else { return Ok(String::new()) };
    if input.rows.is_empty() && input.stills.is_empty() {
        return Ok(String::new());
    }
    let data = Data {
        size: first.image_size_px.into(),
        view: bounds(input.rows).map(Rounded),
        frames: input
            .stills
            .iter()
            .enumerate()
            .map(|(i, still)| {
                let (time, jpeg) = inlined(still);
                (time, jpeg, input.still_motion.get(i).copied().flatten())
            })
            .collect(),
        segments: input.cameras.iter().map(segment).collect(),
        activities: SHOWN
            .into_iter()
            .map(|activity| (activity, words(activity), hex(activity_colour(activity))))
            .collect(),
        tracks: tracks(input, f64::from(first.image_size_px.width)),
    };
    // A script element ends at the first end tag, even within a string. So `<` is escaped.
    let json = serde_json::to_string(&data)
        .map_err(|source| ViewError::Data { what: source.to_string() })?
        .replace('<', "\\u003c");
    let scripts = SCRIPTS.concat();
    Ok(format!(
        "{MARKUP}<script type=\"application/json\" id=\"player-data\">{json}</script>\n<script>\n{scripts}</script>\n"
    ))
}

fn inlined(still: &Still) -> (Rounded<3>, String) {
    (Rounded(still.time_ms as f64 * 1e-3), STANDARD.encode(&still.jpeg))
}

fn segment(estimate: &CameraEstimate) -> Segment {
    let (focal, middle) = (estimate.params.focal_px(), estimate.principal_point_px);
    let intrinsic = nalgebra::Matrix3::new(focal, 0.0, middle.x, 0.0, focal, middle.y, 0.0, 0.0, 1.0);
    let motion = estimate.params.plane().camera_from_world().to_homogeneous();
    let pixel_from_world: Matrix3x4<f64> = intrinsic * motion.fixed_rows::<3>(0);
    let entry = |i: usize| pixel_from_world[(i / 4, i % 4)];
    Segment {
        from: Rounded(estimate.span_s[0]),
        to: Rounded(estimate.span_s[1]),
        p: std::array::from_fn(|i| (entry(i) * 1e6).round() / 1e6),
        lens: [middle.x, middle.y, estimate.lens.per_px2],
        half: Rounded(f64::from(estimate.image_size_px.width) / 2.0 / focal),
    }
}

fn tracks<'a>(input: &ReportInput<'a>, width_px: f64) -> Vec<TrackData<'a>> {
    let tracks = by_track(input.rows);
    let all = |slack: f64| -> Vec<Vec<Vertex<'a>>> {
        tracks.values().map(|rows| thinned(rows, width_px, slack)).collect()
    };
    let mut vertices = all(1.0);
    for doubling in 1..=DOUBLINGS {
        if vertices.iter().map(Vec::len).sum::<usize>() <= MAX_VERTICES {
            break;
        }
        vertices = all(f64::from(1 << doubling));
    }
    let views = |track: u64| {
        let own = input.views.iter().filter(move |view| view.track == track);
        own.map(|view| inlined(&view.still)).collect()
    };
    tracks
        .iter()
        .zip(&vertices)
        .map(|((track, rows), vertices)| TrackData {
            crops: views(*track),
            ..track_data(*track, rows, vertices)
        })
        .collect()
}

fn track_data<'a>(track: u64, rows: &[&'a TrackRow], vertices: &[Vertex<'a>]) -> TrackData<'a> {
    let mut data = TrackData {
        id: track,
        class: rows.last().map_or("", |row| row.class.name()),
        colour: hex(track_colour(track)),
        dims: rows
            .last()
            .map_or_else(Default::default, |row| [row.length_m, row.width_m, row.height_m].map(Rounded)),
        path: Rounded(path_m(rows)),
        top: Rounded(top_mps(rows)),
        hidden: hidden_intervals(rows).into_iter().map(|interval| interval.map(Rounded)).collect(),
        ..TrackData::default()
    };
    for Vertex { row, heading_rad } in vertices {
        data.t.push(Rounded(row.time_s));
        data.x.push(Rounded(row.x_m));
        data.y.push(Rounded(row.y_m));
        data.z.push(Rounded(row.z_m));
        data.heading.push(Rounded(*heading_rad));
        data.speed.push(Rounded(row.speed_mps));
        data.x_sd.push(Rounded(row.x_sd_m));
        data.y_sd.push(Rounded(row.y_sd_m));
        data.heading_sd.push(Rounded(row.heading_sd_rad));
        data.speed_sd.push(Rounded(row.speed_sd_mps));
        data.segment.push(row.segment);
        data.activity.push(row.activity.as_deref());
        data.bbox.push(row.bbox_px.map(Rounded));
    }
    data
}
