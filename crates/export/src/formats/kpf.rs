//! KPF, the KWIVER packet format of the data sets VIRAT and MEVA. Each line of a file is a packet: a YAML map.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use roadplane_write::WriteError;

use super::actev::activity_name;
use super::files::write_text;
use crate::Run;

/// Value of `src` in every packet: the name of the program that writes the packet.
const SOURCE: &str = "roadplane";

/// Writes three files: `geom` packets (boxes in frames), `types` packets (classes of tracks) and `act` packets
/// (activities).
///
/// If the run did not label activities, the third file has no packets.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let meta = format!("- {{ meta: \"{} of {}\" }}\n", run.name, run.media);
    let file = |kind: &str| folder.join(format!("{}.{kind}.yml", run.name));
    write_text(&file("geom"), &(meta.clone() + &geom(run)))?;
    write_text(&file("types"), &(meta.clone() + &types(run)))?;
    let activities = match &run.events {
        Some(_) => activities(run),
        None => "- { meta: \"the run did not look for activities\" }\n".to_owned(),
    };
    write_text(&file("activities"), &(meta + &activities))
}

fn geom(run: &Run) -> String {
    let mut text = String::new();
    for (id, (_, row)) in run.rows().into_iter().enumerate() {
        let [x0, y0, x1, y1] = row.bbox_px;
        let _infallible = writeln!(
            text,
            "- {{ geom: {{ id1: {}, id0: {id}, ts0: {}, ts1: {:.6}, g0: {x0:.2} {y0:.2} {x1:.2} {y1:.2}, conf0: {:.4}, src: {SOURCE} }} }}",
            row.track, row.frame, row.time_s, row.score
        );
    }
    text
}

fn types(run: &Run) -> String {
    let mut text = String::new();
    for track in &run.tracks {
        let _infallible = writeln!(text, "- {{ types: {{ id1: {}, cset3: {{ Vehicle: 1.0 }} }} }}", track.id);
    }
    text
}

fn activities(run: &Run) -> String {
    let mut text = String::new();
    let ends: BTreeMap<u64, [u64; 2]> = run
        .tracks
        .iter()
        .filter_map(|track| Some((track.id, [track.rows.first()?.frame, track.rows.last()?.frame])))
        .collect();
    for (id, event) in run.events.iter().flatten().enumerate() {
        let [first, last] = ends.get(&event.track).copied().unwrap_or([0, run.frames]);
        let from = run.frame_at(event.from_s).clamp(first, last);
        let to = run.frame_at(event.to_s).clamp(from, last);
        let span = format!("timespan: [{{ tsr0: [{from}, {to}] }}]");
        let _infallible = writeln!(
            text,
            "- {{ act: {{ act2: {{ {}: {:.4} }}, id2: {id}, {span}, src: {SOURCE}, actors: [{{ id1: {}, {span} }}] }} }}",
            activity_name(&event.activity),
            event.confidence,
            event.track
        );
    }
    text
}
