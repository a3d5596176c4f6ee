//! Configuration: TOML file + `--set key=value` → [`Config`], checked once here. `configs/default.toml` documents
//! every field with unit and range and a test keeps it equal to the defaults.

use std::path::{Path, PathBuf};

use roadplane_decode::DecodeOptions;
use roadplane_detect::DetectOptions;
use roadplane_infer::ProviderChoice;
use roadplane_keypoints::KeypointOptions;
use roadplane_solve::{CameraPrior, OutlierModel, SceneOptions, ViewErrors};
use roadplane_track::TrackOptions;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use thiserror::Error;

/// All settings. Sections of stages belong to their crates; `[solve]` and `[calibrate]` are here, as theirs know no serde.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What is read of an input, and limits.
    pub decode: DecodeOptions,
    /// Where nets run.
    pub infer: InferConfig,
    /// Which nets.
    pub models: ModelsConfig,
    /// When and where pictures are looked at.
    pub watch: WatchConfig,
    /// How vehicles are found.
    pub detect: DetectOptions,
    /// How keypoints are found.
    pub keypoints: KeypointOptions,
    /// How cameras and cars are solved.
    pub solve: SolveConfig,
    /// How the camera is followed over the clip.
    pub calibrate: CalibrateConfig,
    /// How cars are followed.
    pub track: TrackOptions,
    /// What the tracks do.
    pub activity: ActivityConfig,
    /// Threads and memory.
    pub pipeline: PipelineConfig,
    /// What is written besides the contract's files.
    pub output: OutputConfig,
}

/// `[infer]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InferConfig {
    /// What computes.
    pub provider: ProviderChoice,
    /// Threads of each net.
    pub threads: usize,
}

impl Default for InferConfig {
    fn default() -> Self {
        Self { provider: ProviderChoice::Auto, threads: 1 }
    }
}

/// `[models]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelsConfig {
    /// Folder; absent: found beside the program.
    pub folder: Option<PathBuf>,
    /// Card of the detector, within the folder.
    pub detector: PathBuf,
    /// Card of the keypoint net, within the folder.
    pub keypoints: PathBuf,
    /// Card of the activity net, within the folder.
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

/// `[watch]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WatchConfig {
    /// Whether the nets look at what changed only, and only as often as motion needs; otherwise at everything in every frame.
    pub attention: bool,
    /// Time from look to look, s; the detector looks at small pictures more often, as each look costs less.
    pub look_s: f64,
    /// Time in which the detector sweeps over the whole picture, changed or not, s.
    pub sweep_s: f64,
}

impl Default for WatchConfig {
    fn default() -> Self {
        Self { attention: true, look_s: 0.11, sweep_s: 4.0 }
    }
}

/// `[activity]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ActivityConfig {
    /// Whether tracks are told what they do.
    pub enabled: bool,
}

impl Default for ActivityConfig {
    fn default() -> Self {
        Self { enabled: true }
    }
}

/// `[pipeline]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PipelineConfig {
    /// Memory for frames on their way between stages, MiB.
    pub buffer_mib: u64,
}

impl Default for PipelineConfig {
    fn default() -> Self {
        Self { buffer_mib: 128 }
    }
}

/// `[calibrate]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrateConfig {
    /// Length of the windows that are solved jointly, s.
    pub window_s: f64,
}

impl Default for CalibrateConfig {
    fn default() -> Self {
        Self { window_s: 30.0 }
    }
}

/// `[output]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputConfig {
    /// Frames with overlays in the report.
    pub sample_frames: usize,
    /// About how large the report may become, MiB: what of the pictures can be played in it. 0: none.
    pub report_mib: f64,
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self { sample_frames: 3, report_mib: 8.0 }
    }
}

/// `[solve]`: what the solver takes for granted of cameras, and when it gives a car up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolveConfig {
    /// So many keypoints of a car are off together as one, from 1.
    pub keypoints_as_one: f64,
    /// How far off nets see all cars of a place: their elevation (the angle at which they are seen from above) and their turn about
    /// the line of sight, sds, degrees, from 0.
    pub shared_view_sd_deg: [f64; 2],
    /// Median focal length beforehand, in units of the longer image side.
    pub focal_prior_ratio: f64,
    /// sd of its logarithm.
    pub focal_prior_log_sd: f64,
    /// Mean tilt beforehand, degrees.
    pub tilt_prior_deg: f64,
    /// Its sd, degrees.
    pub tilt_prior_sd_deg: f64,
    /// sd of the roll around 0 beforehand, degrees.
    pub roll_prior_sd_deg: f64,
    /// Median camera height beforehand, m.
    pub height_prior_m: f64,
    /// sd of its logarithm.
    pub height_prior_log_sd: f64,
    /// Keypoints further off than this many sd are more likely wrong than right.
    pub outlier_sd: f64,
    /// Cars with fewer right keypoints are left out.
    pub min_inliers: usize,
    /// Cars with a smaller share of right keypoints are left out.
    pub min_inlier_share: f64,
    /// Keypoints with a lower score are not used.
    pub min_keypoint_score: f64,
    /// Cars whose projected box overlaps the detected one less (intersection over union) are left out.
    pub min_box_overlap: f64,
    /// Cars whose keypoints are off by more than this share of the box's longer side (rms) are left out.
    pub max_rms_share: f64,
    /// Vertical lines of the scene speak of the focal length, where it shows some.
    pub use_verticals: bool,
    /// Cars that point the same way are parallel, which speaks of the focal length.
    pub use_parallel: bool,
    /// Long edges of the scene tell how the lens bends lines; otherwise pictures are taken for straight.
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
            min_keypoint_score: 0.3,
            min_box_overlap: 0.5,
            max_rms_share: 0.07,
            use_verticals: true,
            use_parallel: true,
            use_lens: true,
        }
    }
}

impl SolveConfig {
    /// Whether edges of the scene are of use.
    #[must_use]
    pub fn reads_scene(&self) -> bool {
        self.use_verticals || self.use_lens
    }

    /// The solver's options.
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
                shared_sd: [elevation, turn, 0.0, 0.0, 0.0],
            }),
            ..SceneOptions::default()
        }
    }
}

/// What is wrong with a configuration.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration: {source}: {path}")]
    Unreadable {
        /// Why.
        source: std::io::Error,
        /// The file.
        path: String,
    },
    /// Not TOML, an unknown key, or a value of a wrong type; the text shows line and column.
    #[error("in {origin}: {problem}")]
    Malformed {
        /// The file, or `--set …`.
        origin: String,
        /// What the parser says.
        problem: String,
    },
    /// A value out of its range.
    #[error("{key} = {value}: must be {range} (see configs/default.toml)")]
    OutOfRange {
        /// Dotted key.
        key: &'static str,
        /// The value given.
        value: String,
        /// What is allowed.
        range: String,
    },
}

impl Config {
    /// Reads a file (if any), applies `key=value` settings over it and checks every value.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line, or the setting, that is wrong.
    pub fn load(file: Option<&Path>, settings: &[String]) -> Result<Self, ConfigError> {
        let mut table = toml::Table::new();
        if let Some(path) = file {
            let text = std::fs::read_to_string(path)
                .map_err(|source| ConfigError::Unreadable { source, path: path.display().to_string() })?;
            // Read the file on its own first: only so can an error show its line.
            toml::from_str::<Self>(&text).map_err(|e| malformed(path.display().to_string(), &e))?;
            table = toml::from_str(&text).map_err(|e| malformed(path.display().to_string(), &e))?;
        }
        for setting in settings {
            apply_setting(&mut table, setting)?;
            // After each one, so that the error names the setting at fault.
            Self::deserialize(table.clone()).map_err(|e| malformed(format!("--set {setting}"), &e))?;
        }
        let config = Self::deserialize(table).map_err(|e| malformed("the configuration".to_owned(), &e))?;
        config.check()?;
        Ok(config)
    }

    /// sha256 (hex) of the resolved values: equal exactly when two runs were configured alike.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let bytes = serde_json::to_vec(self).unwrap_or_default();
        hex(&Sha256::digest(bytes))
    }
}

/// Lower-case hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn malformed(origin: String, error: &toml::de::Error) -> ConfigError {
    ConfigError::Malformed { origin, problem: error.to_string().trim_end().to_owned() }
}

fn apply_setting(table: &mut toml::Table, setting: &str) -> Result<(), ConfigError> {
    let fail = |problem: &str| ConfigError::Malformed {
        origin: format!("--set {setting}"),
        problem: problem.to_owned(),
    };
    let (key, text) = setting.split_once('=').ok_or_else(|| fail("write it as section.key=value"))?;
    // `value` is TOML; a bare word is taken as a string.
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
        range("track.birth_score", track.birth_score, 0.0, 1.0)?;
        range("track.confirm_hits", track.confirm_hits as f64, 1.0, 1000.0)?;
        range("track.confirm_frames", track.confirm_frames as f64, 1.0, 1000.0)?;
        range("track.min_observed", track.min_observed as f64, 1.0, 10_000.0)?;
        range("track.min_duty", track.min_duty, 0.0, 1.0)?;
        range("track.max_coast_s", track.max_coast_s, 0.0, 3600.0)?;
        range("track.max_parked_coast_s", track.max_parked_coast_s, 0.0, 86_400.0)?;
        range("track.gate", track.gate, 1.0, 1000.0)?;
        range("track.min_position_sd_m", track.min_position_sd_m, 1e-4, 10.0)?;
        range("track.min_heading_sd_rad", track.min_heading_sd_rad, 1e-4, 1.0)?;
        range("track.bias_share", track.bias_share, 0.0, 1.0)?;
        range("track.min_motion_m", track.min_motion_m, 0.01, 100.0)?;
        range("track.speed_change", track.speed_change, 0.01, 100.0)?;
        range("track.curvature_change", track.curvature_change, 1e-3, 10.0)?;
        range("track.curvature_sd", track.curvature_sd, 1e-3, 10.0)?;
        range("track.slip_m", track.slip_m, 1e-3, 10.0)?;
        range("track.half_wheelbase_m", track.half_wheelbase_m, 0.1, 10.0)?;
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
        let documented: Config = toml::from_str(DEFAULT).unwrap();
        assert_eq!(documented, Config::default());
        // And every field is documented: nothing is left to a default in the file.
        let table: toml::Table = toml::from_str(DEFAULT).unwrap();
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
