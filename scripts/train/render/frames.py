"""Whole frames of a scene: drawing, drawing again only what moved, and what the camera makes of it."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .camera import Camera
from .looks import Light
from .renderer import Renderer
from .scene import Scene

SUPERSAMPLING = 2
Region = tuple[int, int, int, int]  # x, y, width, height in pixels


@dataclass(frozen=True)
class Finish:
    """A camera's blur (sd, pixels), noise (sd, grey levels), colour cast and saturation."""

    blur_px: float
    noise: float
    cast: tuple[float, float, float] = (1.0, 1.0, 1.0)
    saturation: float = 1.0


def sample_finish(rng: np.random.Generator, dark: bool) -> Finish:
    """A camera as they hang on walls; noisier when it is dark."""
    cast = tuple(float(c) for c in 1 + rng.normal(0, 0.02, 3))
    return Finish(rng.uniform(0.4, 0.9), rng.uniform(1.2, 2.4) if dark else rng.uniform(0.4, 1.6), cast, rng.uniform(0.75, 1.15))


def finished(rng: np.random.Generator, drawn: np.ndarray, size: tuple[int, int], finish: Finish) -> np.ndarray:
    """The camera's picture of a supersampled drawing: RGB uint8 of a size (width, height)."""
    image = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    image = cv2.GaussianBlur(image, (0, 0), finish.blur_px) * np.array(finish.cast, np.float32)
    grey = image @ np.array([0.299, 0.587, 0.114], np.float32)
    image = grey[..., None] + np.float32(finish.saturation) * (image - grey[..., None])
    image += rng.standard_normal((*image.shape[:2], 1), np.float32) * np.float32(finish.noise)
    return image.clip(0, 255).round().astype(np.uint8)


def draw(renderer: Renderer, scene: Scene, camera: Camera, region: Region) -> np.ndarray:
    """A region of the frame, supersampled; the same pixels whatever the region."""
    x, y, width, height = region
    return renderer.colour(scene, camera, (x - 0.5, y - 0.5, width, height), (width * SUPERSAMPLING, height * SUPERSAMPLING))


def changed_region(camera: Camera, light: Light, centre: np.ndarray, reach_m: float, height_m: float) -> Region | None:
    """The part of the frame that something at a ground point (2,), and its shadow, can change; none outside the frame."""
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


def overlap(region: Region, box: np.ndarray, margin: float = 2.0) -> bool:
    """Whether a region touches a box (x0, y0, x1, y1)."""
    x, y, width, height = region
    return bool(x - margin < box[2] and box[0] < x + width + margin and y - margin < box[3] and box[1] < y + height + margin)


class Canvas:
    """A supersampled frame of which only changed regions are drawn again."""

    def __init__(self, renderer: Renderer, camera: Camera) -> None:
        width, height = camera.image_size_px
        self.renderer, self.camera = renderer, camera
        self.drawn = np.empty((height * SUPERSAMPLING, width * SUPERSAMPLING, 3), np.uint8)
        self._stale: list[Region] = [(0, 0, width, height)]

    def update(self, scene: Scene, moving: list[Region]) -> list[Region]:
        """Draws a scene; `moving` is where it differs from one without moving things. Gives what was drawn."""
        regions = sorted({*self._stale, *moving})
        regions = [r for r in regions if not any(r != o and _inside(r, o) for o in regions)]
        for region in regions:
            x, y, w, h = (n * SUPERSAMPLING for n in region)
            self.drawn[y:y + h, x:x + w] = draw(self.renderer, scene, self.camera, region)
        self._stale = moving
        return regions


def _inside(inner: Region, outer: Region) -> bool:
    return (outer[0] <= inner[0] and outer[1] <= inner[1] and inner[0] + inner[2] <= outer[0] + outer[2]
            and inner[1] + inner[3] <= outer[1] + outer[3])


class VideoWriter:
    """An H.264 file that is there complete or not at all; the same frames give the same bytes."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float, crf: int) -> None:
        self.path, self._part = path, path.with_suffix(".part.mp4")
        command = ["ffmpeg", "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}",
                   "-r", str(fps), "-i", "-", "-c:v", "libx264", "-preset", "slow", "-threads", "1", "-crf", str(crf),
                   "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-fflags", "+bitexact", "-flags:v", "+bitexact",
                   str(self._part)]
        self._encoder = subprocess.Popen(command, stdin=subprocess.PIPE)

    def write(self, image: np.ndarray) -> None:
        """One RGB frame."""
        assert self._encoder.stdin is not None
        self._encoder.stdin.write(image.tobytes())

    def finish(self) -> None:
        """Ends the file and gives it its name."""
        assert self._encoder.stdin is not None
        self._encoder.stdin.close()
        if self._encoder.wait() != 0:
            raise RuntimeError(f"ffmpeg failed on {self._part.name}")
        self._part.rename(self.path)
