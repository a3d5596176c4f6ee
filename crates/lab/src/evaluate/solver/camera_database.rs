//! Accuracy of stored cameras on synthetic clips: error, Cramér–Rao bound and reported sd after 1, 3, 10, 30 nights.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{
    CameraEstimate, CameraEvidence, CameraParams, ClipIdentity, EVIDENCE_SCHEMA, JointInformation, ParkedCar,
    ShapeAtlas, bbox_around,
};
use roadplane_calibrate::{FuseOptions, SameView, epochs, fuse};
use roadplane_pipeline::Config;
use roadplane_solve::{CarView, SceneOptions, solve_scene};
use roadplane_synth::{Rng, SceneTruth, SynthOptions, scene};
use roadplane_tables::{Column, Table};

use super::scenes::bound;
use crate::parallel::in_parallel;
use crate::work::of_simulated_keypoints;

/// sd of the error in log size that all cars of one site share.
///
/// The cars of a site also share an error of view. Its sd is the value that a run assumes (`solve.shared_view_sd_deg`).
const SITE_LOG_SD: f64 = 0.04;
/// sds of the view errors of single cars, rad: elevation and turn. The sds of the keypoints do not include these
/// errors.
const VIEW_SD: [f64; 2] = [0.035; 2];
/// Angle by which the camera is turned between two nights, rad.
const TURN: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Seed of the first camera.
const SEED: u64 = 7_000_000;

/// A synthetic camera and the evidence of its clips.
struct Camera {
    truth: CameraParams,
    /// Error in log size that all cars of the site share.
    site: f64,
    evidence: Vec<CameraEvidence>,
    bounds: Vec<JointInformation>,
    /// The evidence of a clip that was recorded after the camera was turned.
    turned: CameraEvidence,
}

/// Returns a table of errors and sds over `cameras` cameras with `clips` clips each. Its rows use the first 1, 3, 10, …
/// clips.
///
/// The table also shows how often a camera that is turned by 2° starts a new epoch. Here the pictures of two nights are
/// not compared.
#[must_use]
pub fn camera_database_tables(atlas: &ShapeAtlas, cameras: usize, clips: usize) -> Vec<Table> {
    let shared_sd = solve_options().shared_sd();
    let all = in_parallel(cameras, |i| camera(atlas, clips, SEED + 1000 * i as u64));
    let counts: Vec<usize> = [1, 3, 10, 30, 100].into_iter().filter(|n| *n < clips).chain([clips]).collect();
    let mut table = Table::new(
        format!("{cameras} stored cameras, ten other cars in each clip"),
        format!(
            "Sizes of a site's cars share an error of {:.0} % (1 sd), which stays in the heights. All cars of a site share an error of view of \
             {:.1}° in elevation and {:.1}° in turn (1 sd). Bound: of all keypoints, with those errors. Turned: the camera is turned by 2° after \
             the given number of clips, and no pictures are compared.",
            100.0 * SITE_LOG_SD,
            shared_sd[0].to_degrees(),
            shared_sd[1].to_degrees(),
        ),
        [
            ("clips", 0),
            ("focal error, % rms", 2),
            ("focal bound, %", 2),
            ("focal normalised error, rms", 2),
            ("height error, % rms", 2),
            ("height bound, %", 2),
            ("height normalised error, rms", 2),
            ("without the site's share: height normalised error", 2),
            ("tilt error, ° rms", 3),
            ("tilt normalised error, rms", 2),
            ("all clips in one epoch, % of cameras", 1),
            ("a turn by 2° detected in its first clip, %", 1),
        ]
        .map(|(title, digits)| Column::new(title, digits))
        .to_vec(),
    );
    for count in counts {
        let rows = in_parallel(all.len(), |i| after(&all[i], count));
        let rows: Vec<&After> = rows.iter().flatten().collect();
        let rms = |value: &dyn Fn(&After) -> f64| {
            (rows.iter().map(|row| value(row).powi(2)).sum::<f64>() / rows.len().max(1) as f64).sqrt()
        };
        let share = |is: &dyn Fn(&After) -> bool| {
            100.0 * rows.iter().filter(|row| is(row)).count() as f64 / rows.len().max(1) as f64
        };
        let row = [
            count as f64,
            100.0 * rms(&|a| a.off[0]),
            100.0 * rms(&|a| a.bound_sd[0]),
            rms(&|a| a.off[0] / a.sd[0]),
            100.0 * rms(&|a| a.off[3]),
            100.0 * rms(&|a| a.bound_sd[3]),
            rms(&|a| a.off[3] / a.sd[3]),
            rms(&|a| a.height_off_at_site / a.height_sd_at_site),
            rms(&|a| a.off[1].to_degrees()),
            rms(&|a| a.off[1] / a.sd[1]),
            share(&|a| a.epochs == 1),
            share(&|a| a.turn_detected),
        ];
        table.rows.push(row.map(Into::into).to_vec());
    }
    vec![table]
}

/// The errors and sds of the estimated camera after some clips.
struct After {
    off: Vector4<f64>,
    sd: Vector4<f64>,
    bound_sd: Vector4<f64>,
    height_off_at_site: f64,
    height_sd_at_site: f64,
    epochs: usize,
    turn_detected: bool,
}

fn after(camera: &Camera, count: usize) -> Option<After> {
    let evidence = &camera.evidence[..count];
    let options = options();
    let no_picture = |_: &CameraEvidence, _: &CameraEvidence| SameView::Unknown;
    let found = epochs(evidence, &no_picture, &options);
    let site = Matrix4::from_diagonal(&Vector4::new(0.0, 0.0, 0.0, SITE_LOG_SD * SITE_LOG_SD));
    let sd_of = |covariance: Matrix4<f64>| (covariance + site).diagonal().map(f64::sqrt);
    let last = &evidence.last()?.clip;
    let now = found.iter().find(|epoch| epoch.clips.iter().any(|clip| clip.clip == *last))?;
    let estimate: CameraEstimate = fuse(&now.windows, &options).pop()?;
    let off = estimate.params.to_vector() - camera.truth.to_vector();
    let prior = Matrix4::from_diagonal(&options.prior_sd.map(|sd| 1.0 / (sd * sd)));
    let mut bound = JointInformation::none();
    camera.bounds[..count].iter().for_each(|clip| bound.add(clip, 1.0));
    let bound = prior + bound.marginal(options.shared_sd).0;
    let mut turned = evidence.to_vec();
    turned.push(camera.turned.clone());
    let with_turned = epochs(&turned, &no_picture, &options);
    Some(After {
        off,
        sd: sd_of(estimate.covariance),
        bound_sd: sd_of(bound.cholesky()?.inverse()),
        height_off_at_site: off[3] + camera.site,
        height_sd_at_site: estimate.covariance[(3, 3)].sqrt(),
        epochs: found.len(),
        turn_detected: with_turned
            .iter()
            .any(|epoch| epoch.clips.len() == 1 && epoch.clips[0].clip == camera.turned.clip),
    })
}

/// Returns the options with which a run solves a frame.
fn solve_options() -> SceneOptions {
    of_simulated_keypoints(&Config::default()).solve.scene_options(None)
}

/// Returns the options with which a run fuses the evidence of clips.
fn options() -> FuseOptions {
    let run = solve_options();
    let size = SynthOptions::default().size;
    FuseOptions { shared_sd: run.shared_sd(), ..FuseOptions::new(size, &run.camera_prior, None) }
}

fn camera(atlas: &ShapeAtlas, clips: usize, seed: u64) -> Camera {
    let mut random = Rng::new(seed);
    let site = SITE_LOG_SD * random.normal();
    let ratio = random.uniform(0.7_f64.ln(), 2.5_f64.ln()).exp();
    let height_m = random.uniform(4.5_f64.ln(), 16_f64.ln()).exp();
    let (tilt, roll) = (random.uniform(0.2, 0.6), random.uniform(-0.05, 0.05));
    let solve = solve_options();
    let [elevation_sd, turn_sd, ..] = solve.shared_sd();
    let view_off = [elevation_sd, turn_sd].map(|sd| sd * random.normal());
    // Cars that are larger by a factor, seen from height h, give the same picture as normal cars seen from height h /
    // factor.
    let asked = |tilt: f64| SynthOptions {
        noise: 0.02,
        focal_ratio: [ratio; 2],
        height_m: [height_m * (-site).exp(); 2],
        tilt: [tilt; 2],
        roll: [roll; 2],
        view_off,
        view_sd: VIEW_SD,
        ..SynthOptions::default()
    };
    let mut truth = CameraParams::from_vector(&Vector4::zeros());
    let (mut evidence, mut bounds) = (Vec::new(), Vec::new());
    for clip in 0..clips {
        let scene = scene(atlas, &asked(tilt), seed + 1 + clip as u64);
        truth = CameraParams { log_height: height_m.ln(), ..scene.params };
        bounds.push(
            bound(atlas, &scene, &solve).map_or_else(JointInformation::none, |bound| bound.information),
        );
        evidence.push(evidence_of(atlas, &scene, clip, &solve));
    }
    let turned = scene(atlas, &asked(tilt + TURN), seed + 900);
    let turned = evidence_of(atlas, &turned, clips, &solve);
    Camera { truth, site, evidence, bounds, turned }
}

fn evidence_of(
    atlas: &ShapeAtlas,
    truth: &SceneTruth,
    clip: usize,
    options: &SceneOptions,
) -> CameraEvidence {
    let found = solve_scene(atlas, truth.size, &CarView::each(truth.keypoints()), options);
    let used = truth.cars.iter().zip(&found.cars).filter(|(_, car)| car.as_ref().is_some_and(|c| c.used));
    let parked = used.filter_map(|(car, _)| {
        let keypoints_px: Vec<Option<[f64; 2]>> =
            car.keypoints.iter().map(|point| point.as_ref().map(|p| [p.pixel.x, p.pixel.y])).collect();
        let points = keypoints_px.iter().flatten().map(|[x, y]| [*x, *y, *x, *y]);
        let bbox_px = points.reduce(|a, b| bbox_around(&a, &b))?;
        Some(ParkedCar { bbox_px, keypoints_px })
    });
    let (params, own) = found.by_cars();
    let own = if found.status.usable() { own } else { JointInformation::none() };
    CameraEvidence {
        schema: EVIDENCE_SCHEMA.to_owned(),
        camera: "synthetic".to_owned(),
        clip: ClipIdentity {
            recorded: format!("{clip:04}"),
            sha256: format!("{clip:04}"),
            name: format!("clip_{clip:04}"),
        },
        models: Vec::new(),
        image_size_px: truth.size,
        span_s: [0.0, 60.0],
        frames: 1,
        params: params.to_vector().into(),
        information: own.information.transpose().into(),
        shared: own.cross.transpose().into(),
        lens: None,
        parked: parked.collect(),
        moving: 0,
        place: None,
    }
}
