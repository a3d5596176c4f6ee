"""Computes the visible parts of vehicles without a picture: boxes approximate bodies and things in a depth buffer.

Boxes of whole vehicles are those of their meshes. Occlusion, and with it the visibility of keypoints, is right to about
a third of a metre.
"""

from __future__ import annotations

import cv2
import numpy as np

from roadplane_train.cars.mesh import CarMesh

from .camera import Camera
from .crops import VisiblePart, in_world
from .props import Prop

TOLERANCE_M = 0.4  # depth tolerance of keypoints behind the boxes of the body
LEAST_PX = 4.0  # longer side of the smallest listed vehicle
FACES = (
    (0, 1, 3, 2),
    (4, 6, 7, 5),
    (0, 4, 5, 1),
    (2, 3, 7, 6),
    (0, 2, 6, 4),
    (1, 5, 7, 3),
)  # indices of corners, over low and high x, y, z
CABIN = (-0.42, 0.22, 0.85, 0.55)  # of a car: rear, front (of the length), width, from this height


def body_boxes(mesh: CarMesh) -> list[np.ndarray]:
    """Returns corners (8, 3) of boxes that approximately fill the vehicle, car frame."""
    low, high = mesh.vertices.min(0).astype(float), mesh.vertices.max(0).astype(float)
    half = mesh.dims[1] / 2
    if mesh.body in ("truck", "bus", "van"):
        return [_corners((low[0], -half, 0.3), (high[0], half, high[2]))]
    rear, front, width, waist = CABIN
    length, middle = high[0] - low[0], (high[0] + low[0]) / 2
    if mesh.body in ("wagon", "suv", "minivan", "hatchback"):
        rear = -0.47
    return [
        _corners((low[0], -half, 0.2), (high[0], half, waist * high[2])),
        _corners((middle + rear * length, -width * half, waist * high[2]), (middle + front * length, width * half, high[2])),
    ]


def prop_box(prop: Prop) -> np.ndarray:
    """Returns corners (8, 3) of a thing, world; for blobs, those of the middle part."""
    share = 0.36 if prop.shape == "blob" else 0.5
    low, high = (-share, -share, 0.15 if prop.shape == "blob" else 0.0), (share, share, 0.85 if prop.shape == "blob" else 1.0)
    return in_world(_corners(low, high), prop.world_from_prop)


def _corners(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    return np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


class Outlines:
    """A depth buffer of whole pixels over the picture, with the visible vehicle of each pixel (−1: none)."""

    def __init__(self, camera: Camera, props: list[Prop]) -> None:
        self.camera = camera
        width, height = camera.image_size_px
        self._near = np.zeros((height, width), np.float32)  # 1 / depth
        self._who = np.full((height, width), -1, np.int32)
        for prop in props:
            self._draw(prop_box(prop), -1)
        self._empty = self._near.copy()

    def visible_parts(self, vehicles: list[tuple[int, CarMesh, np.ndarray]]) -> dict[int, VisiblePart]:
        """Returns the visible part of each vehicle (number, mesh, pose) at one moment."""
        self._near, self._who[:] = self._empty.copy(), -1
        whole = {}
        for number, mesh, pose in vehicles:
            boxes = [in_world(box, pose) for box in body_boxes(mesh)]
            whole[number] = self._silhouette(boxes)
            if whole[number]:
                for box in boxes:
                    self._draw(box, number)
        found = {}
        for number, mesh, pose in vehicles:
            if whole[number] and (seen := self._visible_part(number, mesh, pose, whole[number])) is not None:
                found[number] = seen
        return found

    def _visible_part(self, number: int, mesh: CarMesh, pose: np.ndarray, whole: int) -> VisiblePart | None:
        pixels, depth = self.camera.pixel_from_world(in_world(mesh.vertices, pose))
        if depth.min() < 1:
            return None
        low, high = pixels.min(0), pixels.max(0)
        frame = np.array(self.camera.image_size_px) - 0.5
        inside = np.concatenate([np.maximum(low, -0.5), np.minimum(high, frame)])
        if (inside[2:] - inside[:2]).min() <= 1 or (inside[2:] - inside[:2]).max() < LEAST_PX:
            return None
        x0, y0 = np.floor(inside[:2].clip(0)).astype(int)
        x1, y1 = np.ceil(inside[2:]).astype(int) + 1
        shown = self._who[y0:y1, x0:x1] == number
        if not shown.any():
            return None
        share = min(float(shown.sum()) / whole, 1.0)
        box = inside
        in_picture = np.prod((inside[2:] - inside[:2]) / (high - low))  # about
        if share < 0.97 * in_picture:  # something is in front of it
            rows, columns = np.nonzero(shown.any(1))[0], np.nonzero(shown.any(0))[0]
            box = np.array([columns[0] + x0 - 0.5, rows[0] + y0 - 0.5, columns[-1] + x0 + 0.5, rows[-1] + y0 + 0.5])
            box = np.concatenate([np.maximum(box[:2], inside[:2]), np.minimum(box[2:], inside[2:])])
            if (box[2:] - box[:2]).min() <= 1:
                return None
        points, point_depth = self.camera.pixel_from_world(in_world(mesh.keypoints, pose))
        visible = np.zeros(len(points), bool)
        for k, (x, y) in enumerate(points):
            if np.isfinite(x) and -0.5 <= x <= frame[0] and -0.5 <= y <= frame[1]:
                # Bodies are rounder than boxes: next to the edge another pixel may show none of it.
                column, row = round(float(x)), round(float(y))
                near = self._near[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
                visible[k] = (near <= 1 / max(point_depth[k] - TOLERANCE_M, 0.5)).sum() >= 3
        return VisiblePart(box, inside, np.concatenate([low, high]), share, share, points, visible)

    def _silhouette(self, boxes: list[np.ndarray]) -> int:
        """Returns the pixels that boxes cover, in the picture or outside; 0 where they are behind the camera."""
        pixels, depth = self.camera.pixel_from_world(np.concatenate(boxes))
        if depth.min() < 1 or not self._near_picture(pixels):
            return 0
        low = np.floor(pixels.min(0))
        size = (np.ceil(pixels.max(0)) - low + 1).astype(int)
        if size.max() > 8 * max(self.camera.image_size_px):
            return 0
        mask = np.zeros((size[1], size[0]), np.uint8)
        for k in range(len(boxes)):
            hull = cv2.convexHull((pixels[8 * k : 8 * k + 8] - low).astype(np.float32))
            cv2.fillConvexPoly(mask, np.round(hull).astype(np.int32), 1)
        return int(mask.sum())

    def _near_picture(self, pixels: np.ndarray) -> bool:
        size = np.array(self.camera.image_size_px)
        return bool((pixels.max(0) > -0.5).all() and (pixels.min(0) < size).all())

    def _draw(self, corners: np.ndarray, number: int) -> None:
        """Draws a box into the buffer."""
        pixels, depth = self.camera.pixel_from_world(corners)
        if depth.min() < 1 or not self._near_picture(pixels):
            return
        height, width = self._near.shape
        for face in FACES:
            corner, inverse = pixels[list(face)], 1 / depth[list(face)]
            (a, b), (c, d) = corner[1] - corner[0], corner[2] - corner[0]
            if abs(a * d - b * c) < 1e-3:  # edge-on
                continue
            low = np.floor(corner.min(0)).astype(int).clip(0)
            high = np.minimum(np.ceil(corner.max(0)).astype(int), (width - 1, height - 1))
            if (high < low).any():
                continue
            # Over a plane the inverse of the depth is linear in the picture.
            linear = np.linalg.lstsq(np.column_stack([corner, np.ones(4)]), inverse, rcond=None)[0]
            mask = np.zeros((high[1] - low[1] + 1, high[0] - low[0] + 1), np.uint8)
            cv2.fillConvexPoly(mask, np.round(corner - low).astype(np.int32), 1)
            x, y = np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1)
            near = (linear[0] * x[None] + linear[1] * y[:, None] + linear[2]).astype(np.float32)
            region = np.s_[low[1] : high[1] + 1, low[0] : high[0] + 1]
            nearer = (mask > 0) & (near > self._near[region])
            self._near[region][nearer] = near[nearer]
            self._who[region][nearer] = number
