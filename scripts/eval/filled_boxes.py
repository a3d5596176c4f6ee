#!/usr/bin/env python3
"""Measures the boxes of rows without a detection: leaves detections out, tracks again, and compares.

    python3 scripts/eval/filled_boxes.py FRAMES... [--every SECONDS] [--binary roadplane]

FRAMES is the `frames.jsonl` of a finished run with `--frames`. 15 % of the detections are left out at random, or with
`--every S` all detections of every fourth interval of S seconds. The table has the mean overlap (intersection over
union) of a detection that was left out with the best filled box of its frame. Detections without such a box (an overlap
below 0.1) are counted.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import subprocess
import tempfile
from collections import defaultdict
from pathlib import Path

from boxes import overlap

SHARE, MIN_OVERLAP = 0.15, 0.1
EDGES = ("bbox_x0_px", "bbox_y0_px", "bbox_x1_px", "bbox_y1_px")

Boxes = dict[int, list[list[float]]]


def leave_out(frames: Path, every_s: float | None, into: Path) -> Boxes:
    """Writes the frames without some of the detections, and returns these by frame.

    Cars that refer to a detection that was left out are left out, too. They are not compared.
    """
    draws, left_out = random.Random(0), defaultdict(list)
    # The new index of each kept car in its frame.
    index: dict[tuple[int, int], int] = {}
    with frames.open() as lines, into.open("w") as written:
        for frame in map(json.loads, lines):
            kept = []
            is_left_out = every_s is not None and int(frame["time_s"] / every_s) % 4 == 2
            for i, car in enumerate(frame.get("cars") or []):
                is_new = "pose_from" not in car and "held_since" not in car
                references = [key for key in ("pose_from", "seen_after") if key in car]
                if is_new and (draws.random() < SHARE if every_s is None else is_left_out):
                    left_out[frame["frame"]].append(car["bbox_px"])
                elif all(tuple(car[key]) in index for key in references):
                    for key in references:
                        car[key][1] = index[tuple(car[key])]
                    index[frame["frame"], i] = len(kept)
                    kept.append(car)
            frame["cars"] = kept
            if is_left_out:
                frame["weak"] = []
            written.write(json.dumps(frame) + "\n")
    return left_out


def filled_of(tracks: Path) -> Boxes:
    """Returns the boxes of rows without a detection, by frame."""
    filled = defaultdict(list)
    with tracks.open() as rows:
        for row in csv.DictReader(rows):
            if row["observed"] == "false":
                filled[int(row["frame"])].append([float(row[edge]) for edge in EDGES])
    return filled


def main() -> None:
    """Prints a row for each clip, and one for all detections."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", type=Path, nargs="+")
    parser.add_argument("--every", type=float, metavar="SECONDS")
    parser.add_argument("--binary", default="roadplane")
    options = parser.parse_args()
    everything: list[float] = []
    for frames in options.frames:
        with tempfile.TemporaryDirectory() as folder:
            thin, out = Path(folder) / "frames.jsonl", Path(folder) / "tracks"
            left_out = leave_out(frames, options.every, thin)
            call = [options.binary, "stage", "track", thin, "--out", out]
            run = subprocess.run(call, check=False, capture_output=True, text=True)
            if not (out / "tracks.csv").exists():
                raise SystemExit(f"{frames} gives no tracks: {run.stderr.strip()}")
            filled = filled_of(out / "tracks.csv")
        best = [
            max((overlap(box, other) for other in filled.get(frame, [])), default=0.0)
            for frame, boxes in left_out.items()
            for box in boxes
        ]
        found = [value for value in best if value >= MIN_OVERLAP]
        everything += found
        print(row_of(frames.parent.name, found), f"without a box {len(best) - len(found)}")
    print(row_of("all", everything))


def row_of(name: str, overlaps: list[float]) -> str:
    """Returns a row of the table."""
    count = max(len(overlaps), 1)
    shares = " ".join(f"{sum(value > limit for value in overlaps) / count:.0%}" for limit in (0.5, 0.7, 0.8, 0.9))
    return f"{name:30} {len(overlaps):5} boxes, overlap {sum(overlaps) / count:.3f}; over 0.5, 0.7, 0.8, 0.9: {shares}"


if __name__ == "__main__":
    main()
