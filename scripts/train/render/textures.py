"""Procedural textures: one tileable noise image and a pool of mirror environments."""

from __future__ import annotations

import numpy as np

ENVIRONMENT_SIZE = (128, 64)  # azimuth, elevation from −90° to 90°


def _spectral_noise(rng: np.random.Generator, size: int, exponent: float, lowest: float = 1.0) -> np.ndarray:
    """Tileable noise of a 1/f^exponent spectrum, its ranks spread evenly over 0…1."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None]) * size
    gain = np.where(frequency < lowest, 0.0, 1.0 / np.maximum(frequency, 1.0) ** exponent)
    field = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(size, size))) * gain, s=(size, size))
    field = (field - field.mean()) / field.std()
    return np.clip(0.5 + field / 5, 0, 1)


def noise_image(rng: np.random.Generator, size: int = 512) -> np.ndarray:
    """(size, size, 4) uint8: R clouds, G grain, B crack lines (1 on a line), A blobs."""
    clouds = _spectral_noise(rng, size, 1.5)
    grain = _spectral_noise(rng, size, 0.35)
    ridge = np.abs(_spectral_noise(rng, size, 1.5, 3.0) - 0.5)
    cracks = np.clip(1 - ridge / 0.012, 0, 1) * (_spectral_noise(rng, size, 1.6) > 0.52)
    blobs = _spectral_noise(rng, size, 1.8, 4.0)
    return (np.stack([clouds, grain, cracks, blobs], axis=-1) * 255).round().astype(np.uint8)


def environment_image(rng: np.random.Generator) -> np.ndarray:
    """(64, 128, 4) float32: RGB radiance relative to the sky's mean, A share of ground seen in that direction."""
    width, height = ENVIRONMENT_SIZE
    elevation = ((np.arange(height) + 0.5) / height - 0.5)[:, None] * np.pi
    overcast = rng.random() < 0.5
    up = np.sin(np.maximum(elevation, 0))
    glow = rng.uniform(0.0, 0.4) if overcast else rng.uniform(0.6, 2.2)
    level = (0.8 + rng.uniform(0, 0.5) * up if overcast else 0.55 + 0 * up) + glow * np.exp(-up * 5)
    horizon = np.array([1.0, 1.0, 0.95]) if overcast else np.array([1.25, 1.08, 0.9])
    colour = 1 + (horizon - 1) * np.exp(-up * 4)[..., None]
    noise = _spectral_noise(rng, width, 1.6)[:height]
    clouds = np.clip((noise - rng.uniform(0.45, 0.75)) * 5, 0, 1) * np.clip(elevation * 4, 0, 1)
    sky = level[..., None] * colour * np.ones((height, width, 1))
    sky = sky * (1 - clouds[..., None]) + clouds[..., None] * rng.uniform(0.9, 2.0)
    sky = sky / (sky * np.maximum(np.sin(elevation), 0)[..., None]).sum() * np.maximum(np.sin(elevation), 0).sum() * width * 3

    skyline = np.radians(rng.uniform(1, 5)) * np.ones(width)
    tone = np.ones((width, 3)) * 0.2
    for _ in range(rng.integers(0, 12)):  # buildings and trees
        start, span = rng.integers(width), rng.integers(3, 24)
        columns = np.arange(start, start + span) % width
        top = np.radians(rng.uniform(3, 28))
        leafy = rng.random() < 0.5
        ragged = rng.normal(0, 0.1, span) + np.sin(np.linspace(0, np.pi, span)) - 0.3 if leafy else 0.0
        skyline[columns] = np.maximum(skyline[columns], top * (1 + 0.5 * ragged))
        green = np.array([0.5, 0.75, 0.35]) * rng.uniform(0.05, 0.3)
        tone[columns] = green if leafy else rng.uniform(0.1, 0.9) * (1 + rng.normal(0, 0.06, 3))
    image = np.zeros((height, width, 4), np.float32)
    cover = np.clip((skyline[None] - elevation) / np.radians(3) + 0.5, 0, 1)[..., None]
    texture = 0.7 + 0.6 * _spectral_noise(rng, width, 0.6)[:height, :, None]
    image[..., :3] = sky * (1 - cover) + tone[None] * texture * cover
    ground = np.clip(-elevation / np.radians(4), 0, 1)[..., None] * np.ones((1, width, 1))
    image[..., :3] *= 1 - ground
    image[..., 3:] = ground
    return image
