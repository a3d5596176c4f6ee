"""Positions of the parts of a car: lamps, glass, pillars, wheels; the keypoints follow from them."""

from __future__ import annotations

import numpy as np

from . import details
from .body import TURNS, Body
from .surface import Shell

# Where glass begins and ends on the cabin: v of lower and upper edge, and u of the panes' corners there.
GLASS_V = (0.055, 0.955)
BACK_V = (0.10, 0.955)
SCREEN_U = (0.231, 0.243)  # just round the cabin's front corner
SIDE_U = (0.352, 0.672)
BACK_U = (0.812, 0.787)


class Layout:
    """Positions on the left half of one car, in metres or in u and v of the surfaces of `Body`."""

    def __init__(self, body: Body, panel_van: bool) -> None:
        self.body, self.style = body, body.style
        s = self.style
        self.axle = s.wheelbase / 2
        self.tyre_face = min(s.track / 2 + s.tyre_width / 2, body.half_width - 0.02)
        self.hub = np.array([self.axle, self.tyre_face - 0.015, s.tyre_radius])
        self.arch = s.tyre_radius * (1.12 if s.body in ("suv", "pickup") else 1.085) + 0.01
        u = np.linspace(0, 1, 401)
        self._u, self._sill = u, body.cabin(u, GLASS_V[0])
        self.head = body.cabin(u, GLASS_V[1])
        self.side_front = body.cabin(SIDE_U[0], GLASS_V[0])
        rear_limit = float(body.cabin(SIDE_U[1] - 0.01, GLASS_V[0])[0])
        self.quarter_x = max(s.quarter_dx - self.axle, rear_limit)
        if s.body == "pickup":
            self.quarter_x = rear_limit + 0.02
        self.pillar_x = max(self.side_front[0] - s.b_pillar, self.quarter_x + 0.02)
        self.panel_van = panel_van
        if self.panel_van:
            self.quarter_x = self.pillar_x
        rest = self.pillar_x - self.quarter_x
        self.two_doors = s.body == "coupe" or self.panel_van or rest < 0.25
        # the pickup's bed: rear and front end, half width
        self.bed = (s.x_rear + 0.17, body.backlight[0] - 0.06, 0.80 * body.half_width)
        self._lamps()

    def on_sill(self, x: float) -> np.ndarray:
        """Point of the side glass's lower edge at x."""
        side = (self._u > SIDE_U[0] - 0.02) & (self._u < TURNS[4])
        return np.array([np.interp(-x, -self._sill[side, 0], self._sill[side, a]) for a in range(3)])

    def _tub_u(self, v: float, x: float | None = None, y: float | None = None, rear: bool = False) -> float:
        """Returns u of the tub's ring v at a position x along the side, or y across the front or rear face."""
        u = np.linspace(0, 0.5, 201) if not rear else np.linspace(1, 0.5, 201)
        ring = self.body.tub(u, v)
        if x is not None:
            order = np.argsort(ring[:, 0])
            return float(np.interp(x, ring[order, 0], u[order]))
        face = u >= 0.5 * (TURNS[3] + TURNS[4]) if rear else u <= 0.5 * (TURNS[1] + TURNS[2])
        return float(np.interp(y, ring[face, 1], u[face]))

    def _lamps(self) -> None:
        """Corners of head and tail lamp in (u, v): inner top, inner bottom, outer bottom, outer top."""
        s, body, half = self.style, self.body, self.body.half_width
        top = 0.985

        def v_at(u: float, drop: float) -> float:
            span = body.tub(u, 1.0)[2] - body.tub(u, 0.0)[2]
            return top - drop / float(span)

        inner = self._tub_u(0.9, y=s.lamp_inner_y * half)
        outer = self._tub_u(0.9, x=float(body.tub(0.0, 0.9)[0]) - max(s.lamp_back, s.front_bow + 0.05))
        gap, tall = s.lamp_drop, s.lamp_height
        self.head_lamp = [
            (inner, v_at(inner, gap + 0.1 * tall)), (inner, v_at(inner, gap + 0.7 * tall)),
            (outer, v_at(outer, gap + 0.7 * tall)), (outer, v_at(outer, gap + 0.2 * tall)),
        ]  # fmt: skip
        inner = self._tub_u(0.9, y=s.tail_inner_y * half, rear=True)
        outer = self._tub_u(0.9, x=float(body.tub(1.0, 0.9)[0]) + max(s.tail_forward, s.rear_bow + 0.03), rear=True)
        gap, tall = s.tail_drop, s.tail_height
        self.tail_lamp = [
            (inner, v_at(inner, gap)), (inner, v_at(inner, gap + 0.85 * tall)),
            (outer, v_at(outer, gap + tall)), (outer, v_at(outer, gap)),
        ]  # fmt: skip

    def keypoints(self) -> dict[str, np.ndarray]:
        """The left side's keypoints by name, from the same construction as the mesh."""
        body = self.body
        hub_rear = self.hub * (-1, 1, 1)
        ground = np.array([self.axle, self.tyre_face, 0.0])
        head, tail = self.head_lamp, self.tail_lamp
        return {
            "wheel_front": self.hub,
            "wheel_rear": hub_rear,
            "tyre_front": ground,
            "tyre_rear": ground * (-1, 1, 1),
            "headlight_outer": body.tub(*head[3]),
            "headlight_inner": 0.5 * (body.tub(*head[0]) + body.tub(*head[1])),
            "taillight_outer": body.tub(*tail[3]),
            "taillight_inner": 0.5 * (body.tub(*tail[0]) + body.tub(*tail[1])),
            "bumper_front": body.tub(0.5 * (TURNS[1] + TURNS[2]), 0.02),
            "bumper_rear": body.tub(0.5 * (TURNS[3] + TURNS[4]), 0.02),
            "windscreen_bottom": body.cabin(SCREEN_U[0], GLASS_V[0]),
            "windscreen_top": body.cabin(SCREEN_U[1], GLASS_V[1]),
            "rear_window_top": body.cabin(BACK_U[1], BACK_V[1]),
            "rear_window_bottom": body.cabin(BACK_U[0], BACK_V[0]),
            "mirror": self.mirror("paint")[1],
            "side_window_front": self.side_front,
            "side_window_rear": np.full(3, np.nan) if self.panel_van else self.on_sill(self.quarter_x),
            "b_pillar_bottom": self.on_sill(self.pillar_x),
        }

    def mirror(self, material: str) -> tuple[Shell, np.ndarray]:
        """The door mirror and its outermost point."""
        s = self.style
        tip_y = self.body.half_width + s.mirror_out
        return details.mirror(self.side_front, tip_y, s.mirror_size, material)

    def side_y(self, x: float, z: float) -> float:
        """Half width of the tub's side at (x, z)."""
        low, high = float(self.body.bottom_z(x)), float(self.body.shoulder_z(x))
        v = float(np.clip((z - low) / (high - low), 0, 1))
        return float(self.body._side(v) * self.body.half_width * self.body._taper(np.array(x)))
