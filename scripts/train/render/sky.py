"""Weather for the training of the detector, beyond that of the data sets: low sun, night, rain and fog."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from .appearance import Light, sample_light
from .camera import Camera
from .renderer import ENVIRONMENTS
from .scene import PlacedCar
from .stills import sample_weather

# Shares and strengths below are ESTIMATES.
WEATHERS = {
    "sun": 0.26,
    "low sun": 0.12,
    "overcast": 0.14,
    "dusk": 0.09,
    "wet": 0.08,
    "haze": 0.06,
    "rain": 0.07,
    "fog": 0.06,
    "night": 0.12,
}
FOG_PER_M = (0.006, 0.03)
NIGHT_GLARE, DIM_GLARE = (3.0, 25.0), (0.3, 2.0)  # scattered light, relative to the saturation of a pixel
SATURATED, LAMP = np.uint8(200), 235  # grey levels from which light scatters, and that only lamps reach
BEAM_SCALE = 2  # beams are drawn in a picture that is smaller than the camera's by this factor
GLARE_SCALE = 4  # glare is computed in a picture that is smaller by this factor
BEAM = ((0.5, -0.7), (16.0, -3.5), (16.0, 3.0), (0.5, 0.7))  # lit ground before a car: ahead and left, m
# Changes a drawing, RGB uint8, larger than the picture.
Effect = Callable[[np.ndarray], np.ndarray]


def sample_sky(rng: np.random.Generator, weather: str) -> Light:
    """Draws the light of a kind of weather."""
    if weather in ("low sun", "night"):
        light = sample_light(rng, ENVIRONMENTS, "sun")
        azimuth = rng.uniform(0, 2 * np.pi)
        elevation = np.radians(rng.uniform(4, 14) if weather == "low sun" else rng.uniform(45, 85))
        light.to_sun = np.array([*(np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])), np.sin(elevation)])
        light.dapple = 0.0
        if weather == "low sun":
            light.sun = np.array([1.0, rng.uniform(0.7, 0.9), rng.uniform(0.4, 0.75)]) * rng.uniform(1.0, 2.0)
            return light
        # Street lamps: from above, white or yellow, and a dark sky.
        light.sun = np.array([1.0, rng.uniform(0.7, 1.0), rng.uniform(0.35, 1.0)]) * rng.uniform(0.05, 0.4)
        light.sky = np.array([0.7, 0.85, 1.1]) * rng.uniform(0.03, 0.15)
        light.softness_m, light.sun_mirror = rng.uniform(0.2, 0.6), rng.uniform(0, 5)
        return light
    known = {"rain": "wet", "fog": "haze"}
    _, light = sample_weather(rng, known.get(weather, weather))
    if weather == "fog":
        light.haze = float(np.exp(rng.uniform(*np.log(FOG_PER_M))))
    return light


def effects_of(rng: np.random.Generator, weather: str, camera: Camera, cars: list[PlacedCar]) -> list[Effect]:
    """Returns the changes of the light between the scene and the sensor."""
    seed = int(rng.integers(2**32))
    effects: list[Effect] = []
    if weather == "night":
        effects += [lambda image: lamp_pools(np.random.default_rng([seed, 0]), image), lambda image: beams(image, camera, cars)]
    if weather in ("night", "rain", "dusk"):
        strength = NIGHT_GLARE if weather == "night" else DIM_GLARE
        effects += [lambda image: glare(np.random.default_rng([seed, 1]), image, strength)]
    if weather == "rain":
        effects += [lambda image: rain(np.random.default_rng([seed, 2]), image)]
    return effects


def beams(image: np.ndarray, camera: Camera, cars: list[PlacedCar]) -> np.ndarray:
    """Returns the picture with the ground lit before cars that drive in the dark."""
    zoom = 1 / BEAM_SCALE  # the light has no sharp edges
    width, height = (round(n * zoom) for n in camera.image_size_px)
    lit = np.zeros((height, width), np.float32)
    for car in cars:
        if car.appearance.headlamp <= 0:
            continue
        front = float(car.gpu.bounds[1][0])
        corners = np.array([(front + ahead, side, 0.0, 1.0) for ahead, side in BEAM])
        pixels, depth = camera.pixel_from_world((corners @ car.world_from_car.T)[:, :3])
        if depth.min() > 1:
            part = np.zeros_like(lit)
            cv2.fillConvexPoly(part, np.rint(pixels * zoom).astype(np.int32).clip(-20000, 20000), 1.0)
            across = np.ptp(pixels, axis=0).min() * zoom
            lit = np.maximum(lit, cv2.GaussianBlur(part, (0, 0), float(np.clip(0.2 * across, 0.5, 10))))
    lit = cv2.resize(lit, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return (image * (1 + 1.8 * lit[..., None]) + 14 * lit[..., None]).clip(0, 255).astype(np.uint8)


def lamp_pools(rng: np.random.Generator, image: np.ndarray) -> np.ndarray:
    """Returns the picture with bright and dark parts, as street lamps light it; most of it is dark."""
    height, width = image.shape[:2]
    rows, columns = int(rng.integers(2, 5)), int(rng.integers(2, 6))
    level = np.exp(rng.uniform(np.log(0.12), np.log(1.1), (rows, columns))).astype(np.float32)
    level = cv2.resize(level, (width, height), interpolation=cv2.INTER_CUBIC).clip(0.08, 1.2)
    lamps = image.max(2, keepdims=True) > LAMP  # they shine in the dark, too
    return np.where(lamps, image, (image * level[..., None]).clip(0, 255)).astype(np.uint8)


def glare(rng: np.random.Generator, image: np.ndarray, strengths: tuple[float, float]) -> np.ndarray:
    """Returns the picture with light scattered around its brightest points."""
    size = image.shape[1::-1]
    small = (max(size[0] // GLARE_SCALE, 1), max(size[1] // GLARE_SCALE, 1))
    bright = cv2.resize(np.maximum(image, SATURATED) - SATURATED, small, interpolation=cv2.INTER_AREA).astype(np.float32)
    width, strength = small[0] * np.exp(rng.uniform(np.log(0.004), np.log(0.015))), np.exp(rng.uniform(*np.log(strengths)))
    scattered = (cv2.GaussianBlur(bright, (0, 0), width) + cv2.GaussianBlur(bright, (0, 0), width * 4)) * strength
    return (image + cv2.resize(scattered, size, interpolation=cv2.INTER_LINEAR)).clip(0, 255).astype(np.uint8)


def rain(rng: np.random.Generator, image: np.ndarray) -> np.ndarray:
    """Returns the picture with streaks of rain and less contrast."""
    height, width = image.shape[:2]
    drops = np.zeros((height, width), np.float32)
    angle, length = rng.normal(np.pi / 2, 0.15), rng.uniform(0.01, 0.05) * height
    away = (int(length * np.cos(angle)), int(length * np.sin(angle)))
    for x, y in rng.uniform(0, 1, (int(rng.integers(100, 900)), 2)) * [width, height]:
        cv2.line(drops, (int(x), int(y)), (int(x) + away[0], int(y) + away[1]), float(rng.uniform(0.1, 0.5)), 1)
    veil = rng.uniform(0.05, 0.3)
    grey = image.mean(axis=(0, 1), keepdims=True)
    faded = image * (1 - veil) + grey * veil
    return (faded + (235 - faded) * cv2.GaussianBlur(drops, (0, 0), 1.0)[..., None]).clip(0, 255).astype(np.uint8)
