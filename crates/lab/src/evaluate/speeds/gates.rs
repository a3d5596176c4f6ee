//! Passings that were measured between two gates of a real video.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::Passing;
use crate::LabError;

/// Table of `roadplane traffic`.
const CROSSINGS: &str = "crossings.csv";
/// Largest difference between a measured time at a gate and that of a track, s.
const SAME_TIME_S: f64 = 0.5;

/// A row of the file of measured passings. Gates have the names of the gates file.
#[derive(Deserialize)]
struct Row {
    from_gate: String,
    to_gate: String,
    distance_m: f64,
    from_s: f64,
    to_s: f64,
}

/// A row of the table `crossings`.
#[derive(Deserialize)]
struct Crossing {
    clip: String,
    track: u64,
    gate: String,
    time_s: f64,
    probability: f64,
}

/// Reads the measured passings of the clip `clip`, and finds the track of each by its times at both gates.
///
/// # Errors
/// [`LabError`] if a file cannot be read or has another form, or if no vehicle of the clip crosses a named gate.
pub(super) fn passings(clip: &str, traffic: &Path, file: &Path) -> Result<Vec<Passing>, LabError> {
    let table = traffic.join(CROSSINGS);
    if !table.is_file() {
        let what = "is missing: first run roadplane traffic RUN --gates FILE --out DIR".to_owned();
        return Err(LabError::malformed(&table, what));
    }
    let crossings: Vec<Crossing> = read(&table)?;
    let mut of_gate: BTreeMap<&str, Vec<&Crossing>> = BTreeMap::new();
    for crossing in crossings.iter().filter(|c| c.clip == clip && c.probability >= 0.5) {
        of_gate.entry(&crossing.gate).or_default().push(crossing);
    }
    let at = |gate: &str| {
        of_gate.get(gate).ok_or_else(|| {
            LabError::malformed(file, format!("no vehicle of {clip} crosses the gate {gate:?}"))
        })
    };
    let mut found = Vec::new();
    for row in read::<Row>(file)? {
        if !(row.distance_m > 0.0 && row.to_s > row.from_s) {
            let what = "distance_m must be positive, and to_s must be after from_s".to_owned();
            return Err(LabError::malformed(file, what));
        }
        let (from, to) = (at(&row.from_gate)?, at(&row.to_gate)?);
        let off = |crossing: &Crossing, time_s: f64| (crossing.time_s - time_s).abs();
        let both = from.iter().flat_map(|a| to.iter().map(move |b| (*a, *b)));
        let same = both.filter(|(a, b)| {
            a.track == b.track && off(a, row.from_s) <= SAME_TIME_S && off(b, row.to_s) <= SAME_TIME_S
        });
        let sum = |(a, b): &(&Crossing, &Crossing)| off(a, row.from_s) + off(b, row.to_s);
        let nearest = same.min_by(|one, other| sum(one).total_cmp(&sum(other)));
        found.push(Passing {
            span_s: [row.from_s, row.to_s],
            distance_m: row.distance_m,
            track: nearest.map(|(a, _)| a.track),
        });
    }
    Ok(found)
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Result<Vec<T>, LabError> {
    let malformed = |error: csv::Error| LabError::malformed(path, error);
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(path).map_err(malformed)?;
    reader.deserialize().collect::<Result<_, _>>().map_err(malformed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_are_found_by_their_times_at_both_gates() {
        let folder = tempfile::tempdir().unwrap();
        let crossings = "clip,track,gate,time_s,probability\nr,1,a,1.0,1\nr,1,b,2.1,1\nr,2,a,1.2,1\nr,2,b,5.0,1\n\
                         r,3,a,9.0,0.2\ns,4,a,1.1,1\ns,4,b,2.0,1\n";
        std::fs::write(folder.path().join(CROSSINGS), crossings).unwrap();
        let file = folder.path().join("passings.csv");
        let text = |rows: &str| format!("from_gate,to_gate,distance_m,from_s,to_s\n{rows}");
        std::fs::write(&file, text("a,b,20,1.1,2.0\na,b,20,9.0,10.0\n")).unwrap();
        let found = passings("r", folder.path(), &file).unwrap();
        assert_eq!(found.iter().map(|passing| passing.track).collect::<Vec<_>>(), [Some(1), None]);
        for broken in ["a,c,20,1.1,2.0\n", "a,b,0,1.1,2.0\n", "a,b,20,2.0,1.0\n", "a,b\n"] {
            std::fs::write(&file, text(broken)).unwrap();
            assert!(passings("r", folder.path(), &file).is_err(), "{broken}");
        }
    }
}
