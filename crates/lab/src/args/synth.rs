//! Arguments of `roadplane-lab synth`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `roadplane-lab synth`.
#[derive(Debug, Args)]
pub struct SynthArgs {
    /// Write into this folder; finished items in it are kept.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of stills: scenes of one frame.
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=100_000))]
    pub stills: u32,
    /// Number of clips with driving cars.
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=10_000))]
    pub clips: u32,
    /// Seed of all random numbers: the same seed gives the same files.
    #[arg(long, default_value_t = 1, value_name = "S")]
    pub seed: u64,
    /// Cars per still and per clip; half of a clip's cars drive.
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=60))]
    pub cars: u16,
    /// Standard deviation of the measured keypoints, as a share of the longer side of the car's box.
    #[arg(long, default_value_t = 0.02, value_name = "SHARE", value_parser = share)]
    pub noise: f64,
    /// Share of the measured keypoints that are gross errors.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE", value_parser = share)]
    pub outliers: f64,
    /// Difference of the cars from the shape atlas, as a multiple of the atlas's own residual on real cars.
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR", value_parser = factor)]
    pub off_atlas: f64,
    /// Length of a clip, s.
    #[arg(long, default_value_t = 12.0, value_name = "S", value_parser = seconds)]
    pub seconds: f64,
    /// Frames per second of a clip.
    #[arg(long, default_value_t = 10.0, value_name = "F", value_parser = rate)]
    pub fps: f64,
}

fn within(text: &str, low: f64, high: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("must be a number from {low} to {high}")),
    }
}

fn share(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1.0)
}

fn factor(text: &str) -> Result<f64, String> {
    within(text, 0.0, 10.0)
}

fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.1, 3600.0)
}

fn rate(text: &str) -> Result<f64, String> {
    within(text, 0.1, 240.0)
}
