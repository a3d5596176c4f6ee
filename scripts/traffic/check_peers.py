#!/usr/bin/env python3
"""Counts the vehicles of `counts.json` with ByteTrack (`trackers`) and LineZone (`supervision`), from the same boxes.

    $(scripts/environment.sh counters) scripts/traffic/check_peers.py RESULTS [--binary FILE]

RESULTS is the folder of finished runs with `--frames`, which keep the detector's boxes, also the weak ones. The table
has the sum over all lines of the deviations from the counts by eye.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import supervision as sv
from check_counts import COUNTS, DIRECTIONS, ROOT, counted
from trackers import ByteTrackTracker

# ByteTrack's own thresholds suit scores that reach 0.9. The second row is the product's threshold.
THRESHOLDS = {"own thresholds": (0.7, 0.6), "thresholds of our detector": (0.44, 0.44)}
ANCHORS = {
    "box": tuple(sv.Position[n] for n in ("TOP_LEFT", "TOP_RIGHT", "BOTTOM_LEFT", "BOTTOM_RIGHT")),
    "bottom": (sv.Position.BOTTOM_CENTER,),
}


def frames_of(run: Path) -> list[dict]:
    """Returns the frames of a run with their boxes."""
    return [json.loads(line) for line in (run / "frames.jsonl").read_text().splitlines()]


def boxes_of(frame: dict) -> sv.Detections:
    """Returns the boxes of a frame, without motorcycles."""
    boxes = [box for box in [*(frame.get("cars") or []), *(frame.get("weak") or [])] if box.get("class") != "motorcycle"]
    if not boxes:
        return sv.Detections.empty()
    return sv.Detections(
        xyxy=np.array([box["bbox_px"] for box in boxes], float),
        confidence=np.array([box["score"] for box in boxes], float),
        class_id=np.zeros(len(boxes), int),
    )


def peer_counts(frames: list[dict], clip: dict, thresholds: tuple[float, float], anchors: tuple) -> dict[tuple[str, str], int]:
    """Returns the counts of the other programs by line and direction."""
    times = [frame["time_s"] for frame in frames]
    activation, high = thresholds
    rate = 1 / float(np.median(np.diff(times)))
    tracker = ByteTrackTracker(frame_rate=rate, track_activation_threshold=activation, high_conf_det_threshold=high)
    zones = {}
    for name, line in clip["lines"].items():
        start, end = (sv.Point(*point) for point in line["line_px"])
        zones[name] = sv.LineZone(start=start, end=end, triggering_anchors=anchors)
    for frame in frames:
        tracked = tracker.update(boxes_of(frame))
        if len(tracked) and tracked.tracker_id is not None:
            tracked = tracked[tracked.tracker_id >= 0]
            for zone in zones.values():
                zone.trigger(tracked)
    # "in" is from the right to the left of the line in the picture, as seen from its start
    found = {}
    for name, zone in zones.items():
        found[name, "forward"], found[name, "backward"] = zone.out_count, zone.in_count
    return found


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/roadplane")
    options = parser.parse_args()
    clips = json.loads(COUNTS.read_text())
    by_eye = {
        (c, line, d): len(clip["lines"][line][d]) for c, clip in clips.items() for line in clip["lines"] for d in DIRECTIONS
    }
    rows: dict[str, dict] = {"roadplane": {}}
    for name, clip in clips.items():
        run = options.results / name
        ours = counted(run, clip, options.binary)
        rows["roadplane"] |= {(name, *key): figures[0] for key, figures in ours.items()}
        frames = frames_of(run)
        for kind, thresholds in THRESHOLDS.items():
            for anchor, anchors in ANCHORS.items():
                found = peer_counts(frames, clip, thresholds, anchors)
                rows.setdefault(f"ByteTrack, {kind}; LineZone, {anchor}", {}).update(
                    {(name, *key): n for key, n in found.items()}
                )
    print(f"{'counts by eye':60} {sum(by_eye.values()):4} vehicles")
    for name, found in rows.items():
        deviations = [found.get(key, 0) - n for key, n in by_eye.items()]
        wrong = sum(d != 0 for d in deviations)
        sums = f"{sum(found.values()):4} vehicles, deviations {sum(map(abs, deviations)):3}"
        print(f"{name:60} {sums}, {wrong:2} of {len(by_eye)} counts wrong")


if __name__ == "__main__":
    main()
