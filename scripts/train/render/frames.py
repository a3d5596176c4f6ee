"""Whole frames of a scene: drawing them, redrawing only moved parts, and the effects of the camera."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .appearance import Light
from .camera import Camera
from .renderer import Renderer
from .scene import Scene

SUPERSAMPLING = 2
NEAREST_M = 1.0  # all objects of a picture are farther from the camera
AMBIENT_M, AMBIENT_HIGH_M = 1.7, 1.3  # beside and above: beyond this distance a car darkens by less than half a grey level
Region = tuple[int, int, int, int]  # x, y, width, height in pixels


@dataclass(frozen=True)
class Finish:
    """A camera's blur (sd, pixels), noise (sd, grey levels), colour cast and saturation."""

    blur_px: float
    noise: float
    cast: tuple[float, float, float] = (1.0, 1.0, 1.0)
    saturation: float = 1.0


def sample_finish(rng: np.random.Generator, dark: bool) -> Finish:
    """Draws a camera as typical in surveillance; noisier when it is dark."""
    cast = tuple(float(c) for c in 1 + rng.normal(0, 0.02, 3))
    return Finish(rng.uniform(0.4, 0.9), rng.uniform(1.2, 2.4) if dark else rng.uniform(0.4, 1.6), cast, rng.uniform(0.75, 1.15))


def finished(rng: np.random.Generator, drawn: np.ndarray, size: tuple[int, int], finish: Finish) -> np.ndarray:
    """Returns the camera's picture of a supersampled drawing: RGB uint8 of a size (width, height)."""
    image = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    image = cv2.GaussianBlur(image, (0, 0), finish.blur_px) * np.array(finish.cast, np.float32)
    grey = image @ np.array([0.299, 0.587, 0.114], np.float32)
    image = grey[..., None] + np.float32(finish.saturation) * (image - grey[..., None])
    image += rng.standard_normal((*image.shape[:2], 1), np.float32) * np.float32(finish.noise)
    return image.clip(0, 255).round().astype(np.uint8)


def draw(renderer: Renderer, scene: Scene, camera: Camera, region: Region) -> np.ndarray:
    """Draws a region of the frame, supersampled; the pixels do not depend on the region."""
    x, y, width, height = region
    return renderer.colour(scene, camera, (x - 0.5, y - 0.5, width, height), (width * SUPERSAMPLING, height * SUPERSAMPLING))


def changed_region(camera: Camera, light: Light, centre: np.ndarray, reach_m: float, height_m: float) -> Region | None:
    """Returns the part of the frame that a thing at a ground point (2,), with its shadow, can change, if any."""
    corners = np.array([(x, y, z) for x in (-reach_m, reach_m) for y in (-reach_m, reach_m) for z in (0.0, height_m)])
    corners[:, :2] += centre
    points = corners
    if light.sun[1] > 0:
        points = np.concatenate([corners, corners - light.to_sun * (corners[:, 2:] / light.to_sun[2])])
    pixels, depth = camera.pixel_from_world(points)
    if depth.max() < 1:
        return None
    if depth.min() < 1:
        return 0, 0, *camera.image_size_px
    low = np.clip(np.floor(pixels.min(0)), 0, camera.image_size_px).astype(int)
    high = np.clip(np.ceil(pixels.max(0)) + 1, 0, camera.image_size_px).astype(int)
    return (*low.tolist(), *(high - low).tolist()) if (high > low).all() else None


def box_corners(pose: np.ndarray, bounds: tuple[np.ndarray, np.ndarray], more_m: float = 0.0) -> np.ndarray:
    """Returns world points (8, 3) of a box (least and greatest x, y, z in its frame), enlarged by `more_m`."""
    low, high = bounds[0] - more_m, bounds[1] + more_m
    corners = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    return corners @ pose[:3, :3].T + pose[:3, 3]


def outline(camera: Camera, points: np.ndarray) -> Region | None:
    """Returns the part of the frame that the convex hull of world points can cover; None if it lies outside."""
    pose = camera.camera_from_world
    depth = points @ pose[2, :3] + pose[2, 3]
    ahead, behind = points[depth >= NEAREST_M], points[depth < NEAREST_M]
    if not len(ahead):
        return None
    if len(behind):  # cut off the part that is not in front of the camera
        share = (depth[depth >= NEAREST_M, None] - NEAREST_M) / (depth[depth >= NEAREST_M, None] - depth[None, depth < NEAREST_M])
        cuts = ahead[:, None] + (behind[None] - ahead[:, None]) * share[..., None]
        ahead = np.concatenate([ahead, cuts.reshape(-1, 3)])
    pixels, _ = camera.pixel_from_world(ahead)
    low = np.clip(np.floor(pixels.min(0)), 0, camera.image_size_px).astype(int)
    high = np.clip(np.ceil(pixels.max(0)) + 1, 0, camera.image_size_px).astype(int)
    return (*low.tolist(), *(high - low).tolist()) if (high > low).all() else None


def reached_region(camera: Camera, light: Light, pose: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> Region | None:
    """Returns the part of the frame where a box, its shadow, or its effect on the sky's light can be seen."""
    wide = np.array([bounds[0] - AMBIENT_M, bounds[1] + AMBIENT_M])
    wide[:, 2] = 0.0, AMBIENT_HIGH_M
    points = [box_corners(pose, bounds), box_corners(pose, wide)]
    if light.sun[1] > 0:
        body = box_corners(pose, bounds, 1.1 * light.softness_m + 0.1)
        body[:, 2] = body[:, 2].clip(0, None)
        points += [body, body - light.to_sun * (body[:, 2:] / light.to_sun[2])]
    return outline(camera, np.concatenate(points))


def overlap(region: Region, box: np.ndarray, margin: float = 2.0) -> bool:
    """Returns whether a region touches a box (x0, y0, x1, y1)."""
    x, y, width, height = region
    return bool(x - margin < box[2] and box[0] < x + width + margin and y - margin < box[3] and box[1] < y + height + margin)


class Canvas:
    """A supersampled frame of which only changed regions are redrawn."""

    def __init__(self, renderer: Renderer, camera: Camera) -> None:
        width, height = camera.image_size_px
        self.renderer, self.camera = renderer, camera
        self.drawn = np.empty((height * SUPERSAMPLING, width * SUPERSAMPLING, 3), np.uint8)
        self._stale: list[Region] = [(0, 0, width, height)]

    def update(self, scene: Scene, moving: list[Region]) -> list[Region]:
        """Draws a scene and returns the drawn regions; `moving` is where it differs from one without moving things."""
        regions = sorted({*self._stale, *moving})
        regions = [r for r in regions if not any(r != o and _inside(r, o) for o in regions)]
        for region in regions:
            x, y, w, h = (n * SUPERSAMPLING for n in region)
            self.drawn[y : y + h, x : x + w] = draw(self.renderer, scene, self.camera, region)
        self._stale = moving
        return regions


class ExactCanvas:
    """A supersampled frame that is updated over time: it draws changes alone, with the pixels of a full redraw."""

    def __init__(self, renderer: Renderer, camera: Camera) -> None:
        self.renderer, self.camera = renderer, camera
        width, height = camera.image_size_px
        self.drawn = np.zeros((height * SUPERSAMPLING, width * SUPERSAMPLING, 3), np.uint8)

    def update(self, scene: Scene, changed: list[Region]) -> None:
        """Draws a scene where it differs from the one before; `changed` may be the whole frame."""
        parts = [tuple(n * SUPERSAMPLING for n in region) for region in merged(changed)]
        self.renderer.redraw(self.drawn, scene, self.camera, (-0.5, -0.5, *self.camera.image_size_px), parts)


def merged(regions: list[Region]) -> list[Region]:
    """Returns regions that cover at least the same, joined wherever that reduces the drawing."""
    kept: list[Region] = []
    for region in sorted(set(regions)):
        again = True
        while again:
            again = False
            for other in kept:
                both = _around(region, other)
                if both[2] * both[3] <= region[2] * region[3] + other[2] * other[3]:
                    kept.remove(other)
                    region, again = both, True
                    break
        kept.append(region)
    return kept


def _around(a: Region, b: Region) -> Region:
    x, y = min(a[0], b[0]), min(a[1], b[1])
    return x, y, max(a[0] + a[2], b[0] + b[2]) - x, max(a[1] + a[3], b[1] + b[3]) - y


def _inside(inner: Region, outer: Region) -> bool:
    return (
        outer[0] <= inner[0]
        and outer[1] <= inner[1]
        and inner[0] + inner[2] <= outer[0] + outer[2]
        and inner[1] + inner[3] <= outer[1] + outer[3]
    )


def ffmpeg() -> str:
    """Returns the command that writes videos; if it is missing, ends the program with advice."""
    found = shutil.which("ffmpeg")
    if found is None:
        raise SystemExit("ffmpeg, which encodes the videos, is missing: apt-get install ffmpeg")
    return found


class VideoWriter:
    """Writes an H.264 file, whole or not at all; the same frames give the same bytes."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float, crf: int, mbit: float | None = None) -> None:
        """Opens a file of constant quality, or of at most `mbit` Mbit/s with a key frame every two seconds."""
        self.path, self._part = path, path.with_suffix(".part.mp4")
        quality = ["-crf", str(crf)]
        if mbit is not None:
            quality = ["-b:v", f"{mbit}M", "-maxrate", f"{mbit}M", "-bufsize", f"{2 * mbit}M", "-g", str(round(2 * fps))]
        command = [
            ffmpeg(),
            "-y",
            "-v",
            "error",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
            "-s",
            f"{size[0]}x{size[1]}",
            "-r",
            str(fps),
            "-i",
            "-",
            "-c:v",
            "libx264",
            "-preset",
            "slow",
            "-threads",
            "1",
            *quality,
            "-pix_fmt",
            "yuv420p",
            "-movflags",
            "+faststart",
            "-fflags",
            "+bitexact",
            "-flags:v",
            "+bitexact",
            str(self._part),
        ]
        self._encoder = subprocess.Popen(command, stdin=subprocess.PIPE)

    def write(self, image: np.ndarray) -> None:
        """Adds one RGB frame."""
        assert self._encoder.stdin is not None
        self._encoder.stdin.write(image.tobytes())

    def finish(self) -> None:
        """Completes the file and gives it its name."""
        assert self._encoder.stdin is not None
        self._encoder.stdin.close()
        if self._encoder.wait() != 0:
            raise RuntimeError(f"ffmpeg failed on {self._part.name}")
        self._part.rename(self.path)
