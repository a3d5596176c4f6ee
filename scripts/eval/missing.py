"""Counts the vehicles that a finished run misses, by reason: no box, a box without a track, a track elsewhere.

  python3 scripts/eval/missing.py TRUTH RUN

TRUTH is a file of roadplane.truth/1. RUN is a folder with `frames.jsonl` (`roadplane run --frames`) and `tracks.jsonl`,
or the output of `roadplane stage detect`, for which boxes alone are counted. Vehicles count as for `roadplane-lab eval
run`. A box belongs to a vehicle if it overlaps its visible part, or all of it, by half or more. The second table counts
unobstructed vehicles, as a measure of how easy they are to detect.
"""

from __future__ import annotations

import gzip
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np

LEAST_SIDE_PX, LEAST_SHARE = 24.0, 0.3  # as in `roadplane-lab eval run`
LEAST_IOU = 0.5
FAR_M = 4.0  # as in HOTA
WHOLE_SHARE, WHOLE_PX = 0.85, (40.0, 300.0)  # unobstructed vehicles: longer side
REASONS = ("found", "elsewhere", "box, no track", "no box")


def lines(path: Path) -> list[dict]:
    """Returns the records of a file of JSON lines; none if there is no such file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def overlaps(box: list[float], others: np.ndarray) -> np.ndarray:
    """Returns the intersection over union of a box with others (n, 4)."""
    inner = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    both = inner.clip(0).prod(1)
    return both / (np.prod(np.subtract(box[2:], box[:2])) + (others[:, 2:] - others[:, :2]).prod(1) - both)


def same(car: dict, boxes: np.ndarray) -> np.ndarray:
    """Returns which boxes (n, 4) belong to the vehicle."""
    return np.maximum(overlaps(car["box"], boxes), overlaps(car["whole_box"], boxes)) >= LEAST_IOU


def reason(car: dict, boxes: np.ndarray, rows: list[dict]) -> str:
    """Returns the outcome for a vehicle in a frame."""
    tracked = np.array([row["bbox_px"] for row in rows]).reshape(-1, 4)
    mine = same(car, tracked)
    if mine.any():
        place = np.array([[row["x_m"], row["y_m"]] for row, is_mine in zip(rows, mine, strict=True) if is_mine])
        away = np.linalg.norm(place - [car["world_from_car"][0][3], car["world_from_car"][1][3]], axis=1)
        return "found" if away.min() < FAR_M else "elsewhere"
    return "box, no track" if same(car, boxes).any() else "no box"


def side(box: list[float]) -> float:
    """Returns the longer side, px."""
    return max(box[2] - box[0], box[3] - box[1])


def table(counts: Counter, columns: tuple[str, ...]) -> None:
    """Prints a line per class, with a column per outcome."""
    print("class   " + "".join(f"{name:>15s}" for name in columns))
    for kind in sorted({kind for kind, _ in counts}):
        row = [counts[kind, name] for name in columns]
        print(f"{kind:8s}" + "".join(f"{n:7d} ({100 * n / max(sum(row), 1):3.0f} %)" for n in row))


def main() -> None:
    """Prints the tables."""
    truth_path, run = Path(sys.argv[1]), Path(sys.argv[2])
    opened = gzip.open if truth_path.suffix == ".gz" else open
    with opened(truth_path, "rt") as file:
        truth = json.load(file)
    kinds = {model["id"]: model["class"] for model in truth["models"]}
    frames = {frame["frame"]: frame for frame in lines(run / "frames.jsonl" if run.is_dir() else run)}
    tracks: dict[int, list[dict]] = {}
    for row in lines(run / "tracks.jsonl") if run.is_dir() else []:
        tracks.setdefault(row["frame"], []).append(row)
    outcomes, whole = Counter(), Counter()
    for frame in truth["frames"]:
        if frame["frame"] not in frames:
            continue
        boxes = np.array([car["bbox_px"] for car in frames[frame["frame"]]["cars"]]).reshape(-1, 4)
        for car in frame["cars"]:
            kind, long = kinds[car["id"]], side(car["box"])
            if car["visible_share"] >= LEAST_SHARE and long >= LEAST_SIDE_PX:
                outcomes[kind, reason(car, boxes, tracks.get(frame["frame"], []))] += 1
            if car["visible_share"] >= WHOLE_SHARE and WHOLE_PX[0] <= long <= WHOLE_PX[1]:
                whole[kind, "box" if same(car, boxes).any() else "no box"] += 1
    if tracks:
        print("Vehicles in frames")
        table(outcomes, REASONS)
    print("Unobstructed vehicles, 40–300 px")
    table(whole, ("box", "no box"))


if __name__ == "__main__":
    main()
