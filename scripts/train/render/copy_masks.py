"""Measures how well copied vehicles cover the pixels of the vehicles of a rendered clip; needs no OpenGL.

  roadplane-train render copy-masks SCENE TRUTH

SCENE is a copy of a run on the clip, from the run's camera. TRUTH is the clip's truth file. Its cars are drawn anew:
their base model with the dimensions of the file, whose points are within some 2 cm of the car's own (one in ten: 16
cm).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from roadplane_train.cars.builder import named_cars
from roadplane_train.cars.mesh import CarMesh
from roadplane_train.cars.specs import SPECS

from .camera import Camera
from .copy import Garage, view_of
from .copy_boxes import Meshes

LEAST_SHARE = 0.99  # least visible share of a car
EVERY_S = 0.5  # time between two compared moments


def mask(camera: Camera, mesh: CarMesh, world_from_car: np.ndarray) -> np.ndarray:
    """Returns the visible pixels of a car."""
    covered = np.zeros(camera.image_size_px[::-1], np.uint8)
    pixels, depth = camera.pixel_from_world(mesh.vertices @ world_from_car[:3, :3].T + world_from_car[:3, 3])
    if depth.min() > 0:
        for triangle in np.round(pixels[mesh.faces] * 16).astype(np.int32):
            cv2.fillConvexPoly(covered, triangle, 1, cv2.LINE_8, 4)
    return covered.astype(bool)


def true_meshes(truth: dict) -> dict[int, CarMesh]:
    """Returns the cars of a truth file by number."""
    models = {mesh.name: mesh for split in {spec.split for spec in SPECS} for mesh in named_cars(split)}
    return {car["id"]: Garage.stretched(models[car["model"]], car["dims_m"]) for car in truth["models"] if car["model"] in models}


def main() -> None:
    """Prints the overlap (intersection over union) over all unobstructed cars."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder that roadplane copy wrote")
    parser.add_argument("truth", type=Path, help="truth file of the clip")
    args = parser.parse_args()
    scene, truth = (json.loads(path.read_text()) for path in (args.scene / "scene.json", args.truth))
    camera = Camera.of(truth["camera"])
    view, garage = view_of("same", scene), Garage(Meshes())
    copies = [(vehicle, garage.of(vehicle)) for vehicle in scene["vehicles"]]
    trajectories = [
        np.array([[v["time_s"], v["x_m"], v["y_m"], v["heading_rad"]] for v in vehicle["trajectory"]])
        for vehicle in scene["vehicles"]
    ]
    originals = true_meshes(truth)
    overlaps = []
    for frame in truth["frames"][:: max(1, round(EVERY_S * truth["fps"]))]:
        time_s = frame["time_s"] - scene["span_s"][0]
        there = [
            (mesh, trajectory)
            for (vehicle, mesh), trajectory in zip(copies, trajectories, strict=True)
            if vehicle["span_s"][0] <= time_s <= vehicle["span_s"][1]
        ]
        copied = [
            mask(
                view.camera, mesh, view.place(*(float(np.interp(time_s, trajectory[:, 0], trajectory[:, i])) for i in (1, 2, 3)))
            )
            for mesh, trajectory in there
        ]
        for car in frame["cars"]:
            if car["visible_share"] < LEAST_SHARE or car["id"] not in originals:
                continue
            original = mask(camera, originals[car["id"]], np.array(car["world_from_car"]))
            overlaps.append(max(((original & other).sum() / (original | other).sum() for other in copied), default=0.0))
    print(
        f"{len(overlaps)} masks: overlap {np.median(overlaps):.3f} median, "
        f"{np.quantile(overlaps, 0.1):.3f} at the 10th percentile"
    )


if __name__ == "__main__":
    main()
