"""Degrades images as cameras, codecs and weather do, at the frame's own resolution, on uint8 RGB."""

from __future__ import annotations

import cv2
import numpy as np


def degrade(rng: np.random.Generator, image: np.ndarray) -> np.ndarray:
    """Returns a randomly degraded copy of a patch of a frame, (h, w, 3) uint8; about one in ten stays nearly clean."""
    strength = rng.choice([0.3, 0.8, 1.5], p=[0.3, 0.55, 0.15])
    x = image.astype(np.float32) / 255
    x = _tone(rng, x)
    x = _blur(rng, x, strength)
    if rng.random() < 0.03:
        x = _interlaced(rng, x)
    x = _noise(rng, x, strength)
    if rng.random() < 0.45:
        x = _sharpened(rng, x)
    result = (x.clip(0, 1) * 255).round().astype(np.uint8)
    kind = rng.random()
    if kind < 0.45:
        result = jpeg(result, int(np.clip(rng.uniform(25, 98), 20, 97)))
    elif kind < 0.8:
        result = video_blocks(rng, result, strength)
    return result


def _tone(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    """Colour cast, saturation, gamma, contrast, haze, over-exposure."""
    if rng.random() < 0.6:
        x = x * (1 + rng.normal(0, 0.05, 3)).astype(np.float32)
    saturation = rng.uniform(0.55, 1.35) if rng.random() < 0.94 else 0.0
    grey = x @ np.array([0.299, 0.587, 0.114], np.float32)
    x = grey[..., None] + saturation * (x - grey[..., None])
    x = x.clip(0, None) ** np.float32(np.exp(rng.normal(0, 0.15)))
    x = (x - 0.45) * np.exp(rng.normal(0.2, 0.17)) + 0.45 + rng.normal(0.035, 0.045)
    if rng.random() < 0.18:  # haze, veiling glare, smeared dome
        veil = rng.uniform(0.05, 0.3)
        x = x * (1 - veil) + veil * rng.uniform(0.5, 0.95)
    if rng.random() < 0.12:  # highlights burn out
        x = x * rng.uniform(1.1, 1.5)
    if rng.random() < 0.05:
        x = x * rng.uniform(0.4, 0.7)
    if rng.random() < 0.25:  # light falls off or glares across the patch
        h, w = x.shape[:2]
        gx, gy = rng.normal(0, 0.12, 2)
        x = x * (1 + gx * np.linspace(-1, 1, w)[None, :, None] + gy * np.linspace(-1, 1, h)[:, None, None])
    return x.clip(0, 1.5).astype(np.float32)


def _blur(rng: np.random.Generator, x: np.ndarray, strength: float) -> np.ndarray:
    """Lens and sensor blur, sometimes motion."""
    sigma = rng.gamma(2.0, 0.32) * strength
    if sigma > 0.25:
        x = cv2.GaussianBlur(x, (0, 0), sigma)
    if rng.random() < 0.12:
        length = rng.uniform(1.5, 6)
        angle = rng.uniform(0, np.pi) if rng.random() < 0.3 else rng.normal(0, 0.2)
        size = 2 * int(np.ceil(length)) + 1
        steps = np.linspace(-0.5, 0.5, 15) * length
        kernel = np.zeros((size, size), np.float32)
        for step in steps:
            kernel[round(size // 2 + step * np.sin(angle)), round(size // 2 + step * np.cos(angle))] += 1
        x = cv2.filter2D(x, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
    if rng.random() < 0.12:  # the video was stretched from a smaller one
        factor = rng.uniform(0.45, 0.85)
        h, w = x.shape[:2]
        small = cv2.resize(x, (max(8, int(w * factor)), max(8, int(h * factor))), interpolation=cv2.INTER_AREA)
        filters = [cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_NEAREST]
        x = cv2.resize(small, (w, h), interpolation=rng.choice(filters, p=[0.5, 0.4, 0.1]))
    return x


def _interlaced(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    """Shifts every other line, as on a moving car in interlaced video."""
    x = x.copy()
    x[1::2] = np.roll(x[1::2], int(rng.integers(1, 4)), axis=1)
    return x


def _noise(rng: np.random.Generator, x: np.ndarray, strength: float) -> np.ndarray:
    """Photon and read noise, partly smoothed by the camera, with some colour blotches."""
    h, w = x.shape[:2]
    level = rng.gamma(1.2, 0.009) * strength
    luma = rng.normal(0, 1, (h, w, 1)).astype(np.float32)
    if rng.random() < 0.4:
        luma = cv2.GaussianBlur(luma, (0, 0), rng.uniform(0.4, 0.9))[..., None] * 1.8
    chroma = cv2.resize(rng.normal(0, 1, (h // 3 + 1, w // 3 + 1, 3)).astype(np.float32), (w, h))
    return x + level * (0.4 + 0.9 * np.sqrt(x.clip(0, 1))) * luma + level * rng.uniform(0, 0.5) * chroma


def _sharpened(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    """Unsharp mask with its halos."""
    return x + rng.uniform(0.2, 1.2) * (x - cv2.GaussianBlur(x, (0, 0), rng.uniform(0.7, 1.8)))


def jpeg(image: np.ndarray, quality: int) -> np.ndarray:
    """Encodes and decodes as JPEG."""
    _, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]


_DCT = cv2.dct(np.eye(8, dtype=np.float64)).astype(np.float32)


def video_blocks(rng: np.random.Generator, image: np.ndarray, strength: float) -> np.ndarray:
    """Imitates a low-rate H.264 picture: 8 × 8 transforms with dead zone, halved chroma, deblocking."""
    h, w = image.shape[:2]
    padded = np.pad(image, ((0, -h % 16), (0, -w % 16), (0, 0)), mode="edge")
    ycc = cv2.cvtColor(padded, cv2.COLOR_RGB2YCrCb).astype(np.float32)
    step = np.exp(rng.uniform(np.log(4), np.log(22))) * min(strength, 1.2)
    for channel in range(3):
        plane = ycc[..., channel]
        if channel:
            plane = cv2.resize(plane, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        rows, columns = plane.shape
        blocks = plane.reshape(rows // 8, 8, columns // 8, 8).transpose(0, 2, 1, 3) - 128
        spectrum = _DCT @ blocks @ _DCT.T
        kept = np.sign(spectrum) * np.floor(np.abs(spectrum) / step + 1 / 3) * step
        blocks = _DCT.T @ kept @ _DCT + 128
        plane = np.ascontiguousarray(blocks.transpose(0, 2, 1, 3).reshape(rows, columns), dtype=np.float32)
        if channel:
            plane = cv2.resize(plane, (padded.shape[1], padded.shape[0]), interpolation=cv2.INTER_LINEAR)
        elif rng.random() < 0.7:
            smooth = cv2.bilateralFilter(plane, 3, step * 0.8, 1.0)
            plane = 0.5 * plane + 0.5 * smooth
        ycc[..., channel] = plane
    return cv2.cvtColor(ycc.clip(0, 255).round().astype(np.uint8), cv2.COLOR_YCrCb2RGB)[:h, :w]
