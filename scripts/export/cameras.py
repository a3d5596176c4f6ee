"""Checks of exports that hold the camera: UCMCTrack and Rope3D."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from rows import BOX, close


def seen(pixels: np.ndarray, run: pd.DataFrame) -> int:
    """Checks that positions on the ground appear in the boxes, for boxes inside the picture. Returns their number.

    The formats have no lens distortion. With a distorting lens, boxes are elsewhere, and nothing is checked.
    """
    if run.attrs["has_lens"]:
        return len(pixels)
    x0, y0, x1, y1 = run[BOX].to_numpy().T
    inside = (x0 > 4) & (y0 > 4) & run.observed.to_numpy()
    hits = (pixels[:, 0] > x0) & (pixels[:, 0] < x1) & (pixels[:, 1] > y0) & (pixels[:, 1] < y1 + 5)
    assert hits[inside].mean() > 0.9, hits[inside].mean()
    return len(pixels)


def on_the_ground(run: pd.DataFrame) -> np.ndarray:
    """Returns the homogeneous world coordinates of each row."""
    return np.column_stack([run.x_m, run.y_m, np.zeros(len(run)), np.ones(len(run))])


def projected(projection: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Returns the pixels of homogeneous points."""
    pixels = points @ projection.T
    return pixels[:, :2] / pixels[:, 2:]


def ucmctrack_camera(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Reads camera_from_world (3 × 4) and the intrinsic matrix by the layout in UCMCTrack's readme, in m."""
    blocks = dict(block.split("\n", 1) for block in path.read_text().strip().split("\n\n"))
    rotation = np.array(blocks["RotationMatrices"].split(), float).reshape(3, 3)
    translation_m = np.array(blocks["TranslationVectors"].split(), float) / 1000
    close(rotation @ rotation.T, np.eye(3), 1e-8)
    return np.column_stack([rotation, translation_m]), np.array(blocks["IntrinsicMatrix"].split(), float).reshape(3, 3)


def check_ucmctrack(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks that the camera sees the rows in their boxes."""
    camera_from_world, intrinsic = ucmctrack_camera(folder / "cam_para" / f"{name}.txt")
    return seen(projected(intrinsic @ camera_from_world, on_the_ground(run)), run)


def check_rope3d(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks that the plane contains the rows, and that the camera sees the rows in their boxes."""
    key, *numbers = (folder / "calib" / f"{name}.txt").read_text().split()
    assert key == "P2:", key
    plane = np.array((folder / "denorm" / f"{name}.txt").read_text().splitlines()[0].split(" "), float)
    camera_from_world, _ = ucmctrack_camera(folder.parent / "ucmctrack" / "cam_para" / f"{name}.txt")
    in_camera = np.column_stack([on_the_ground(run) @ camera_from_world.T, np.ones(len(run))])
    close(in_camera @ plane, np.zeros(len(run)), 1e-4)
    return seen(projected(np.array(numbers, float).reshape(3, 4), in_camera), run)
