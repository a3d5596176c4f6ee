"""Measures how well copied vehicles fill the boxes of the detector; needs no OpenGL.

roadplane-train render copy-boxes SCENE RUN
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np

from roadplane_train.cars.mesh import CarMesh

from .copy import Garage, view_of

EDGE_PX = 3  # the picture's edge cuts off boxes nearer to it
EVERY = 7  # one vertex of a mesh in so many is enough for its outline


class Meshes:
    """Replaces a renderer where only meshes are needed."""

    def upload(self, mesh: CarMesh) -> CarMesh:
        """Returns the mesh itself."""
        return mesh


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Returns the intersection over union of two boxes (x0, y0, x1, y1)."""
    common = np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0))
    return float(common / (np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - common))


def main() -> None:
    """Prints the overlap over all observed boxes inside the picture, including hidden vehicles."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder that roadplane copy wrote")
    parser.add_argument("run", type=Path, help="folder of the run")
    args = parser.parse_args()
    scene = json.loads((args.scene / "scene.json").read_text())
    view, garage = view_of("same", scene), Garage(Meshes())
    vertices = {vehicle["track"]: garage.of(vehicle).vertices[::EVERY] for vehicle in scene["vehicles"]}
    trajectories = {
        vehicle["track"]: np.array([[v["time_s"], v["x_m"], v["y_m"], v["heading_rad"]] for v in vehicle["trajectory"]])
        for vehicle in scene["vehicles"]
    }
    last = np.array(view.camera.image_size_px) - 1 - EDGE_PX
    overlaps = []
    with (args.run / "tracks.csv").open(newline="") as table:
        for row in csv.DictReader(table):
            box = np.array([float(row[f"bbox_{corner}_px"]) for corner in ("x0", "y0", "x1", "y1")])
            time_s, trajectory = float(row["time_s"]) - scene["span_s"][0], trajectories.get(int(row["track"]))
            if row["observed"] != "true" or trajectory is None or (box[:2] < EDGE_PX).any() or (box[2:] > last).any():
                continue
            pose = view.place(*(float(np.interp(time_s, trajectory[:, 0], trajectory[:, i])) for i in (1, 2, 3)))
            pixels, _ = view.camera.pixel_from_world(vertices[int(row["track"])] @ pose[:3, :3].T + pose[:3, 3])
            overlaps.append(overlap(np.r_[pixels.min(0), pixels.max(0)], box))
    print(
        f"{len(overlaps)} boxes: overlap {np.median(overlaps):.3f} median, "
        f"{np.quantile(overlaps, 0.1):.3f} at the 10th percentile"
    )


if __name__ == "__main__":
    main()
