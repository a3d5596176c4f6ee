"""Shape parameters of a built car: all that a specification leaves open, drawn about a mean for each body type.

Means and spreads are ESTIMATES read off side, front and rear views of cars of 1998–2018. Each base model has a
character of its own (seeded by its name), and each car drawn from it varies a little more.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np

from .mesh import BODY_TYPES
from .specs import SPECS, TRAFFIC_SHARE, Spec

# parameter: unit, spread between models, spread within a model, then the mean for each of BODY_TYPES.
# Heights are fractions of the car's height, half widths of half its width, so that they scale with it.
#                 models within  sedan hatch wagon suv   mivan van   pick  coupe
_PRIOR = {
    # windscreen: centre of its lower edge from the front axle (m), slope from horizontal (deg), heights
    "cowl_dx":        (0.07, 0.02, (-0.185, -0.115, -0.185, -0.245, 0.075, 0.235, -0.345, -0.325)),
    "screen_rake":    (1.8, 0.5, (27.4, 29.4, 28.4, 33.4, 28.4, 40.4, 34.4, 25.9)),
    "cowl_z":         (0.010, 0.003, (0.691, 0.681, 0.686, 0.686, 0.656, 0.601, 0.681, 0.706)),
    "header_z":       (0.006, 0.002, (0.945, 0.945, 0.945, 0.945, 0.945, 0.90, 0.945, 0.945)),
    # rear window: lower edge relative to the rear end (m), slope, heights
    "backlight_dx":   (0.06, 0.02, (0.49, 0.13, 0.12, 0.1, 0.08, 0.08, 2.05, 0.43)),
    "backlight_rake": (2.0, 0.7, (24.8, 42.3, 50, 60, 63, 84, 80, 21.3)),
    "backlight_z":    (0.015, 0.004, (0.727, 0.71, 0.69, 0.665, 0.625, 0.56, 0.665, 0.743)),
    "tailgate_z":     (0.006, 0.002, (0.945, 0.925, 0.925, 0.925, 0.91, 0.87, 0.935, 0.94)),
    # Side glass: height of its lower edge in front and its rise; rear corner ahead of the rear axle (m). Pillar behind
    # the front door, from the glass's front corner (m).
    "belt_front_z":   (0.010, 0.003, (0.598, 0.588, 0.588, 0.588, 0.553, 0.503, 0.593, 0.603)),
    "belt_rise":      (0.012, 0.003, (0.108, 0.138, 0.103, 0.096, 0.08, 0.05, 0.075, 0.128)),
    "quarter_dx":     (0.08, 0.02, (0.04, -0.1, -0.57, -0.42, -0.67, -0.57, 0.84, 0.01)),
    "b_pillar":       (0.05, 0.012, (1.02, 1.02, 1.02, 1.00, 1.08, 1.05, 0.98, 1.28)),
    # half widths: side glass at the belt and at its top, roof
    "belt_y":         (0.012, 0.004, (0.895, 0.90, 0.90, 0.905, 0.915, 0.93, 0.905, 0.885)),
    "roof_y":         (0.018, 0.005, (0.685, 0.705, 0.715, 0.74, 0.75, 0.81, 0.725, 0.665)),
    # bow of the windscreen and rear window in plan (m, centre ahead of the corner)
    "screen_bow":     (0.03, 0.01, (0.13, 0.12, 0.13, 0.11, 0.16, 0.1, 0.09, 0.13)),
    "backlight_bow":  (0.03, 0.01, (0.13, 0.08, 0.07, 0.06, 0.05, 0.03, 0.05, 0.14)),
    # bonnet's leading edge, height of the shoulder at the tail, front and rear corner rounding (m in plan)
    "nose_z":         (0.014, 0.004, (0.49, 0.495, 0.49, 0.545, 0.48, 0.465, 0.58, 0.485)),
    "tail_z":         (0.014, 0.004, (0.690, 0.665, 0.665, 0.635, 0.600, 0.545, 0.615, 0.705)),
    "front_round":    (0.05, 0.01, (0.30, 0.29, 0.29, 0.24, 0.28, 0.24, 0.16, 0.30)),
    "rear_round":     (0.04, 0.01, (0.24, 0.20, 0.20, 0.18, 0.17, 0.11, 0.12, 0.24)),
    "front_bow":      (0.03, 0.008, (0.14, 0.12, 0.13, 0.10, 0.12, 0.09, 0.07, 0.14)),
    "rear_bow":       (0.02, 0.006, (0.09, 0.08, 0.08, 0.06, 0.06, 0.03, 0.03, 0.09)),
    "bumper_z":       (0.010, 0.003, (0.150, 0.150, 0.150, 0.175, 0.135, 0.145, 0.210, 0.145)),
    "rear_bumper_z":  (0.012, 0.003, (0.235, 0.225, 0.23, 0.245, 0.205, 0.205, 0.27, 0.235)),
    # headlamp: how far it extends back along the side (m), inner corner, gap below the shoulder, height (m)
    "lamp_back":      (0.09, 0.02, (0.38, 0.38, 0.36, 0.28, 0.42, 0.34, 0.16, 0.4)),
    "lamp_inner_y":   (0.05, 0.01, (0.50, 0.50, 0.51, 0.53, 0.52, 0.56, 0.60, 0.50)),
    "lamp_drop":      (0.015, 0.004, (0.015, 0.015, 0.015, 0.03, 0.015, 0.03, 0.06, 0.015)),
    "lamp_height":    (0.018, 0.004, (0.130, 0.135, 0.130, 0.150, 0.150, 0.180, 0.190, 0.115)),
    # tail lamp, likewise
    "tail_forward":   (0.06, 0.02, (0.28, 0.24, 0.22, 0.18, 0.17, 0.12, 0.12, 0.28)),
    "tail_inner_y":   (0.07, 0.015, (0.51, 0.7, 0.74, 0.76, 0.8, 0.86, 0.84, 0.52)),
    "tail_drop":      (0.025, 0.005, (0.06, 0.04, 0.05, 0.05, 0.05, 0.2, 0.06, 0.045)),
    "tail_height":    (0.030, 0.006, (0.17, 0.19, 0.23, 0.24, 0.3, 0.3, 0.26, 0.145)),
    # mirror: how far it protrudes beyond half the body's width (m), size
    "mirror_out":     (0.03, 0.01, (0.10, 0.10, 0.10, 0.12, 0.12, 0.15, 0.16, 0.09)),
    "mirror_size":    (0.01, 0.004, (0.14, 0.14, 0.14, 0.17, 0.17, 0.24, 0.20, 0.13)),
    "tyre_width":     (0.012, 0.004, (0.205, 0.185, 0.205, 0.235, 0.215, 0.205, 0.255, 0.225)),
    "ground_z":       (0.006, 0.003, (0.135, 0.135, 0.140, 0.155, 0.120, 0.125, 0.190, 0.125)),
    # How far the bonnet's and the tail's edge are set back from the bumper (m). Roof: position of its highest point
    # (share of its length from the rear), drop to its edge.
    "nose_back":      (0.03, 0.008, (0.10, 0.10, 0.10, 0.08, 0.11, 0.10, 0.06, 0.11)),
    "tail_back":      (0.02, 0.005, (0.08, 0.08, 0.08, 0.08, 0.07, 0.05, 0.10, 0.08)),
    "roof_peak":      (0.05, 0.01, (0.62, 0.66, 0.60, 0.60, 0.60, 0.60, 0.60, 0.62)),
    "roof_crown":     (0.006, 0.002, (0.048, 0.048, 0.046, 0.042, 0.044, 0.050, 0.045, 0.052)),
}  # fmt: skip


@dataclass(frozen=True)
class Style:
    """One car: its dimensions (metres) and shape parameters (units as in the table above)."""

    name: str
    body: str
    length: float
    width: float
    height: float
    wheelbase: float
    front_overhang: float
    track: float
    tyre_radius: float
    shape: dict[str, float]

    def __getattr__(self, key: str) -> float:
        try:
            return self.__dict__["shape"][key]
        except KeyError:
            raise AttributeError(key) from None

    @property
    def x_front(self) -> float:
        return self.wheelbase / 2 + self.front_overhang

    @property
    def x_rear(self) -> float:
        return self.x_front - self.length


def _shape(body: str, spread: int, rng: np.random.Generator) -> dict[str, float]:
    """Draws the deviation of every shape parameter, cut at 2.2 standard deviations."""
    return {key: row[spread] * float(np.clip(rng.normal(), -2.2, 2.2)) for key, row in _PRIOR.items()}


def model_style(spec: Spec) -> Style:
    """Returns the base model itself: published dimensions and the model's own character."""
    rng = np.random.default_rng(zlib.crc32(spec.name.encode()))
    index = BODY_TYPES.index(spec.body)
    deviation = _shape(spec.body, 0, rng)
    shape = {key: row[2][index] + deviation[key] for key, row in _PRIOR.items()}
    if spec.body == "pickup":
        # space beside the bed: regular, extended or double cab by the model's name and wheelbase
        bed = 1.55 if spec.name.endswith(("crew", "dc")) else 1.85
        shape["backlight_dx"] = (2.05 if spec.name.endswith("regular") else bed) * spec.length / 5.4
        shape["quarter_dx"] = 0.0
    return Style(
        spec.name, spec.body, spec.length, spec.width, spec.height, spec.wheelbase, spec.front_overhang,
        spec.track, spec.tyre_diameter / 2, shape,
    )  # fmt: skip


def vary(style: Style, rng: np.random.Generator) -> Style:
    """Returns a car near a base model: dimensions within about 1.5 %, length and wheelbase together."""
    n = rng.normal(size=6).clip(-2, 2)
    long = 1 + 0.012 * n[0]
    deviation = _shape(style.body, 1, rng)
    if style.body == "hatchback" and rng.random() < 0.2:  # three doors: the pillar is further back
        deviation["b_pillar"] += 0.22
    return replace(
        style,
        length=style.length * long,
        wheelbase=style.wheelbase * (long + 0.006 * n[1]),
        front_overhang=style.front_overhang * (long + 0.015 * n[2]),
        width=style.width * (1 + 0.010 * n[3]),
        track=style.track * (1 + 0.010 * n[3] + 0.003 * n[4]),
        height=style.height * (1 + 0.012 * n[5]),
        tyre_radius=style.tyre_radius * (1 + 0.012 * n[4]),
        shape={key: value + deviation[key] for key, value in style.shape.items()},
    )


def sample_style(rng: np.random.Generator, body: str | None = None, split: str = "train") -> Style:
    """Returns a random car of a split; the body type follows traffic when not given."""
    if body is None:
        body = str(rng.choice(BODY_TYPES, p=np.array([TRAFFIC_SHARE[b] for b in BODY_TYPES])))
    specs = [s for s in SPECS if s.body == body and s.split == split]
    return vary(model_style(specs[rng.integers(len(specs))]), rng)
