//! Configuration of the program. A TOML file and `--set key=value` options give a [`Config`], which is checked here.
//!
//! The file `configs/default.toml` lists every setting with its default, unit and range. A test checks that the
//! defaults in the file are those of the code. The file lists rarely changed settings under `[expert.SECTION]`. A user
//! may write any setting under `[SECTION]` or under `[expert.SECTION]`.

use std::path::{Path, PathBuf};

use roadplane_decode::DecodeOptions;
use roadplane_detect::DetectOptions;
use roadplane_infer::ProviderChoice;
use roadplane_keypoints::KeypointOptions;
use roadplane_measure::FitLimits;
use roadplane_solve::{CameraPrior, OutlierModel, SceneOptions, ViewErrors};
use roadplane_track::TrackOptions;
use roadplane_traffic::Units;
use serde::de::Error as _;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use thiserror::Error;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

/// All settings of the program. Each field is a section of the configuration file.
///
/// Some sections are defined in the crates of their stages. `[solve]` and `[calibrate]` are defined here, because the
/// crates of these stages do not depend on serde.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Which frames of an input are read, and limits on their size and rate.
    pub decode: DecodeOptions,
    /// The engine that runs the nets.
    pub infer: InferConfig,
    /// The files of the nets.
    pub models: ModelsConfig,
    /// When the nets run, and on which regions of the frame.
    pub watch: WatchConfig,
    /// How the detector finds vehicles.
    pub detect: DetectOptions,
    /// How the keypoint net is run.
    pub keypoints: KeypointOptions,
    /// How the camera and the poses of cars are estimated.
    pub solve: SolveConfig,
    /// How the camera is estimated over the clip.
    pub calibrate: CalibrateConfig,
    /// How cars are tracked.
    pub track: TrackOptions,
    /// Whether the activities of tracks are labelled.
    pub activity: ActivityConfig,
    /// Tables of traffic.
    pub traffic: TrafficConfig,
    /// How much memory the pipeline uses for frames.
    pub pipeline: PipelineConfig,
    /// Content of the report.
    pub output: OutputConfig,
}

/// `[infer]`: the engine that runs the nets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InferConfig {
    /// The execution provider: the engine and the number format that run the nets.
    pub provider: ProviderChoice,
    /// Number of threads of each net.
    pub threads: usize,
}

impl Default for InferConfig {
    fn default() -> Self {
        Self { provider: ProviderChoice::Auto, threads: 1 }
    }
}

/// `[models]`: the files of the nets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelsConfig {
    /// Folder of the models. If it is absent, [`find_models`](crate::find_models) searches for the folder.
    pub folder: Option<PathBuf>,
    /// Path of the detector's model card, relative to the folder of the models.
    pub detector: PathBuf,
    /// Path of the keypoint net's model card, relative to the folder of the models.
    pub keypoints: PathBuf,
    /// Path of the activity net's model card, relative to the folder of the models.
    pub activity: PathBuf,
}

impl Default for ModelsConfig {
    fn default() -> Self {
        Self {
            folder: None,
            detector: "detector.card.json".into(),
            keypoints: "hourglass.card.json".into(),
            activity: "activity.card.json".into(),
        }
    }
}

/// `[watch]`: when the nets run, and on which regions of the frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WatchConfig {
    /// Whether region-of-interest scheduling is on. If it is on, the nets run only on image regions that changed, as
    /// often as the motion in these regions requires. If it is off, the nets run on every frame in full.
    pub attention: bool,
    /// Time between inference frames, s. Inference frames are the frames on which the nets run. The detector runs more
    /// often on small frames, because each run costs less.
    pub look_s: f64,
    /// Period of the full scan, s. In this time the detector processes every part of the frame once, even if nothing
    /// changed.
    pub sweep_s: f64,
}

impl Default for WatchConfig {
    fn default() -> Self {
        Self { attention: true, look_s: 0.11, sweep_s: 4.0 }
    }
}

/// `[activity]`: whether the activities of tracks are labelled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ActivityConfig {
    /// Whether the activities of tracks are labelled.
    pub enabled: bool,
}

impl Default for ActivityConfig {
    fn default() -> Self {
        Self { enabled: true }
    }
}

/// `[traffic]`: tables of traffic.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrafficConfig {
    /// Whether a run writes tables of traffic.
    pub enabled: bool,
    /// File with gates and zones. Without it, the roads that lead out of the picture are the gates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gates: Option<PathBuf>,
    /// Length of the periods, such as `15min`.
    pub every: String,
    /// Name of the time zone of dates in the names of clips.
    pub time_zone: String,
    /// Units of speeds.
    pub units: Units,
}

impl Default for TrafficConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            gates: None,
            every: "15min".to_owned(),
            time_zone: "UTC".to_owned(),
            units: Units::Kmh,
        }
    }
}

/// `[pipeline]`: how much memory the pipeline uses for frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PipelineConfig {
    /// Memory for frames that wait between stages, MiB.
    pub buffer_mib: u64,
}

impl Default for PipelineConfig {
    fn default() -> Self {
        Self { buffer_mib: 128 }
    }
}

/// `[calibrate]`: how the camera is estimated over the clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrateConfig {
    /// Length of a time window, s. The camera is estimated from all frames of a window jointly.
    pub window_s: f64,
}

impl Default for CalibrateConfig {
    fn default() -> Self {
        Self { window_s: 30.0 }
    }
}

/// `[output]`: content of the report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputConfig {
    /// Number of frames in the report that show the tracks as an overlay.
    pub sample_frames: usize,
    /// Approximate largest size of the report, MiB. This size limits the small frames and cut-outs that the player in
    /// the report shows. With 0, the report has no such pictures.
    pub report_mib: f64,
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self { sample_frames: 3, report_mib: 8.0 }
    }
}

/// `[solve]`: the prior on the camera, the noise model of keypoints, and the limits for rejecting cars.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolveConfig {
    /// Number of keypoints of a car that together count as one independent keypoint, because their errors are
    /// correlated; 1 or more.
    pub keypoints_as_one: f64,
    /// Sds of two systematic errors of the nets, which are the same for all cars of a scene, degrees; 0 or more. The
    /// first error is in the elevation: the angle between the line of sight and the ground. The second error is in the
    /// rotation of a car in the image plane.
    pub shared_view_sd_deg: [f64; 2],
    /// Mean error of the elevation for cars seen from the front or rear, degrees. It is positive where the nets place
    /// the keypoints as if the cars were seen from a steeper direction.
    pub mean_elevation_error_deg: f64,
    /// Prior median of the focal length, in units of the longer image side.
    pub focal_prior_ratio: f64,
    /// Prior sd of the natural logarithm of the focal length.
    pub focal_prior_log_sd: f64,
    /// Prior mean of the camera's tilt, degrees below the horizontal.
    pub tilt_prior_deg: f64,
    /// Prior sd of the camera's tilt, degrees.
    pub tilt_prior_sd_deg: f64,
    /// Prior sd of the camera's roll, degrees. The prior mean is 0.
    pub roll_prior_sd_deg: f64,
    /// Prior median of the camera's height above the ground, m.
    pub height_prior_m: f64,
    /// Prior sd of the natural logarithm of the camera's height.
    pub height_prior_log_sd: f64,
    /// Limit on the error of a keypoint, in sds. Above this limit, a keypoint is more likely an outlier than an inlier.
    pub outlier_sd: f64,
    /// Least number of inlier keypoints of a car. Cars with fewer inliers are rejected.
    pub min_inliers: usize,
    /// Least share of inlier keypoints of a car, 0–1. Cars with a smaller share are rejected.
    pub min_inlier_share: f64,
    /// Least score of a keypoint, 0–1. Keypoints with a lower score are not used.
    pub min_keypoint_score: f64,
    /// Least intersection over union of a car's projected box and its detected box, 0–1. Cars with a smaller value are
    /// rejected.
    pub min_box_overlap: f64,
    /// Largest rms keypoint error of a car, as a share of the longer side of its box. Cars with a larger error are
    /// rejected.
    pub max_rms_share: f64,
    /// Whether vertical lines of the scene constrain the focal length.
    pub use_verticals: bool,
    /// Whether the lens distortion is estimated from long edges of the scene. If not, the lens is assumed to have no
    /// distortion.
    pub use_lens: bool,
}

impl Default for SolveConfig {
    fn default() -> Self {
        let scene = SceneOptions::default();
        let prior = scene.camera_prior;
        let deg = |rad: f64| (rad.to_degrees() * 1e9).round() / 1e9;
        Self {
            keypoints_as_one: 6.0,
            shared_view_sd_deg: [0.9, 1.4],
            mean_elevation_error_deg: 0.5,
            focal_prior_ratio: prior.focal_ratio,
            focal_prior_log_sd: prior.log_focal_sd,
            tilt_prior_deg: deg(prior.tilt),
            tilt_prior_sd_deg: deg(prior.tilt_sd),
            roll_prior_sd_deg: deg(prior.roll_sd),
            height_prior_m: prior.height_m,
            height_prior_log_sd: prior.log_height_sd,
            outlier_sd: scene.kernel.threshold_squared.sqrt(),
            min_inliers: scene.min_inliers,
            min_inlier_share: scene.min_inlier_share,
            min_keypoint_score: 0.5,
            min_box_overlap: 0.5,
            max_rms_share: 0.07,
            use_verticals: true,
            use_lens: true,
        }
    }
}

impl SolveConfig {
    /// Whether estimation uses vertical lines or long edges of the scene.
    #[must_use]
    pub fn reads_scene(&self) -> bool {
        self.use_verticals || self.use_lens
    }

    /// Returns the limits of a valid fit.
    #[must_use]
    pub fn fit_limits(&self) -> FitLimits {
        FitLimits { min_box_overlap: self.min_box_overlap, max_rms_share: self.max_rms_share }
    }

    /// Returns the options of the solver. `given_focal_px` is an exact focal length from the user, px, if there is one.
    #[must_use]
    pub fn scene_options(&self, given_focal_px: Option<f64>) -> SceneOptions {
        let [elevation, turn] = self.shared_view_sd_deg.map(f64::to_radians);
        SceneOptions {
            given_focal_px,
            camera_prior: CameraPrior {
                focal_ratio: self.focal_prior_ratio,
                log_focal_sd: self.focal_prior_log_sd,
                tilt: self.tilt_prior_deg.to_radians(),
                tilt_sd: self.tilt_prior_sd_deg.to_radians(),
                roll_sd: self.roll_prior_sd_deg.to_radians(),
                height_m: self.height_prior_m,
                log_height_sd: self.height_prior_log_sd,
            },
            kernel: OutlierModel { threshold_squared: self.outlier_sd * self.outlier_sd },
            min_inliers: self.min_inliers,
            min_inlier_share: self.min_inlier_share,
            view_errors: Some(ViewErrors {
                keypoints_as_one: self.keypoints_as_one,
                mean_elevation: self.mean_elevation_error_deg.to_radians(),
                shared_sd: [elevation, turn, 0.0, 0.0, 0.0],
            }),
            ..SceneOptions::default()
        }
    }
}

/// An error in a configuration.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration: {source}: {path}")]
    Unreadable {
        /// The error of the operating system.
        source: std::io::Error,
        /// Path of the file.
        path: String,
    },
    /// The text is not valid TOML, a key is unknown, a value has a wrong type, or a setting has two values.
    #[error("in {origin}: {problem}")]
    Malformed {
        /// Origin of the error: the path of the file, or the `--set` option.
        origin: String,
        /// Message of the parser. For a file, it contains the line and the column.
        problem: String,
    },
    /// A value is outside its range.
    #[error("{key} = {value}: must be {range} (see configs/default.toml)")]
    OutOfRange {
        /// Name of the setting, as `section.key`.
        key: &'static str,
        /// The wrong value.
        value: String,
        /// The allowed range.
        range: String,
    },
}

impl Config {
    /// Reads a configuration file, if there is one, applies `settings` and checks every value. Each setting is a text
    /// `section.key=value` that overrides the file.
    ///
    /// # Errors
    /// Returns a [`ConfigError`] that names the wrong line of the file or the wrong setting.
    pub fn load(file: Option<&Path>, settings: &[String]) -> Result<Self, ConfigError> {
        let mut table = toml::Table::new();
        if let Some(path) = file {
            let text = std::fs::read_to_string(path)
                .map_err(|source| ConfigError::Unreadable { source, path: path.display().to_string() })?;
            table = read_table(&text).map_err(|e| malformed(path.display().to_string(), &e))?;
        }
        let mut given = toml::Table::new();
        for setting in settings {
            apply_setting(&mut given, setting)?;
            // Each setting is checked at once, so that an error names the wrong setting.
            merged(given.clone())
                .and_then(Self::deserialize)
                .map_err(|e| malformed(format!("--set {setting}"), &e))?;
        }
        let of_all = |e: toml::de::Error| malformed("the configuration".to_owned(), &e);
        for (section, keys) in merged(given).map_err(of_all)? {
            match (table.get_mut(&section), keys) {
                (Some(toml::Value::Table(read)), toml::Value::Table(keys)) => read.extend(keys),
                (_, keys) => drop(table.insert(section, keys)),
            }
        }
        let config = Self::deserialize(table).map_err(of_all)?;
        config.check()?;
        Ok(config)
    }

    /// Returns the sha256 of all values, hexadecimal. Two runs have the same fingerprint exactly if they have the same
    /// configuration.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let bytes = serde_json::to_vec(self).unwrap_or_default();
        hex(&Sha256::digest(bytes))
    }
}

/// Returns bytes as lower-case hexadecimal digits.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn malformed(origin: String, error: &toml::de::Error) -> ConfigError {
    ConfigError::Malformed { origin, problem: error.to_string().trim_end().to_owned() }
}

/// Name of the TOML table `[expert]`. Any setting may be in this table, under the name of its section.
const EXPERT: &str = "expert";

/// Reads the settings of a file. Settings under `[expert.SECTION]` are moved to `[SECTION]`.
fn read_table(text: &str) -> Result<toml::Table, toml::de::Error> {
    // Plain and expert settings are checked before they are merged, because merged settings have no line numbers.
    let checked = |part: Spanned<DeValue<'_>>| {
        Config::deserialize(ValueDeserializer::from(part)).map_err(|mut error| {
            error.set_input(Some(text));
            error
        })
    };
    let mut plain = DeTable::parse(text)?;
    if let Some(expert) = plain.get_mut().remove(EXPERT) {
        checked(expert)?;
    }
    checked(Spanned::new(plain.span(), DeValue::Table(plain.into_inner())))?;
    merged(toml::from_str(text)?)
}

/// Moves the settings of `[expert.SECTION]` to `[SECTION]`. It is an error if both tables have a setting with different
/// values.
fn merged(mut table: toml::Table) -> Result<toml::Table, toml::de::Error> {
    let Some(expert) = table.remove(EXPERT) else { return Ok(table) };
    for (section, keys) in toml::Table::deserialize(expert)? {
        for (key, value) in toml::Table::deserialize(keys)? {
            let plain = table.entry(&section).or_insert_with(|| toml::Table::new().into());
            let plain = plain
                .as_table_mut()
                .ok_or_else(|| toml::de::Error::custom(format!("{section} is no section")))?;
            if let Some(other) = plain.get(&key).filter(|other| **other != value) {
                return Err(toml::de::Error::custom(format!(
                    "{EXPERT}.{section}.{key} = {value}, but {section}.{key} = {other}: give only one of them"
                )));
            }
            plain.insert(key, value);
        }
    }
    Ok(table)
}

/// Adds a setting, `section.key=value`, to a table.
fn apply_setting(table: &mut toml::Table, setting: &str) -> Result<(), ConfigError> {
    let fail = |problem: &str| ConfigError::Malformed {
        origin: format!("--set {setting}"),
        problem: problem.to_owned(),
    };
    let (key, text) = setting.split_once('=').ok_or_else(|| fail("write it as section.key=value"))?;
    // The value is parsed as TOML. If that fails, as for a bare word, the text is taken as a string.
    let value = toml::from_str::<toml::Table>(&format!("v = {text}"))
        .ok()
        .and_then(|mut parsed| parsed.remove("v"))
        .unwrap_or_else(|| toml::Value::String(text.to_owned()));
    let mut parts: Vec<&str> = key.trim().split('.').collect();
    let last = parts.pop().filter(|last| !last.is_empty()).ok_or_else(|| fail("the key is empty"))?;
    let mut at = table;
    for part in parts {
        at = at
            .entry(part)
            .or_insert_with(|| toml::Value::Table(toml::Table::new()))
            .as_table_mut()
            .ok_or_else(|| fail(&format!("{part} is no section")))?;
    }
    at.insert(last.to_owned(), value);
    Ok(())
}

impl Config {
    fn check(&self) -> Result<(), ConfigError> {
        let range = |key: &'static str, value: f64, least: f64, most: f64| {
            if (least..=most).contains(&value) {
                return Ok(());
            }
            let range = format!("{least} to {most}");
            Err(ConfigError::OutOfRange { key, value: value.to_string(), range })
        };
        let solve = &self.solve;
        range("infer.threads", self.infer.threads as f64, 1.0, 256.0)?;
        range("watch.look_s", self.watch.look_s, 0.0, 1.0)?;
        range("watch.sweep_s", self.watch.sweep_s, 0.1, 60.0)?;
        range("keypoints.batch", self.keypoints.batch as f64, 1.0, 256.0)?;
        range("keypoints.min_box_px", self.keypoints.min_box_px, 1.0, 10_000.0)?;
        range("solve.keypoints_as_one", solve.keypoints_as_one, 1.0, 36.0)?;
        for shared in solve.shared_view_sd_deg {
            range("solve.shared_view_sd_deg", shared, 0.0, 30.0)?;
        }
        range("solve.mean_elevation_error_deg", solve.mean_elevation_error_deg, -30.0, 30.0)?;
        range("solve.focal_prior_ratio", solve.focal_prior_ratio, 0.1, 20.0)?;
        range("solve.focal_prior_log_sd", solve.focal_prior_log_sd, 0.01, 10.0)?;
        range("solve.tilt_prior_deg", solve.tilt_prior_deg, -90.0, 90.0)?;
        range("solve.tilt_prior_sd_deg", solve.tilt_prior_sd_deg, 0.1, 180.0)?;
        range("solve.roll_prior_sd_deg", solve.roll_prior_sd_deg, 0.1, 180.0)?;
        range("solve.height_prior_m", solve.height_prior_m, 0.5, 500.0)?;
        range("solve.height_prior_log_sd", solve.height_prior_log_sd, 0.01, 10.0)?;
        range("solve.outlier_sd", solve.outlier_sd, 1.0, 100.0)?;
        range("solve.min_inliers", solve.min_inliers as f64, 4.0, 36.0)?;
        range("solve.min_inlier_share", solve.min_inlier_share, 0.0, 1.0)?;
        range("solve.min_keypoint_score", solve.min_keypoint_score, 0.0, 1.0)?;
        range("solve.min_box_overlap", solve.min_box_overlap, 0.0, 1.0)?;
        range("solve.max_rms_share", solve.max_rms_share, 0.0, 1.0)?;
        let track = &self.track;
        range("track.min_observed", track.min_observed as f64, 1.0, 10_000.0)?;
        range("track.min_exists_p", track.min_exists_p, 0.0, 1.0)?;
        range("calibrate.window_s", self.calibrate.window_s, 0.1, 86_400.0)?;
        range("pipeline.buffer_mib", self.pipeline.buffer_mib as f64, 1.0, 65_536.0)?;
        range("output.report_mib", self.output.report_mib, 0.0, 256.0)?;
        range("output.sample_frames", self.output.sample_frames as f64, 0.0, 64.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEFAULT: &str = include_str!("../../../configs/default.toml");

    #[test]
    fn the_documented_defaults_are_the_defaults() {
        let table = read_table(DEFAULT).unwrap();
        assert_eq!(Config::deserialize(table.clone()).unwrap(), Config::default());
        // The file also lists every field.
        let all = toml::Table::try_from(Config::default()).unwrap();
        for (section, fields) in &all {
            for field in fields.as_table().unwrap().keys() {
                assert!(table[section].as_table().unwrap().contains_key(field), "{section}.{field}");
            }
        }
    }

    #[test]
    fn presets_are_valid() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        for entry in std::fs::read_dir(folder).unwrap() {
            Config::load(Some(&entry.unwrap().path()), &[]).unwrap();
        }
    }

    #[test]
    fn settings_override_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("c.toml");
        std::fs::write(&file, "[detect]\nmin_score = 0.5\n").unwrap();
        let settings = ["detect.min_score=0.6".to_owned(), "infer.provider=cpu".to_owned()];
        let config = Config::load(Some(&file), &settings).unwrap();
        assert!((config.detect.min_score - 0.6).abs() < 1e-12);
        assert_eq!(config.infer.provider, ProviderChoice::Cpu);
        assert_ne!(config.fingerprint(), Config::default().fingerprint());
    }

    #[test]
    fn expert_settings_have_two_names() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("c.toml");
        let load = |text: &str, settings: &[&str]| {
            std::fs::write(&file, text).unwrap();
            let settings: Vec<String> = settings.iter().map(ToString::to_string).collect();
            Config::load(Some(&file), &settings).map_err(|error| error.to_string())
        };
        let look_s = |text: &str, settings: &[&str]| load(text, settings).unwrap().watch.look_s;
        let (plain, expert) = ("[watch]\nlook_s = 0.2\n", "[expert.watch]\nlook_s = 0.2\n");
        assert_eq!(load(plain, &[]), load(expert, &[]));
        assert_eq!(look_s(&format!("{expert}{plain}attention = false"), &[]), 0.2);
        // The command line takes precedence over the file, whichever name of the setting is used.
        for text in [plain, expert] {
            assert_eq!(look_s(text, &["watch.look_s=0.3"]), 0.3);
            assert_eq!(look_s(text, &["expert.watch.look_s=0.3", "watch.look_s=0.3"]), 0.3);
        }
        let both = load(&format!("[watch]\nlook_s = 0.3\n{expert}"), &[]).unwrap_err();
        assert!(both.contains("expert.watch.look_s = 0.2, but watch.look_s = 0.3"), "{both}");
        let both = load("", &["watch.look_s=0.3", "expert.watch.look_s=0.2"]).unwrap_err();
        assert!(
            both.contains("--set expert.watch.look_s=0.2") && both.contains("watch.look_s = 0.3"),
            "{both}"
        );
        for (unknown, line) in
            [("[watch]\n[expert.watch]\nlok_s = 1\n", 3), ("[expert.wach]\nlook_s = 1\n", 1)]
        {
            let text = load(unknown, &[]).unwrap_err();
            assert!(text.contains(&format!("line {line}")) && text.contains("unknown field"), "{text}");
        }
        assert!(load("", &["expert.watch.lok_s=1"]).unwrap_err().contains("unknown field `lok_s`"));
        for wrong in ["expert = 1\n", "[expert.expert.watch]\nlook_s = 0.2\n", "[expert]\nwatch = 1\n"] {
            load(wrong, &[]).unwrap_err();
        }
        // The configuration in the results has no `expert` table.
        assert!(serde_json::to_value(load(expert, &[]).unwrap()).unwrap().get("expert").is_none());
    }

    #[test]
    fn errors_name_line_key_and_setting() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("c.toml");
        std::fs::write(&file, "[detect]\nmin_score = 0.5\nmin_scroe = 0.1\n").unwrap();
        let text = Config::load(Some(&file), &[]).unwrap_err().to_string();
        assert!(
            text.contains("line 3") && text.contains("min_scroe") && text.contains("min_score"),
            "{text}"
        );
        let text = Config::load(None, &["solve.outlier_sd=-1".to_owned()]).unwrap_err().to_string();
        assert!(text.contains("solve.outlier_sd = -1") && text.contains("1 to 100"), "{text}");
        for wrong in ["nonsense", "=1", "detect.min_score=high", "detect.min_score.x=1", "nowhere.x=1"] {
            let text = Config::load(None, &[wrong.to_owned()]).unwrap_err().to_string();
            assert!(text.contains(wrong), "{text}");
        }
    }
}
