"""A pinhole camera above the ground plane, in the frames of `crates/base/src/lib.rs`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Camera:
    """A camera. World: z up, camera at (0, 0, height), y the horizontal viewing direction, x right. SI units."""

    image_size_px: tuple[int, int]
    focal_px: float
    height_m: float
    tilt_rad: float  # optical axis below the horizontal is positive
    roll_rad: float  # positive: the scene's horizon turns clockwise in the image

    @classmethod
    def of(cls, record: dict) -> Camera:
        """Returns the camera of a record with the keys of `camera.json`."""
        return cls(tuple(record["image_size_px"]), *(record[key] for key in ("focal_px", "height_m", "tilt_rad", "roll_rad")))

    @property
    def principal_point_px(self) -> tuple[float, float]:
        """Returns the image centre; pixel (0, 0) is the centre of the top-left pixel."""
        width, height = self.image_size_px
        return (width - 1) / 2, (height - 1) / 2

    @property
    def centre_m(self) -> tuple[float, float, float]:
        """Returns the position of the camera in the world."""
        return 0.0, 0.0, self.height_m

    @property
    def camera_from_world(self) -> np.ndarray:
        """Returns the 4 × 4 motion; camera axes x right, y down, z forward."""
        cos, sin = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        level = np.array([[1, 0, 0], [0, -sin, -cos], [0, cos, -sin]])
        cos, sin = np.cos(self.roll_rad), np.sin(self.roll_rad)
        rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ level
        result = np.eye(4)
        result[:3, :3] = rotation
        result[:3, 3] = -rotation @ [0, 0, self.height_m]
        return result

    @property
    def plane_in_camera(self) -> tuple[np.ndarray, float]:
        """Returns the ground as `normal · X + offset = 0`.

        The unit normal points up, so the offset is the camera's height.
        """
        return self.camera_from_world[:3, 2], self.height_m

    def pixel_from_world(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns pixels (n, 2) and depth along the optical axis (n,) of world points (n, 3)."""
        pose = self.camera_from_world
        in_camera = points @ pose[:3, :3].T + pose[:3, 3]
        depth = in_camera[:, 2]
        safe = np.where(np.abs(depth) < 1e-6, 1e-6, depth)
        return in_camera[:, :2] / safe[:, None] * self.focal_px + np.asarray(self.principal_point_px), depth

    def ground_from_pixel(self, pixel: np.ndarray) -> np.ndarray | None:
        """Returns the world point on the ground at a pixel; None at or above the horizon."""
        pose = self.camera_from_world
        ray = np.append((np.asarray(pixel) - self.principal_point_px) / self.focal_px, 1.0) @ pose[:3, :3]
        if ray[2] > -1e-4:
            return None
        return np.array([0, 0, self.height_m]) - ray * (self.height_m / ray[2])

    def clip_from_world(self, window: tuple[float, float, float, float], near: float, far: float) -> np.ndarray:
        """Returns the GL matrix of a window (left, top, width, height; pixel edges, so the frame's left edge is −0.5).

        Image rows run along GL's rows from the bottom, so reading a frame buffer gives the top row first.
        """
        left, top, width, height = window
        cx, cy = self.principal_point_px
        projection = np.array(
            [
                [2 * self.focal_px / width, 0, 2 * (cx - left) / width - 1, 0],
                [0, 2 * self.focal_px / height, 2 * (cy - top) / height - 1, 0],
                [0, 0, (far + near) / (far - near), -2 * far * near / (far - near)],
                [0, 0, 1, 0],
            ]
        )
        return projection @ self.camera_from_world


def world_from_car(x: float, y: float, heading_rad: float) -> np.ndarray:
    """Returns the pose of a car on the ground, 4 × 4; heading 0 along +x, counter-clockwise."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([[cos, -sin, 0, x], [sin, cos, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])
