"""Writes the truth files of the data sets (`roadplane.dataset/1`, `roadplane.truth/1`).

Frames are those of `crates/base/src/lib.rs`, with SI units and radians. Pixel (0, 0) is the centre of the top-left
pixel. Poses are rounded to 1e-6, pixels to 0.01.
"""

from __future__ import annotations

import numpy as np

from roadplane_train.cars.mesh import CarMesh

from .camera import Camera
from .crops import VisiblePart
from .paths import Motion

DATASET_SCHEMA = "roadplane.dataset/1"
TRUTH_SCHEMA = "roadplane.truth/1"
SMALLEST_SHARE = 0.15  # a frame lists no cars with a smaller visible share


def camera_record(camera: Camera) -> dict:
    """Returns the camera, with the keys of `camera.json`."""
    normal, offset = camera.plane_in_camera
    return {
        "image_size_px": list(camera.image_size_px),
        "focal_px": float(camera.focal_px),
        "principal_point_px": list(camera.principal_point_px),
        "height_m": float(camera.height_m),
        "tilt_rad": float(camera.tilt_rad),
        "roll_rad": float(camera.roll_rad),
        "plane_in_camera": {"normal": normal.tolist(), "offset_m": float(offset)},
        "camera_from_world": camera.camera_from_world.tolist(),
    }


def model_record(number: int, mesh: CarMesh) -> dict:
    """Returns one physical car: its shape, car frame, metres."""
    return {
        "id": number,
        "class": mesh.body if mesh.body in ("truck", "bus", "motorcycle") else "car",
        "body": mesh.body,
        "model": mesh.name,
        "dims_m": _rounded(mesh.dims, 4),
        "keypoints_in_car": [_rounded(p, 6) if np.isfinite(p).all() else None for p in mesh.keypoints],
    }


def car_record(number: int, motion: Motion, seen: VisiblePart) -> dict:
    """Returns one car in one frame."""
    points = [
        [*_rounded(p, 2), int(v)] if np.isfinite(p).all() else None for p, v in zip(seen.keypoints, seen.visible, strict=True)
    ]
    return {
        "id": number,
        "world_from_car": [_rounded(row, 6) for row in motion.world_from_car],
        "speed_mps": round(float(motion.speed_mps), 4),
        "activity": motion.activity,
        "box": _rounded(seen.box, 2),
        "whole_box": _rounded(seen.extent, 2),
        "visible_share": round(seen.seen_share, 3),
        "keypoints_px": points,
    }


def item_record(
    media: str,
    fps: float | None,
    conditions: dict[str, str],
    camera: Camera,
    meshes: dict[int, CarMesh],
    frames: list[list[dict]],
    motion: list[np.ndarray | None] | None = None,
) -> dict:
    """Returns a still (`fps` None) or a clip; `frames` holds each frame's cars, `meshes` the cars by id.

    `motion` has the homography of each frame of a moving camera, from pixels of `camera` to pixels of the frame.
    It is None in a frame of a camera that is carried along.
    """
    appear = sorted({car["id"] for cars in frames for car in cars})
    entries = [{"frame": k, "time_s": round(k / fps, 6) if fps else 0.0, "cars": cars} for k, cars in enumerate(frames)]
    for entry, picture_from_world in zip(entries, motion or [], strict=False):
        if picture_from_world is None:
            continue
        entry["picture_from_world"] = (picture_from_world / picture_from_world[2, 2]).flatten()[:8].tolist()
    return {
        "schema": TRUTH_SCHEMA,
        "media": media,
        "kind": "still" if fps is None else "clip",
        "fps": fps,
        "real": False,
        "conditions": conditions,
        "camera": camera_record(camera),
        "models": [model_record(i, meshes[i]) for i in appear],
        "frames": entries,
    }


def dataset_record(name: str, split: str, seed: int, items: list[str]) -> dict:
    """Returns `dataset.json`; items are paths of truth files relative to it."""
    return {"schema": DATASET_SCHEMA, "name": name, "split": split, "seed": seed, "items": sorted(items)}


def _rounded(values: np.ndarray, digits: int) -> list[float]:
    return [round(float(v), digits) + 0.0 for v in values]  # + 0.0: no negative zeros
