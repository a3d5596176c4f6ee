"""Lists implausible events in the tracks of finished runs: invented motion, boxes of other vehicles, duplicates.

  python3 scripts/eval/oddities.py RUN...

Invented motion: between two observations a track moves more than 3 m in more than half a second. Apart: observed rows
whose box overlaps that of the vehicle drawn from the row (its size and pose) by less than 0.3. Duplicates: two tracks
whose positions are closer than 1.5 m for half a second or longer. It lists each event for inspection. It needs the
Python package: `pip install .`.
"""

from __future__ import annotations

import itertools
import sys
from collections import defaultdict

import numpy as np

import roadplane

INVENTED_M, INVENTED_S = 3.0, 0.5
LEAST_IOU = 0.3
NEAR_M, NEAR_S = 1.5, 0.5


def drawn_box(camera: roadplane.Camera, row: dict) -> np.ndarray | None:
    """Returns the box of a body of the row's size at its pose, cut at the picture's edges, px."""
    half = np.array([row["length_m"] / 2, row["width_m"] / 2])
    cos, sin = np.cos(row["heading_rad"]), np.sin(row["heading_rad"])
    corners = np.array([(a, b, z) for a in (-1, 1) for b in (-1, 1) for z in (0.0, 1.0)])
    local = corners[:, :2] * half
    x, y = row["x_m"] + cos * local[:, 0] - sin * local[:, 1], row["y_m"] + sin * local[:, 0] + cos * local[:, 1]
    pixels = camera.project(np.column_stack([x, y, corners[:, 2] * row["height_m"]]))
    if np.isnan(pixels).any():
        return None
    size = np.array(camera.image_size_px) - 0.5
    return np.concatenate([pixels.min(0).clip(-0.5, size), pixels.max(0).clip(-0.5, size)])


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Returns the intersection over union of two boxes."""
    width, height = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    if width <= 0 or height <= 0:
        return 0.0
    areas = [np.prod(box[2:] - box[:2]) for box in (a, b)]
    return float(width * height / (sum(areas) - width * height))


def main() -> None:
    for folder in sys.argv[1:]:
        run = roadplane.load(folder)
        tracks, frames = defaultdict(list), defaultdict(list)
        for row in run.tracks().to_dict("records"):
            tracks[row["track"]].append(row)
            frames[row["frame"]].append(row)
        found = []
        for number, rows in tracks.items():
            observed_rows = [k for k, row in enumerate(rows) if row["observed"]]
            for a, b in itertools.pairwise(observed_rows):
                first, last = rows[a], rows[b]
                moved_m = np.hypot(last["x_m"] - first["x_m"], last["y_m"] - first["y_m"])
                if moved_m > INVENTED_M and last["time_s"] - first["time_s"] > INVENTED_S:
                    span = f"{first['time_s']:.2f}–{last['time_s']:.2f} s"
                    found.append(f"track {number} moves {moved_m:.1f} m unobserved, {span}")
        apart = defaultdict(list)
        observed = 0
        for row in (row for rows in tracks.values() for row in rows if row["observed"]):
            observed += 1
            camera = run.cameras[int(row["segment"])]
            box = drawn_box(camera, row)
            seen = np.array([row[f"bbox_{name}_px"] for name in ("x0", "y0", "x1", "y1")], float)
            if box is not None and overlap(box, seen) < LEAST_IOU:
                apart[row["track"]].append(row["time_s"])
        for number, times in apart.items():
            found.append(f"track {number} is apart from its box in {len(times)} rows from {times[0]:.2f} s on")
        near: dict[tuple[int, int], list[float]] = defaultdict(list)
        for rows in frames.values():
            for a, b in itertools.combinations(rows, 2):
                if np.hypot(a["x_m"] - b["x_m"], a["y_m"] - b["y_m"]) < NEAR_M:
                    near[a["track"], b["track"]].append(a["time_s"])
        for (a, b), times in near.items():
            if times[-1] - times[0] >= NEAR_S:
                found.append(f"tracks {a} and {b} are in one place, {times[0]:.2f}–{times[-1]:.2f} s")
        print(f"{folder}: {len(tracks)} tracks, {observed} rows observed, {len(found)} oddities")
        for text in found:
            print(f"  {text}")


if __name__ == "__main__":
    main()
