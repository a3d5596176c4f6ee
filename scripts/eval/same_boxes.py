#!/usr/bin/env python3
"""Compares our tracks with those of SORT, ByteTrack and OC-SORT (`trackers`), from the same boxes, in the picture.

    $(scripts/environment.sh counters) scripts/eval/same_boxes.py RUNS TRUTH... [--tracks FOLDER]

RUNS is the folder of finished runs with `--frames`: RUNS/CLIP/frames.jsonl has the boxes of the detector, also the weak
ones. A truth file is CLIP.truth.json (gzipped or not) or CLIP.vehicles.json. Our tracks are those of FOLDER/CLIP, or
else of the run. `roadplane-lab eval tracks` scores all tracks by the overlap of boxes.

The other trackers start tracks at the detector's threshold. Straight lines fill the gaps of their tracks, as ours have
no gaps either. Vehicles that are hardly visible count for nobody, and neither do filled rows without a vehicle. The
truth's boxes end at the picture's border, as those of the detector do.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import json
import subprocess
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import supervision as sv
from boxes import overlap
from trackers import ByteTrackTracker, OCSORTTracker, SORTTracker

ROOT = Path(__file__).resolve().parents[2]
# The product's threshold, `detect.min_score`.
THRESHOLD = 0.44
# The limits of `roadplane-lab eval`: visible share, and longer side of the box in pixels.
MIN_VISIBLE_SHARE, MIN_SIDE_PX = 0.3, 24.0
MIN_IOU = 0.5
FIGURES = {"HOTA": "HOTA, %", "IDF1": "IDF1, %", "switches": "switches"}

Box = tuple[float, float, float, float]
# Boxes of each frame, by track; the second value is whether the row is filled in.
Rows = dict[int, dict[int, tuple[Box, bool]]]


def inside(box: Box, size: list[float]) -> Box:
    """Returns the part of a box in the picture."""
    return (max(box[0], 0.0), max(box[1], 0.0), min(box[2], size[0]), min(box[3], size[1]))


def truth_of(path: Path, size: list[float]) -> tuple[Rows, dict[int, list[Box]]]:
    """Returns the scored vehicles of a truth file, and the boxes of each frame that do not count."""
    text = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    scored: Rows = {}
    others: dict[int, list[Box]] = defaultdict(list)
    for frame in json.loads(text)["frames"]:
        of_frame = scored.setdefault(frame["frame"], {})
        for vehicle in frame.get("vehicles", frame.get("cars", [])):
            box = inside(tuple(vehicle.get("bbox_px") or vehicle["box"]), size)
            is_large = max(box[2] - box[0], box[3] - box[1]) >= MIN_SIDE_PX
            if is_large and vehicle.get("visible_share", 1.0) >= MIN_VISIBLE_SHARE and vehicle.get("class") != "trailer":
                of_frame[vehicle["id"]] = (box, False)
            else:
                others[frame["frame"]] += [box, tuple(vehicle.get("whole_box", box))]
    return scored, others


def boxes_of(frame: dict, least: float) -> sv.Detections:
    """Returns the detector's boxes of a frame from a score on."""
    boxes = [*(frame.get("cars") or []), *(frame.get("weak") or [])]
    boxes = [box for box in boxes if box["score"] >= least]
    if not boxes:
        return sv.Detections.empty()
    return sv.Detections(
        xyxy=np.array([box["bbox_px"] for box in boxes], float),
        confidence=np.array([box["score"] for box in boxes], float),
        class_id=np.zeros(len(boxes), int),
    )


def peer_rows(name: str, frames: list[dict]) -> Rows:
    """Returns the rows of another tracker."""
    rate = 1 / float(np.median(np.diff([frame["time_s"] for frame in frames])))
    tracker, least = {
        "SORT": lambda: (SORTTracker(frame_rate=rate, track_activation_threshold=THRESHOLD), THRESHOLD),
        "ByteTrack": lambda: (
            ByteTrackTracker(frame_rate=rate, track_activation_threshold=THRESHOLD, high_conf_det_threshold=THRESHOLD),
            0.0,
        ),
        "OC-SORT": lambda: (OCSORTTracker(frame_rate=rate, high_conf_det_threshold=THRESHOLD), 0.0),
    }[name]()
    seen: dict[int, dict[int, Box]] = defaultdict(dict)
    for frame in frames:
        tracked = tracker.update(boxes_of(frame, least))
        if len(tracked) and tracked.tracker_id is not None:
            for box, track in zip(tracked.xyxy, tracked.tracker_id, strict=True):
                if track >= 0:
                    seen[int(track)][frame["frame"]] = tuple(map(float, box))
    numbers = [frame["frame"] for frame in frames]
    rows: Rows = {number: {} for number in numbers}
    for track, boxes in seen.items():
        at = sorted(boxes)
        for number in numbers[numbers.index(at[0]) : numbers.index(at[-1]) + 1]:
            if number in boxes:
                rows[number][track] = (boxes[number], False)
            else:
                filled = [float(np.interp(number, at, [boxes[a][edge] for a in at])) for edge in range(4)]
                rows[number][track] = (tuple(filled), True)
    return rows


def our_rows(folder: Path) -> Rows:
    """Returns our rows of a finished run."""
    rows: Rows = defaultdict(dict)
    for row in map(json.loads, (folder / "tracks.jsonl").read_text().splitlines()):
        rows[row["frame"]][row["track"]] = (tuple(row["bbox_px"]), not row["observed"])
    return rows


def kept(rows: Rows, scored: Rows, others: dict[int, list[Box]]) -> Rows:
    """Returns the rows that count."""
    result: Rows = {}
    for frame, truth in scored.items():
        of_frame = result.setdefault(frame, {})
        for track, (box, filled) in rows.get(frame, {}).items():
            is_true = any(overlap(box, other) >= MIN_IOU for other, _ in truth.values())
            is_ignored = filled or any(overlap(box, other) >= MIN_IOU for other in others.get(frame, []))
            if is_true or not is_ignored:
                of_frame[track] = (box, filled)
    return result


def write_mot(rows: Rows, path: Path) -> None:
    """Writes rows as a file of the MOT Challenge."""
    with path.open("w") as lines:
        for frame, boxes in sorted(rows.items()):
            for track, ((x0, y0, x1, y1), _) in sorted(boxes.items()):
                lines.write(f"{frame + 1},{track},{x0},{y0},{x1 - x0},{y1 - y0},1,-1,-1,-1\n")


def score(rows: Rows, truth: Rows, folder: Path) -> dict[str, float]:
    """Returns the figures of a clip's tracks."""
    write_mot(rows, folder / "found.txt")
    write_mot(truth, folder / "truth.txt")
    call = [ROOT / "target/release/roadplane-lab", "eval", "tracks", folder / "found.txt"]
    subprocess.run([*call, "--truth", folder / "truth.txt", "--out", folder / "tables"], check=True, capture_output=True)
    (table,) = (folder / "tables").glob("*.csv")
    (row,) = csv.DictReader(table.open())
    return {name: float(row[column]) for name, column in FIGURES.items()}


def interval(differences: list[float]) -> str:
    """Returns the mean with its interval of 95 %, by resampling clips."""
    draws = np.random.default_rng(0).choice(differences, (4000, len(differences))).mean(axis=1)
    low, high = np.quantile(draws, [0.025, 0.975])
    return f"{np.mean(differences):+6.1f} [{low:+.1f}, {high:+.1f}]"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("truth", type=Path, nargs="+")
    parser.add_argument("--tracks", type=Path)
    options = parser.parse_args()
    found: dict[str, list[dict[str, float]]] = defaultdict(list)
    for path in options.truth:
        name = path.name.split(".truth.")[0].split(".vehicles.")[0]
        frames = list(map(json.loads, (options.runs / name / "frames.jsonl").read_text().splitlines()))
        truth, others = truth_of(path, frames[0]["image_size_px"])
        rows = {"roadplane": our_rows((options.tracks or options.runs) / name)}
        rows |= {peer: peer_rows(peer, frames) for peer in ("SORT", "ByteTrack", "OC-SORT")}
        for tracker, of_tracker in rows.items():
            with tempfile.TemporaryDirectory() as folder:
                found[tracker].append(score(kept(of_tracker, truth, others), truth, Path(folder)))
        print(name, *(f"{t} {s[-1]['HOTA']:.1f} {s[-1]['IDF1']:.1f} {s[-1]['switches']:.0f};" for t, s in found.items()))
    for tracker, scores in found.items():
        words = [f"{figure} {np.mean([s[figure] for s in scores]):5.1f}" for figure in ("HOTA", "IDF1")]
        more = [interval([ours[f] - s[f] for ours, s in zip(found["roadplane"], scores, strict=True)]) for f in ("HOTA", "IDF1")]
        switches = sum(s["switches"] for s in scores)
        print(f"{tracker:10} {', '.join(words)}, switches {switches:3.0f}; ours more: HOTA {more[0]}, IDF1 {more[1]}")


if __name__ == "__main__":
    main()
