"""Converts MEVA's activity instances: annotated boxes to tracks on the ground, through the published cameras.

It reads a folder with `activities.csv`, `boxes.parquet` and `krtd/`; the folder's README describes them. The published
focal lengths and lenses are used unchanged.

The published plane z = 0 is not the ground everywhere. Vehicles come out at a third to five times their size, and one
camera was turned later. So the ground is the plane on which the boxes have the size of cars, as in our product. Each
track is then scaled until its own boxes have that size. The position of a vehicle is the point where the ray through
the centre of its box meets that plane, raised by half a car's height.

Most of these cameras view the ground at so flat an angle that box errors would grow twentyfold along the line of sight.
There, motion is scaled to a slope of SLOPE at most.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

RATE_HZ = 30.0
CLASSES = ("starting", "stopping", "turning_left", "turning_right", "u_turn", "reversing")
# Cameras that are never trained on; they have instances of all six classes.
TEST_CAMERAS = ("G336", "G341", "G506", "G639")
PICTURE_PX = (1920.0, 1072.0)
# A car's size in its box: height, extent along the view (from above) and across it, m; sd of a box's edge, of its size.
CAR_M = (1.5, 3.0, 3.2)
EDGE_SD = 0.015
SLOPE = 0.3
# A camera with fewer instances gets z = 0 as its ground.
PLANE_INSTANCES = 50


@dataclass(frozen=True)
class Instance:
    """One labelled interval of one vehicle."""

    clip: str
    camera: str
    activity: str
    time_s: np.ndarray  # (n,)
    xy_m: np.ndarray  # (n, 2) on the ground: x across the line of sight (right), y along it
    sd_m: np.ndarray  # (n, 2)
    boxes_px: np.ndarray  # (n, 4)


def read_krtd(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Reads K, R, T and distortion (five numbers in OpenCV's order)."""
    numbers = np.array(path.read_text().split(), float)
    lens = np.zeros(5)
    lens[: len(numbers[21:26])] = numbers[21:26]
    return numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3), numbers[18:21], lens


def undistorted(points: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Removes the lens's distortion from points (n, 2) at depth 1, as OpenCV's undistortPoints does."""
    k1, k2, p1, p2, k3 = lens
    found = points.copy()
    for _ in range(20):
        x, y = found.T
        r2 = x * x + y * y
        radial = np.clip(1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 0.3, 3.0)
        shift = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], 1)
        found = (points - shift) / radial[:, None]
    return found


def rays_of(boxes: np.ndarray, camera: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Returns rays (n, 3) at depth 1 through the boxes' lower edges, and the boxes' size there (root of area)."""
    k, _, _, lens = camera
    feet = np.stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]], 1)
    at_one = (feet - [k[0, 2], k[1, 2]]) / [k[0, 0], k[1, 1]]
    sides = (boxes[:, 2:] - boxes[:, :2]) / [k[0, 0], k[1, 1]]
    return np.column_stack([undistorted(at_one, lens), np.ones(len(feet))]), np.sqrt(np.maximum(sides.prod(1), 1e-12))


def whole(boxes: np.ndarray) -> np.ndarray:
    """Returns which boxes do not touch the picture's edge."""
    return (boxes[:, :2] > 3).all(1) & (boxes[:, 2:] < np.array(PICTURE_PX) - 3).all(1)


def car_size(slope: np.ndarray) -> np.ndarray:
    """Returns the root of the area of a car's box, m, at a given slope (sine of the angle below the horizontal)."""
    return np.sqrt(CAR_M[2] * (CAR_M[0] * np.sqrt(1 - slope**2) + CAR_M[1] * slope))


def slopes(rays: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Returns the sine of the rays' angles below the horizontal."""
    return np.clip(rays @ down / np.linalg.norm(rays, axis=1), 0.01, 1)


def ground_below(tracks: list[np.ndarray], camera: tuple[np.ndarray, ...]) -> np.ndarray:
    """Fits the ground to the sizes of the boxes.

    Returns g in the camera frame: g · ray is 1 / depth of the point where a ray of depth 1 meets the ground.
    """
    _, r, t, _ = camera
    down, height = -r[:, 2], -(r.T @ t)[2]
    if len(tracks) < PLANE_INSTANCES:
        return down / height
    complete = [boxes[whole(boxes)] for boxes in tracks]
    boxes = np.concatenate([b[[0, len(b) // 2, -1]] for b in complete if len(b)])
    rays, size = rays_of(boxes, camera)
    weight = np.ones(len(boxes))
    for _ in range(30):  # Huber: vehicles other than cars get less weight
        inverse_depth = size / car_size(slopes(rays, down))
        each = weight / inverse_depth
        ground = np.linalg.lstsq(rays * each[:, None], inverse_depth * each, rcond=None)[0]
        down = ground / np.linalg.norm(ground)
        weight = 1 / np.maximum(1, np.abs(np.log(np.maximum(rays @ ground, 1e-4) / inverse_depth)) / 0.15)
    return ground


def ground_track(boxes: np.ndarray, camera: tuple[np.ndarray, ...], ground: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Returns positions (n, 2) of boxes (n, 4) and their sds, m; None for a box at or above the horizon."""
    rays, size = rays_of(boxes, camera)
    middles, _ = rays_of(boxes - [0, 0, 0, 1] * (boxes[:, 3:] - boxes[:, 1:2]) / 2, camera)
    down = ground / np.linalg.norm(ground)
    raised = 1 / np.linalg.norm(ground) - CAR_M[0] / 2  # the plane's distance
    if raised < 1 or (rays @ ground < 1e-4).any() or (middles @ down < 1e-3).any():
        return None
    slope = slopes(rays, down)
    depth = raised / (middles @ down)
    points = middles * depth[:, None]
    flat = points - (points @ down)[:, None] * down
    forward = flat.mean(0) / np.linalg.norm(flat.mean(0))
    xy = np.stack([flat @ np.cross(down, forward), flat @ forward], 1)

    scales = car_size(slope) / (size * depth)
    scale = np.median(scales[whole(boxes)] if whole(boxes).any() else scales)
    across = EDGE_SD * size * depth * scale
    flat_out = min(1.0, float(np.median(slope)) / SLOPE)
    return xy * scale * [1, flat_out], np.stack([across, across / slope * flat_out], 1)


def read_instances(folder: Path) -> list[Instance]:
    """Reads all instances with at least four boxes on the ground."""
    import pyarrow.parquet as parquet

    table = parquet.read_table(folder / "boxes.parquet")
    column = {name: table[name].to_numpy() for name in ("track_id", "frame", "x_min", "y_min", "x_max", "y_max")}
    order = np.lexsort((column["frame"], column["track_id"]))
    ids, starts = np.unique(column["track_id"][order], return_index=True)
    rows = dict(zip(ids.tolist(), np.split(order, starts[1:]), strict=True))
    corners = np.stack([column[name] for name in ("x_min", "y_min", "x_max", "y_max")], 1).astype(float)
    with (folder / "activities.csv").open() as file:
        records = [record for record in csv.DictReader(file) if len(rows.get(int(record["track_id"]), ())) >= 4]
    picks = [rows[int(record["track_id"])] for record in records]
    instances = []
    for name in sorted({record["krtd"] for record in records}):
        camera = read_krtd(folder / "krtd" / name)
        here = [(record, pick) for record, pick in zip(records, picks, strict=True) if record["krtd"] == name]
        ground = ground_below([corners[pick] for _, pick in here], camera)
        for record, pick in here:
            track = ground_track(corners[pick], camera, ground)
            if track is not None:
                about = record["clip"], record["camera"], record["activity"]
                instances.append(Instance(*about, column["frame"][pick] / RATE_HZ, *track, corners[pick]))
    return instances


def write_table(instances: list[Instance], path: Path) -> None:
    """Writes the instances as a table, for `stage activity` and, with labels, for `eval activity`."""
    import pyarrow
    import pyarrow.parquet as parquet

    def rows(values: list[np.ndarray]) -> np.ndarray:
        return np.concatenate(values)

    def repeated(values: list) -> list:
        return [value for value, i in zip(values, instances, strict=True) for _ in i.time_s]

    columns = {
        "track": repeated(list(range(1, len(instances) + 1))),
        "time_s": rows([i.time_s for i in instances]),
        **{name: rows([i.xy_m[:, k] for i in instances]) for k, name in enumerate(("x_m", "y_m"))},
        **{name: rows([i.sd_m[:, k] for i in instances]) for k, name in enumerate(("x_sd_m", "y_sd_m"))},
        **{f"bbox_{name}_px": rows([i.boxes_px[:, k] for i in instances]) for k, name in enumerate(("x0", "y0", "x1", "y1"))},
        "clip": repeated([i.clip for i in instances]),
        "label": repeated([i.activity for i in instances]),
    }
    parquet.write_table(pyarrow.table(columns), path)


def main() -> None:
    import argparse

    parser = argparse.ArgumentParser(description="Writes the instances of the cameras that are never trained on as a table.")
    parser.add_argument("folder", type=Path, help="activities.csv, boxes.parquet, krtd/")
    parser.add_argument("--out", type=Path, required=True, help="FILE.parquet")
    parser.add_argument("--cameras", nargs="*", default=list(TEST_CAMERAS))
    options = parser.parse_args()
    write_table([i for i in read_instances(options.folder) if i.camera in options.cameras], options.out)


if __name__ == "__main__":
    main()
