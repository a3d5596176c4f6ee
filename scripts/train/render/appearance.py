"""Appearance of things: car paints and trims, grounds, light."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass
class CarAppearance:
    """The appearance of a car: linear RGB albedos and surface parameters."""

    paint: np.ndarray
    metallic: float  # 0 solid paint … 1 strong flakes
    lower: np.ndarray  # colour of bumpers and trims (material `plastic`)
    glass: float  # transmittance of a pane
    glass_reflection: float
    rim: np.ndarray
    dirt: float
    dirt_colour: np.ndarray
    plate: np.ndarray
    taillamp: float  # 0 off … lit
    headlamp: float
    interior: np.ndarray
    seed: float
    livery: np.ndarray = field(default_factory=lambda: np.full(3, 0.7))  # second paint


def _linear(*rgb: float) -> np.ndarray:
    """Converts sRGB 0…255 to linear."""
    return (np.array(rgb) / 255.0) ** 2.2


def sample_paint(rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Draws linear RGB and metallic share; frequencies roughly as in traffic statistics of paint makers (estimate)."""
    kind = rng.choice(9, p=[0.24, 0.17, 0.15, 0.14, 0.09, 0.09, 0.04, 0.04, 0.04])
    grey = np.ones(3) * (1 + rng.normal(0, 0.012, 3))
    if kind == 0:
        return grey * rng.uniform(0.55, 0.85), 0.0 if rng.random() < 0.7 else 0.3
    if kind == 1:
        return grey * rng.uniform(0.006, 0.025), rng.uniform(0, 0.6)
    if kind == 2:
        return grey * rng.uniform(0.05, 0.2), rng.uniform(0.3, 1)
    if kind == 3:
        return grey * rng.uniform(0.28, 0.5), rng.uniform(0.6, 1)
    hue, saturation, value = (
        (rng.normal(0.61, 0.03), rng.uniform(0.5, 0.95), rng.uniform(0.15, 0.7)),  # blue
        (rng.normal(0.995, 0.012), rng.uniform(0.75, 0.97), rng.uniform(0.3, 0.8)),  # red
        (rng.uniform(0.25, 0.5), rng.uniform(0.3, 0.8), rng.uniform(0.15, 0.5)),  # green
        (rng.uniform(0.06, 0.12), rng.uniform(0.2, 0.6), rng.uniform(0.3, 0.75)),  # brown, beige
        (rng.uniform(0, 1), rng.uniform(0.4, 0.95), rng.uniform(0.3, 0.95)),  # anything
    )[kind - 4]
    return np.array(colorsys.hsv_to_rgb(hue % 1, saturation, value)) ** 2.2, rng.uniform(0, 1)


def sample_car_appearance(rng: np.random.Generator) -> CarAppearance:
    """Draws a random car finish."""
    paint, metallic = sample_paint(rng)
    lower = np.ones(3) * rng.uniform(0.01, 0.06) if rng.random() < 0.8 else paint * rng.uniform(0.7, 1)
    rim = np.ones(3) * (rng.uniform(0.25, 0.6) if rng.random() < 0.75 else rng.uniform(0.01, 0.1))
    return CarAppearance(
        paint=paint,
        metallic=metallic,
        lower=lower,
        glass=rng.choice([rng.uniform(0.05, 0.3), rng.uniform(0.3, 0.8)]),
        glass_reflection=rng.uniform(0.7, 1.3),
        rim=rim,
        dirt=max(0, rng.normal(0.05, 0.25)),
        dirt_colour=_linear(*(np.array([130, 118, 98]) * rng.uniform(0.7, 1.3) + rng.normal(0, 5, 3))),
        plate=_linear(*(np.ones(3) * rng.uniform(170, 235) + rng.normal(0, 6, 3) if rng.random() < 0.8 else (225, 190, 60))),
        taillamp=rng.uniform(0.3, 2) if rng.random() < 0.12 else 0.0,
        headlamp=rng.uniform(1, 6) if rng.random() < 0.08 else 0.0,
        interior=np.exp(rng.uniform(np.log(0.015), np.log(0.15))) * (1 + rng.normal(0, 0.1, 3)).clip(0.7, 1.3),
        seed=rng.uniform(0, 50),
    )


# Paints of lorries and buses: sRGB of the middle, spread, share; estimates.
FLEET_PAINTS = (
    ((232, 232, 230), 12, 0.42),  # white
    ((170, 172, 176), 20, 0.1),  # silver
    ((190, 28, 30), 18, 0.12),  # red
    ((30, 80, 160), 22, 0.13),  # blue
    ((240, 190, 30), 15, 0.08),  # yellow
    ((40, 130, 70), 20, 0.06),  # green
    ((225, 105, 30), 15, 0.04),  # orange
    ((45, 47, 52), 12, 0.05),  # anthracite
)


def sample_heavy_appearance(rng: np.random.Generator) -> CarAppearance:
    """Draws a random finish of a lorry or a bus: solid paints, the second one often white."""

    def paint(kind: int) -> np.ndarray:
        middle, spread, _ = FLEET_PAINTS[kind]
        return _linear(*(np.array(middle) + rng.normal(0, spread) + rng.normal(0, spread / 4, 3)).clip(12, 245))

    first, second = rng.choice(len(FLEET_PAINTS), 2, p=[share for *_, share in FLEET_PAINTS])
    livery = paint(0 if rng.random() < 0.4 else int(second))
    return replace(
        sample_car_appearance(rng),
        paint=paint(int(first)),
        metallic=0.0,
        lower=np.ones(3) * rng.uniform(0.015, 0.08),
        glass=0.0,  # the space behind their panes is not modelled
        glass_reflection=rng.uniform(0.3, 0.9),
        rim=np.ones(3) * rng.uniform(0.3, 0.65),
        livery=livery,
    )


@dataclass
class Ground:
    """One ground material: two linear colours mixed by noise."""

    low: np.ndarray
    high: np.ndarray
    scales: tuple[float, float, float]  # strength of noise over tens of metres, metres, centimetres
    stains: float
    cracks: float
    gloss: float  # wetness


def sample_ground(rng: np.random.Generator, kind: str) -> Ground:
    """Draws a ground: `asphalt`, `concrete`, `grass`, `gravel`."""
    tint = 1 + rng.normal(0, 0.03, 3)
    if kind == "asphalt":
        level = np.exp(rng.uniform(np.log(0.03), np.log(0.18)))
        wet = rng.uniform(0.2, 1) if rng.random() < 0.15 else 0.0
        low, high = level * rng.uniform(0.65, 0.95), level * rng.uniform(1.05, 1.4)
        return Ground(
            low * tint,
            high * tint,
            (rng.uniform(0.3, 1.2), rng.uniform(0.2, 1), rng.uniform(0.1, 0.7)),
            rng.uniform(0, 0.7),
            rng.uniform(0, 0.8) * (rng.random() < 0.6),
            wet,
        )
    if kind == "concrete":
        level = rng.uniform(0.2, 0.45)
        warm = np.array([1.04, 1, rng.uniform(0.82, 1)])
        return Ground(
            level * 0.85 * warm * tint,
            level * 1.15 * warm * tint,
            (rng.uniform(0.3, 1), rng.uniform(0.2, 1), rng.uniform(0.1, 0.5)),
            rng.uniform(0, 0.5),
            rng.uniform(0, 0.6),
            0.0,
        )
    if kind == "gravel":
        level = rng.uniform(0.12, 0.35)
        warm = np.array([1.1, 1, rng.uniform(0.7, 0.95)])
        return Ground(
            level * 0.6 * warm * tint,
            level * 1.3 * warm * tint,
            (rng.uniform(0.2, 0.8), rng.uniform(0.4, 1.2), rng.uniform(0.8, 1.6)),
            rng.uniform(0, 0.3),
            0.0,
            0.0,
        )
    green = _linear(*rng.uniform([55, 70, 30], [110, 115, 60]))
    dry = _linear(*rng.uniform([110, 100, 60], [160, 145, 95]))
    mix = rng.uniform(0, 1) ** 2
    low = green * (1 - mix) + dry * mix
    return Ground(
        low * 0.7,
        (low * rng.uniform(1.1, 1.6) * 0.6 + dry * 0.25),
        (rng.uniform(0.4, 1), rng.uniform(0.6, 1.4), rng.uniform(0.8, 1.8)),
        0.0,
        0.0,
        0.0,
    )


@dataclass
class Light:
    """Sun and sky; irradiances on a scale where full sun on a level surface is about 1."""

    to_sun: np.ndarray  # unit vector, world
    sun: np.ndarray  # linear RGB, 0 under an overcast sky
    sky: np.ndarray  # linear RGB irradiance from the upper half sphere
    softness_m: float  # width of shadow edges
    dapple: float  # share of sun lost in leaf shadow
    haze: float  # 1 / m
    environment: int  # row of the environment pool
    exposure: float
    sun_mirror: float  # strength of the sun's mirror image

    @property
    def level(self) -> np.ndarray:
        """Returns the irradiance on the open ground."""
        return self.sun * max(self.to_sun[2], 0.0) + self.sky


SKIES = ("sun", "haze", "overcast", "dusk")  # dusk: also in open shade


def sample_light(rng: np.random.Generator, environments: int, sky: str | None = None) -> Light:
    """Draws a light: clear, hazy and overcast skies, open shade, low sun; one of SKIES if given."""
    elevation = np.radians(rng.uniform(12, 70))
    azimuth = rng.uniform(0, 2 * np.pi)
    to_sun = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    warm = np.array([1, 0.97 - 0.12 * np.exp(-elevation * 4), 0.9 - 0.45 * np.exp(-elevation * 4)])
    blue = np.array([0.75, 0.92, 1.2])
    kind = rng.choice(4, p=[0.45, 0.2, 0.25, 0.1])
    if sky is not None:
        kind = SKIES.index(sky)
    if kind == 0:  # clear
        sun, above = warm * rng.uniform(0.8, 1.2), blue * rng.uniform(0.12, 0.3)
    elif kind == 1:  # hazy
        sun, above = warm * rng.uniform(0.2, 0.7), (0.5 * blue + 0.5) * rng.uniform(0.25, 0.5)
    elif kind == 2:  # overcast
        sun, above = warm * 0.0, (1 + rng.normal(0, 0.04, 3)) * rng.uniform(0.4, 0.8)
    else:  # open shade, dusk
        sun, above = warm * 0.0, (0.6 * blue + 0.4) * rng.uniform(0.3, 0.5)
    return Light(
        to_sun,
        sun,
        above,
        softness_m=rng.uniform(0.02, 0.12) if kind == 0 else rng.uniform(0.08, 0.4),
        dapple=rng.uniform(0.5, 1) if rng.random() < 0.08 else 0.0,
        haze=rng.exponential(0.0006),
        environment=int(rng.integers(environments)),
        exposure=1.0,
        sun_mirror=rng.uniform(5, 60) if kind == 0 else rng.uniform(0, 5) * (kind == 1),
    )
