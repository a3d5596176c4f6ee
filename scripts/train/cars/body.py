"""The skin of a car as two lofts: the tub (up to the shoulder, closed by bonnet and boot) and the cabin on top of it.

Both are swept along outlines in plan. Coordinate u runs from the centre of the nose (0) along the left side to the
centre of the tail (1). Coordinate v runs up: 0 lower edge, 1 upper edge of the ring, then over the top to the centre
line at 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from .style import Style

# u at the corners of the outline: front face, front corner, side, rear corner, rear face
TURNS = (0.0, 0.22, 0.34, 0.68, 0.80, 1.0)


@dataclass(frozen=True)
class Corners:
    """Plan outline of a ring: corner radii along x and y, bow of the end faces (metres)."""

    front: tuple[float, float]
    rear: tuple[float, float]
    front_bow: float
    rear_bow: float


def outline(
    u: np.ndarray, x_front: np.ndarray, x_rear: np.ndarray, half_width: np.ndarray, c: Corners
) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y ≥ 0) of a rounded plan outline; arguments broadcast."""
    u, x_front, x_rear, half_width = np.broadcast_arrays(u, x_front, x_rear, half_width)
    part = [np.clip((u - a) / (b - a), 0, 1) for a, b in pairwise(TURNS)]
    (fx, fy), (rx, ry) = c.front, c.rear
    turn_f, turn_r = part[1] * np.pi / 2, part[3] * np.pi / 2
    y_f = part[0] * (half_width - fy) + fy * np.sin(turn_f)
    x_f = x_front - fx * (1 - np.cos(turn_f)) - c.front_bow * (y_f / half_width) ** 2
    y_r = (1 - part[4]) * (half_width - ry) + ry * np.cos(turn_r)
    x_r = x_rear + rx * (1 - np.sin(turn_r)) + c.rear_bow * (y_r / half_width) ** 2
    side = part[2]
    x_side = (1 - side) * (x_front - fx - c.front_bow) + side * (x_rear + rx + c.rear_bow)
    x = np.where(u <= TURNS[2], x_f, np.where(u < TURNS[3], x_side, x_r))
    y = np.where(u <= TURNS[2], y_f, np.where(u < TURNS[3], half_width, y_r))
    return x, y


class Body:
    """Surfaces of one car, evaluated anywhere: `tub(u, v)`, `cabin(u, v)` → points (…, 3)."""

    def __init__(self, style: Style) -> None:
        self.style = s = style
        self.half_width = s.width / 2
        h = s.height
        self.cowl = np.array([s.wheelbase / 2 + s.cowl_dx, s.cowl_z * h])
        self.header = self._up(self.cowl, s.header_z * h, -1, s.screen_rake)
        self.backlight = np.array([s.x_rear + max(s.backlight_dx, 0.06), s.backlight_z * h])
        self.tailgate = self._up(self.backlight, s.tailgate_z * h, 1, s.backlight_rake)
        self.belt_rear_z = (s.belt_front_z + s.belt_rise) * h
        boxy = s.body in ("suv", "pickup", "van")
        # how far front and rear are set back from the foremost and rearmost point, by v
        chin, top, tail = (0.09 if boxy else 0.07), s.nose_back, s.tail_back
        front = (chin, 0.02, 0.0, 0.15 * top, 0.35 * top, top)
        rear = (tail, 0.2 * tail, 0.0, 0.2 * tail, 0.5 * tail, tail)
        if s.body == "pickup":  # the step bumper
            rear = (0.06, 0.0, 0.0, tail - 0.01, tail, tail)
        self._front = PchipInterpolator((0, 0.18, 0.36, 0.55, 0.8, 1), front)
        self._rear = PchipInterpolator((0, 0.18, 0.36, 0.5, 0.75, 1), rear)
        shoulder = s.belt_y + 0.45 * (1 - s.belt_y)
        self._side = PchipInterpolator((0, 0.08, 0.3, 0.55, 0.8, 0.93, 1), (0.925, 0.962, 0.995, 1.0, 0.988, 0.968, shoulder))
        self.tub_corners = Corners(
            (s.front_round, 0.75 * s.front_round),
            (s.rear_round, 0.85 * s.rear_round),
            s.front_bow,
            s.rear_bow,
        )
        round_front = 0.11 if s.body != "van" else 0.08
        round_rear = 0.12 if s.body in ("sedan", "coupe") else 0.10
        self.cabin_corners = Corners(
            (round_front, 0.10),
            (round_rear, 0.10 if s.body != "van" else 0.06),
            s.screen_bow,
            s.backlight_bow,
        )

    @staticmethod
    def _up(start: np.ndarray, z: float, direction: int, rake_deg: float) -> np.ndarray:
        return np.array([start[0] + direction * (z - start[1]) / np.tan(np.radians(rake_deg)), z])

    def _bonnet_edge(self, middle: float) -> float:
        """Returns the position where the bonnet curves down to the nose; a van's bonnet is short."""
        return max(self.style.x_front - 0.2, middle + 0.02)

    @cached_property
    def shoulder_z(self) -> PchipInterpolator:
        """Height of the tub's upper edge along x."""
        s, h = self.style, self.style.height
        nose, belt = s.nose_z * h, s.belt_front_z * h
        cowl_x = self.cowl[0] - s.screen_bow
        middle = 0.5 * (s.x_front + cowl_x)
        edge = self._bonnet_edge(middle)
        tail = s.tail_z * h
        x = [
            s.x_rear,
            s.x_rear + 0.22,
            -s.wheelbase / 2 + 0.15,
            cowl_x - 0.3,
            middle,
            edge,
            s.x_front,
        ]
        z = [tail - 0.015, 0.6 * tail + 0.4 * self.belt_rear_z, self.belt_rear_z, belt + 0.004,
             0.45 * nose + 0.55 * belt + 0.025, nose + 0.04, nose]  # fmt: skip
        if s.body == "pickup":
            z[0] = z[1] = tail
        return PchipInterpolator(x, z)

    @cached_property
    def centre_z(self) -> PchipInterpolator:
        """Height of bonnet, cabin floor line and boot on the centre line along x."""
        s, h = self.style, self.style.height
        nose, tail = s.nose_z * h, s.tail_z * h
        middle = 0.5 * (s.x_front + self.cowl[0])
        edge = self._bonnet_edge(middle)
        lip = s.x_rear + min(0.12, 0.5 * (self.backlight[0] - s.x_rear))
        x = [s.x_rear, lip, self.backlight[0], self.cowl[0], middle, edge, s.x_front]  # fmt: skip
        z = [tail, tail + 0.012, self.backlight[1], self.cowl[1], 0.42 * nose + 0.58 * self.cowl[1] + 0.035,
             nose + 0.06, nose]  # fmt: skip
        if s.body == "pickup":
            z[:2] = [float(self.shoulder_z(s.x_rear)) + 0.002] * 2
            x[2:3], z[2:3] = [self.backlight[0] - 0.05, self.backlight[0]], [z[0], z[0] + 0.03]
        return PchipInterpolator(x, z)

    @cached_property
    def bottom_z(self) -> PchipInterpolator:
        """Height of the tub's lower edge along x."""
        s, h, a = self.style, self.style.height, self.style.wheelbase / 2
        x = [s.x_rear, -a - 0.3, -a + 0.4, a - 0.4, a + 0.3, s.x_front]
        low = s.ground_z * h
        z = [s.rear_bumper_z * h, 0.5 * (low + s.rear_bumper_z * h), low, low, low + 0.01, s.bumper_z * h]
        return PchipInterpolator(x, z)

    def tub(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Points of the tub; v in 0…2."""
        s = self.style
        u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        ring = np.clip(v, 0, 1)
        half = self._side(ring) * self.half_width
        x, y = outline(u, s.x_front - self._front(ring), s.x_rear + self._rear(ring), half, self.tub_corners)
        y = y * self._taper(x)
        z = self.bottom_z(x) + (self.shoulder_z(x) - self.bottom_z(x)) * ring
        k = np.clip(2 - v, 0, 1)
        z = np.where(v > 1, self._deck(x, y, k), z)
        return np.stack([x, y * k, z], -1)

    def _taper(self, x: np.ndarray) -> np.ndarray:
        s = self.style
        ahead, behind = np.clip(x / s.x_front, 0, 1), np.clip(x / s.x_rear, 0, 1)
        return 1 - 0.035 * ahead**2 - 0.03 * behind**2

    def _deck(self, x: np.ndarray, y_ring: np.ndarray, k: np.ndarray) -> np.ndarray:
        edge, centre = self.shoulder_z(x), self.centre_z(x)
        crown = (centre - edge) * np.clip(y_ring / (0.9 * self.half_width), 0, 1) ** 2
        return edge + crown * (1 - k**3)

    @cached_property
    def _shoulder_ring(self) -> tuple[np.ndarray, np.ndarray]:
        ring = self.tub(np.linspace(0, 1, 161), 1.0)
        return ring[::-1, 0], ring[::-1, 1]

    def deck_z(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Height of the tub's top at (x, y)."""
        ring = np.interp(x, *self._shoulder_ring).clip(0.05)
        return self._deck(x, ring, np.clip(np.abs(y) / ring, 0, 1))

    @cached_property
    def roof_edge_z(self) -> PchipInterpolator:
        """Height of the roof's edge along x."""
        (xh, zh), (xt, zt) = self.header, self.tailgate
        h = self.style.height
        x = [xt, xt + 0.3 * (xh - xt), xt + 0.65 * (xh - xt), xh]
        side = (1 - self.style.roof_crown) * h
        return PchipInterpolator(x, [zt - 0.03, max(side - 0.008, zt - 0.02), max(side, zh - 0.02), zh - 0.03])

    @cached_property
    def roof_centre_z(self) -> PchipInterpolator:
        """Height of the roof's centre line along x; its top is the car's height."""
        (xh, zh), (xt, zt) = self.header, self.tailgate
        h = self.style.height
        x = [xt, xt + 0.22 * (xh - xt), xt + self.style.roof_peak * (xh - xt), xt + 0.88 * (xh - xt), xh]
        return PchipInterpolator(x, [zt, zt + 0.72 * (h - zt), h, zh + 0.62 * (h - zh), zh])

    def roof_z(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Height of the roof at (x, y)."""
        edge, centre = self.roof_edge_z(x), self.roof_centre_z(x)
        return edge + (centre - edge) * (1 - (y / (self.style.roof_y * self.half_width)).clip(0, 1) ** 2.6)

    def cabin(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Points of the cabin; v in 0…2, from the tub's top to the roof's centre line."""
        s = self.style
        u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        t = np.clip(v, 0, 1)
        c = self.cabin_corners
        x0, y0 = outline(u, self.cowl[0], self.backlight[0], s.belt_y * self.half_width, c)
        top = Corners(c.front, c.rear, 0.6 * c.front_bow, 0.7 * c.rear_bow)
        x1, y1 = outline(u, self.header[0], self.tailgate[0], s.roof_y * self.half_width, top)
        y0 = y0 * self._taper(x0)
        z0, z1 = self.deck_z(x0, y0) - 0.004, self.roof_z(x1, y1)
        bulge = 4 * t * (1 - t)
        middle = 0.5 * (self.header[0] + self.tailgate[0])
        along = np.clip((x1 - middle) / (self.header[0] - middle), -1, 1)
        x = (1 - t) * x0 + t * x1 + 0.012 * bulge * along * (1 - (y1 / self.half_width) ** 2)
        y = (1 - t) * y0 + t * y1 + 0.022 * bulge * y1 / self.half_width
        z = (1 - t) * z0 + t * z1 + 0.012 * bulge * np.abs(along)
        k = np.clip(2 - v, 0, 1)
        z = np.where(v > 1, self.roof_z(x, y * k), z)
        return np.stack([x, y * k, z], -1)
