//! Scores the speeds of finished runs against measured times between two gates, or against rendered truth.
//!
//! A *passing* is a vehicle that needed a measured time for a given distance, so its mean speed is given. The speed of a
//! run is the mean speed of the vehicle's track in the same time. All tracks of a clip share the error of the camera, so
//! the table has one row per run. Its interval of all runs comes from resampling runs.

mod gates;
mod rendered;

use std::path::{Path, PathBuf};

use roadplane_base::TrackRow;
use roadplane_metrics::truth::read_truth;
use roadplane_tables::{Cell, Column, Report, Table, bootstrap_scenes, median};

use crate::LabError;
use crate::finished_run::FinishedRun;

/// One vehicle on a given distance.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Passing {
    /// Time at the begin and the end of the distance, s.
    span_s: [f64; 2],
    /// Length of the distance, m.
    distance_m: f64,
    /// Number of the vehicle's track; `None` if no track follows the vehicle over the whole distance.
    track: Option<u64>,
}

/// The true and the estimated mean speed of a vehicle, with the claimed sd, m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SpeedPair {
    truth_mps: f64,
    found_mps: f64,
    sd_mps: f64,
}

/// The passings of one run.
struct RunSpeeds {
    name: String,
    passings: usize,
    pairs: Vec<SpeedPair>,
}

/// Measured speeds: the kind of file, and its path for each run.
#[derive(Clone, Debug)]
pub enum MeasuredSpeeds {
    /// Truth files of rendered clips. A passing is a distance of this length, m.
    Truth {
        /// Path of each run's file.
        files: Vec<PathBuf>,
        /// Length of the distances, m.
        distance_m: f64,
    },
    /// CSV files of passings between the gates of `roadplane traffic`.
    Passings {
        /// Path of each run's file.
        files: Vec<PathBuf>,
        /// Output folder of `roadplane traffic`; `None` for the folder `traffic` of each run.
        traffic: Option<PathBuf>,
    },
}

/// Scores the speeds of finished runs. `measured` has one file for each of the folders `runs`.
///
/// # Errors
/// [`LabError`] if a file cannot be read, or if the numbers of runs and files differ.
pub fn evaluate_speeds(runs: &[PathBuf], measured: &MeasuredSpeeds) -> Result<Report, LabError> {
    let (MeasuredSpeeds::Truth { files, .. } | MeasuredSpeeds::Passings { files, .. }) = measured;
    if runs.len() != files.len() {
        let what = format!("{} runs and {} files: give one file for each run", runs.len(), files.len());
        return Err(LabError::unsuitable(what));
    }
    let mut scored = Vec::new();
    for (folder, file) in runs.iter().zip(files) {
        let run = FinishedRun::read(folder)?;
        let passings = match measured {
            MeasuredSpeeds::Truth { distance_m, .. } => {
                rendered::passings(&run, &read_truth(file)?, *distance_m)
            }
            MeasuredSpeeds::Passings { traffic, .. } => {
                let traffic = traffic.clone().unwrap_or_else(|| folder.join("traffic"));
                gates::passings(&name_of(folder), &traffic, file)?
            }
        };
        let pairs = passings.iter().filter_map(|passing| pair(passing, &run.rows)).collect();
        scored.push(RunSpeeds { name: name_of(folder), passings: passings.len(), pairs });
    }
    let tables = vec![table(&scored)];
    Ok(Report { title: "Speeds".to_owned(), tables, ..Report::default() })
}

/// Compares the measured mean speed with that of the track; `None` without a track, or without rows in that time.
fn pair(passing: &Passing, rows: &[TrackRow]) -> Option<SpeedPair> {
    let [from_s, to_s] = passing.span_s;
    let is_here = |row: &&TrackRow| Some(row.track) == passing.track && (from_s..=to_s).contains(&row.time_s);
    let (mut speed, mut sd, mut count) = (0.0, 0.0, 0.0);
    for row in rows.iter().filter(is_here) {
        speed += row.speed_mps.abs();
        sd += row.speed_sd_mps;
        count += 1.0;
    }
    (count > 0.0).then(|| SpeedPair {
        truth_mps: passing.distance_m / (to_s - from_s),
        found_mps: speed / count,
        // The errors of a track's speeds are nearly the same over such a distance, so their mean has the same sd.
        sd_mps: sd / count,
    })
}

/// Returns the table of errors, one row per run and one of all runs.
fn table(runs: &[RunSpeeds]) -> Table {
    let columns = [
        ("run", 0),
        ("passings", 0),
        ("with a track", 0),
        ("true speed, km/h", 1),
        ("bias, %", 2),
        ("error, km/h", 2),
        ("90 % within, km/h", 2),
        ("normalised error", 2),
    ];
    let mut table = Table::new(
        "Speeds of vehicles",
        "Mean speed over a given distance, and mean speed of the track in the same time. Bias: median of the relative \
         errors; in the last row, median of the runs' absolute biases. Error: median of its size. Normalised error: \
         root mean square of errors in claimed sds. 95 % intervals by resampling runs.",
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    );
    for run in runs {
        let pairs = &run.pairs;
        table.rows.push(vec![
            run.name.as_str().into(),
            (run.passings as f64).into(),
            (pairs.len() as f64).into(),
            median_of(pairs, |pair| 3.6 * pair.truth_mps).into(),
            bias(pairs).into(),
            median_of(pairs, error_kmh).into(),
            quantile(pairs, 0.9).into(),
            normalised(pairs).into(),
        ]);
    }
    if runs.len() > 1 {
        let of = |statistic: &dyn Fn(&[SpeedPair]) -> f64| -> Cell {
            let all = |runs: &[&RunSpeeds]| -> f64 {
                statistic(&runs.iter().flat_map(|run| run.pairs.clone()).collect::<Vec<_>>())
            };
            bootstrap_scenes(runs, runs.len(), all).into()
        };
        let of_runs = |runs: &[&RunSpeeds]| {
            let biases = runs.iter().map(|run| bias(&run.pairs).abs()).filter(|bias| bias.is_finite());
            median(&biases.collect::<Vec<_>>())
        };
        table.rows.push(vec![
            "all".into(),
            runs.iter().map(|run| run.passings as f64).sum::<f64>().into(),
            runs.iter().map(|run| run.pairs.len() as f64).sum::<f64>().into(),
            of(&|pairs| median_of(pairs, |pair| 3.6 * pair.truth_mps)),
            bootstrap_scenes(runs, runs.len(), of_runs).into(),
            of(&|pairs| median_of(pairs, error_kmh)),
            of(&|pairs| quantile(pairs, 0.9)),
            of(&normalised),
        ]);
    }
    table
}

fn error_kmh(pair: &SpeedPair) -> f64 {
    3.6 * (pair.found_mps - pair.truth_mps).abs()
}

fn median_of(pairs: &[SpeedPair], of: impl Fn(&SpeedPair) -> f64) -> f64 {
    median(&pairs.iter().map(of).collect::<Vec<_>>())
}

/// Returns the median of the relative errors, %.
fn bias(pairs: &[SpeedPair]) -> f64 {
    median_of(pairs, |pair| 100.0 * (pair.found_mps / pair.truth_mps - 1.0))
}

/// Returns the error below which a share of the errors lies, km/h.
fn quantile(pairs: &[SpeedPair], share: f64) -> f64 {
    let mut errors: Vec<f64> = pairs.iter().map(error_kmh).collect();
    errors.sort_by(f64::total_cmp);
    let at = (share * errors.len() as f64).ceil() as usize;
    errors.get(at.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

/// Returns the root mean square of the errors in claimed sds.
fn normalised(pairs: &[SpeedPair]) -> f64 {
    let square = |pair: &SpeedPair| ((pair.found_mps - pair.truth_mps) / pair.sd_mps.max(1e-9)).powi(2);
    (pairs.iter().map(square).sum::<f64>() / pairs.len() as f64).sqrt()
}

fn name_of(folder: &Path) -> String {
    folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_given_speeds() {
        let pair = |found_mps: f64| SpeedPair { truth_mps: 10.0, found_mps, sd_mps: 0.5 };
        let pairs = [pair(10.5), pair(9.5), pair(10.2), pair(11.0)];
        assert!((bias(&pairs) - 3.5).abs() < 1e-9);
        assert!((quantile(&pairs, 0.9) - 3.6).abs() < 1e-9);
        assert!((normalised(&pairs) - (6.16_f64 / 4.0).sqrt()).abs() < 1e-9);
        assert!(bias(&[]).is_nan() && quantile(&[], 0.9).is_nan());
    }
}
