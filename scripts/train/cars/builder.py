"""Parametric cars: `sample_car(rng)` draws one, `build(style)` makes it; all 36 keypoints come from the construction."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from . import details
from .body import TURNS, Body
from .mesh import KEYPOINT_NAMES, MATERIALS, MIRROR, CarMesh
from .specs import SPECS
from .style import Style, model_style, sample_style
from .surface import Shell, Test, flat_polygon, grid, join

# Where glass begins and ends on the cabin: v of lower and upper edge, and u of the panes' corners there.
GLASS_V = (0.055, 0.955)
BACK_V = (0.10, 0.955)
SCREEN_U = (0.231, 0.243)  # just round the cabin's front corner
SIDE_U = (0.352, 0.672)
BACK_U = (0.812, 0.787)


def sample_car(rng: np.random.Generator, body: str | None = None, split: str = "train") -> CarMesh:
    """A random car; body types as common as in traffic unless given. Splits share no base model."""
    return build(sample_style(rng, body, split), rng)


def named_cars(split: str) -> list[CarMesh]:
    """Every base model of a split, always the same."""
    return [build(model_style(s), np.random.default_rng(i)) for i, s in enumerate(SPECS) if s.split == split]


def build(style: Style, rng: np.random.Generator) -> CarMesh:
    """The car of a style; `rng` decides on trim that does not move keypoints."""
    car = _Assembly(Body(style), rng)
    whole = car.shell()
    return CarMesh(
        style.name, style.body, whole.points.astype(np.float32), whole.normals.astype(np.float32),
        whole.faces.astype(np.int32), whole.materials.astype(np.uint8), both_sides(car.keypoints()),
        np.array([style.length, style.width, style.height]),
    )  # fmt: skip


def keypoints_of(style: Style, rng: np.random.Generator) -> np.ndarray:
    """The 36 keypoints (36, 3) of the car that `build` would make, without its mesh."""
    return both_sides(_Assembly(Body(style), rng).keypoints())


def both_sides(left: dict[str, np.ndarray]) -> np.ndarray:
    """All 36 keypoints (36, 3) from the left side's by name."""
    keypoints = np.full((len(KEYPOINT_NAMES), 3), np.nan)
    for i in range(18):
        keypoints[i] = left[KEYPOINT_NAMES[i].removeprefix("left_")]
        keypoints[MIRROR[i]] = keypoints[i] * (1, -1, 1)
    return keypoints


def _line(a: tuple[float, float], b: tuple[float, float]) -> Test:
    """Positive to the left of the line a → b in side view (x, z)."""
    (ax, az), (bx, bz) = a, b
    length = np.hypot(bx - ax, bz - az)
    return lambda p, uv: ((bx - ax) * (p[:, 2] - az) - (bz - az) * (p[:, 0] - ax)) / length


def _u(low: float, high: float) -> list[Test]:
    return [lambda p, uv: uv[:, 0] - low, lambda p, uv: high - uv[:, 0]]


def _v(low: float, high: float) -> list[Test]:
    return [lambda p, uv: uv[:, 1] - low, lambda p, uv: high - uv[:, 1]]


def _x(low: float, high: float) -> list[Test]:
    return [lambda p, uv: p[:, 0] - low, lambda p, uv: high - p[:, 0]]


def _z(low: float, high: float) -> list[Test]:
    return [lambda p, uv: p[:, 2] - low, lambda p, uv: high - p[:, 2]]


def _pane(u: tuple[float, float], v: tuple[float, float], side: int, grow: float = 0.0) -> Test:
    """Towards the centre line from a pane's edge, which runs from (u[0], v[0]) to (u[1], v[1]); side 1 front, −1 rear."""
    slope = (u[1] - u[0]) / (v[1] - v[0])
    return lambda p, uv: side * (u[0] + slope * (uv[:, 1] - v[0]) - uv[:, 0]) + grow


def _steps(*counts: int) -> np.ndarray:
    """u rows with `counts` cells in each part of the outline."""
    parts = [np.linspace(a, b, n, endpoint=False) for (a, b), n in zip(pairwise(TURNS), counts)]
    return np.concatenate([*parts, [1.0]])


class _Assembly:
    """One car being put together; everything on the left half, mirrored at the end."""

    def __init__(self, body: Body, rng: np.random.Generator) -> None:
        self.body, self.style, self.rng = body, body.style, rng
        s = self.style
        self.axle = s.wheelbase / 2
        self.tyre_face = min(s.track / 2 + s.tyre_width / 2, body.half_width - 0.02)
        self.hub = np.array([self.axle, self.tyre_face - 0.015, s.tyre_radius])
        self.arch = s.tyre_radius * (1.12 if s.body in ("suv", "pickup") else 1.085) + 0.01
        u = np.linspace(0, 1, 401)
        self._u, self._sill = u, body.cabin(u, GLASS_V[0])
        self._head = body.cabin(u, GLASS_V[1])
        self.side_front = body.cabin(SIDE_U[0], GLASS_V[0])
        rear_limit = float(body.cabin(SIDE_U[1] - 0.01, GLASS_V[0])[0])
        self.quarter_x = max(s.quarter_dx - self.axle, rear_limit)
        if s.body == "pickup":
            self.quarter_x = rear_limit + 0.02
        self.pillar_x = max(self.side_front[0] - s.b_pillar, self.quarter_x + 0.02)
        self.cargo = s.body == "van" and rng.random() < 0.5
        if self.cargo:
            self.quarter_x = self.pillar_x
        self.mirror_material = str(rng.choice(["paint", "paint", "plastic"]))
        self._lamps()

    # where things are -----------------------------------------------------------------------------------------------

    def _on_sill(self, x: float) -> np.ndarray:
        """Point of the side glass's lower edge at x."""
        side = (self._u > SIDE_U[0] - 0.02) & (self._u < TURNS[4])
        return np.array([np.interp(-x, -self._sill[side, 0], self._sill[side, a]) for a in range(3)])

    def _tub_u(self, v: float, x: float | None = None, y: float | None = None, rear: bool = False) -> float:
        """u of the tub's ring v at a place x along the side, or y across the front or rear face."""
        u = np.linspace(0, 0.5, 201) if not rear else np.linspace(1, 0.5, 201)
        ring = self.body.tub(u, v)
        if x is not None:
            order = np.argsort(ring[:, 0])
            return float(np.interp(x, ring[order, 0], u[order]))
        face = u >= 0.5 * (TURNS[3] + TURNS[4]) if rear else u <= 0.5 * (TURNS[1] + TURNS[2])
        return float(np.interp(y, ring[face, 1], u[face]))

    def _lamps(self) -> None:
        """Corners of head and tail lamp as (u, v) quadrilaterals: inner top, inner bottom, outer bottom, outer top."""
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
            "mirror": self._mirror()[1],
            "side_window_front": self.side_front,
            "side_window_rear": np.full(3, np.nan) if self.cargo else self._on_sill(self.quarter_x),
            "b_pillar_bottom": self._on_sill(self.pillar_x),
        }

    # parts ----------------------------------------------------------------------------------------------------------

    def shell(self) -> Shell:
        """All triangles of the car."""
        halves = [self._tub(), *self._cabin(), *self._wheels(), *self._wells(), self._mirror()[0], *self._handles()]
        left = join(halves)
        return join([left, left.mirrored(), *self._middle()])

    def _tub(self) -> Shell:
        body = self.body
        u = _steps(6, 7, 28, 6, 6)[:, None]
        v = np.concatenate([[0, 0.06], np.linspace(0.15, 0.9, 8), [0.955, 1.0], 2 - TOP_K])[None, :]
        tub = grid(body.tub(u, v), np.stack(np.broadcast_arrays(u, v), -1), "paint", symmetric=True)
        for x in (self.axle, -self.axle):
            circle = self._circle(x)
            tub.cut(circle, *_v(-1, 1.05), *_u(0.25, 0.755))
        self._paint_front(tub)
        self._paint_rear(tub)
        self._paint_sides(tub)
        self._paint_top(tub)
        return tub

    def _circle(self, x: float, beyond: float = 0.0) -> Test:
        """Inside the wheel arch about the axle at x, or `beyond` outside its edge."""
        z, r = self.style.tyre_radius, self.arch + beyond
        return lambda p, uv: r - np.hypot(p[:, 0] - x, p[:, 2] - z)

    @staticmethod
    def _quad(corners: list[tuple[float, float]]) -> list[Test]:
        """Inside of a convex quadrilateral in (u, v)."""
        c = np.array(corners)
        if np.cross(c[1] - c[0], c[2] - c[1]) < 0:
            c = c[::-1]

        def edge(a: np.ndarray, b: np.ndarray) -> Test:
            return lambda p, uv: (b[0] - a[0]) * (uv[:, 1] - a[1]) - (b[1] - a[1]) * (uv[:, 0] - a[0])

        return [edge(c[i], c[(i + 1) % 4]) for i in range(4)]

    def _paint_front(self, tub: Shell) -> None:
        rng = self.rng
        self.dark_bumpers = rng.random() < {"van": 0.4, "pickup": 0.3, "hatchback": 0.15, "suv": 0.15}.get(self.style.body, 0.02)
        if self.dark_bumpers:
            tub.paint("plastic", *_u(-1, 0.345), *_v(-1, 0.42))
        inner_u = self.head_lamp[0][0]
        tub.paint("headlamp", *self._quad(self.head_lamp))
        top = min(self.head_lamp[0][1] + 0.02, 0.96)
        bottom = self.head_lamp[1][1] - rng.uniform(0.0, 0.08)
        grille_u = inner_u - rng.uniform(0.015, 0.05)
        if rng.random() < 0.5:
            tub.paint("chrome", *_u(-1, grille_u), *_v(bottom, top))
            tub.paint("plastic", *_u(-1, grille_u - 0.006), *_v(bottom + 0.025, top - 0.03))
        else:
            tub.paint("plastic", *_u(-1, grille_u), *_v(bottom, top - 0.01))
        tub.paint("plastic", *_u(-1, rng.uniform(0.1, 0.2)), *_v(0.06, rng.uniform(0.2, 0.3)))  # lower intake
        if rng.random() < 0.6:  # fog lamps
            tub.paint("headlamp", *_u(0.2, 0.225), *_v(0.17, 0.25))
        # bumper's upper edge
        tub.paint("gap", *_u(grille_u, 0.335), *_v(bottom - 0.015, bottom - 0.004))

    def _paint_rear(self, tub: Shell) -> None:
        rng = self.rng
        tub.paint("taillamp", *self._quad(self.tail_lamp))
        ledge = rng.uniform(0.42, 0.5)
        if self.dark_bumpers:
            tub.paint("plastic", *_u(0.68, 2), *_v(-1, ledge))
        tub.paint("gap", *_u(0.7, 2), *_v(ledge, ledge + 0.012))
        tub.paint("plastic", *_u(0.84, 2), *_v(-1, rng.uniform(0.05, 0.16)))
        inner = self.tail_lamp[0][0]
        if rng.random() < 0.25:  # strip over the plate
            tub.paint("chrome", *_u(0.92, 2), *_v(0.8, 0.83))
        lid_u = max(inner, 0.83) + 0.004
        tub.paint("gap", *_u(lid_u, lid_u + 0.004), *_v(ledge, 1.0))

    def _paint_sides(self, tub: Shell) -> None:
        s, rng, body = self.style, self.rng, self.body
        side = _u(0.3, 0.72)
        if s.body in ("suv", "pickup") and rng.random() < 0.45:
            tub.paint("plastic", *_v(-1, 0.2), *_u(0.25, 0.78))
            for x in (self.axle, -self.axle):
                tub.paint("plastic", self._circle(x, 0.06), *_v(-1, 0.9), *side)
        else:
            tub.paint("plastic", *_v(-1, 0.035), *side)
        if rng.random() < 0.3:  # rubbing strip
            z = 0.36 * s.height
            tub.paint("plastic", *_z(z, z + 0.06), *_x(-self.axle + self.arch, self.axle - self.arch), *side)
        sill_v, half = 0.1, 0.0045
        lines = [(self.side_front[0] + 0.06, 0.02), (self.pillar_x, 0.0)]
        if not self._two_doors():
            lines.append((max(self.quarter_x - 0.02, -self.axle + 0.05), 0.35))
        for x, slope in lines:
            foot_z = float(body.bottom_z(x)) + 0.05
            a, b = (x + slope * 0.0, body.belt_rear_z), (x + slope * (body.belt_rear_z - foot_z), foot_z)
            tub.paint("gap", self._beside(a, b, half, 1), self._beside(a, b, half, -1), *_v(sill_v, 1.06), *side)
        last = lines[-1][0]
        tub.paint("gap", *_v(sill_v, sill_v + 0.013), *_x(last, lines[0][0]), *side)

    @staticmethod
    def _beside(a: tuple[float, float], b: tuple[float, float], half: float, sign: int) -> Test:
        line = _line(a, b)
        return lambda p, uv: half + sign * line(p, uv)

    def _two_doors(self) -> bool:
        return self.style.body == "coupe" or self.cargo or self.pillar_x - self.quarter_x < 0.25

    def _paint_top(self, tub: Shell) -> None:
        s, body = self.style, self.body
        cowl = body.cowl[0]
        edge = 2 - 0.86  # v of the bonnet's shut line
        tub.paint("gap", *_v(edge, edge + 0.012), *_x(cowl - 0.2, s.x_front - s.front_bow - 0.12))
        # cowl: dark strip ahead of the windscreen
        bow, half = s.screen_bow, s.belt_y * body.half_width
        tub.paint(
            "plastic",
            lambda p, uv: cowl + 0.07 - bow * (p[:, 1] / half) ** 2 - p[:, 0],
            lambda p, uv: p[:, 0] - cowl + bow + 0.25,
            *_v(1.06, 3),
        )
        # nothing under the cabin, so that the seats show through the glass
        tail, tail_bow = body.backlight[0], s.backlight_bow
        tub.cut(
            lambda p, uv: half - 0.03 - p[:, 1],
            lambda p, uv: cowl - 0.03 - bow * (p[:, 1] / half) ** 2 - p[:, 0],
            lambda p, uv: p[:, 0] - tail - 0.03 - tail_bow * (p[:, 1] / half) ** 2,
            *_v(1.02, 3),
        )
        if s.body in ("sedan", "coupe"):
            tub.paint("gap", *_v(1.2, 1.213), *_x(s.x_rear + 0.1, body.backlight[0] + 0.02))
            tub.paint("gap", *_x(body.backlight[0] - 0.055, body.backlight[0] - 0.046), *_v(1.2, 3))
        if s.body == "pickup":
            self._open_bed(tub)

    def _open_bed(self, tub: Shell) -> None:
        s = self.style
        self.bed = (s.x_rear + 0.17, self.body.backlight[0] - 0.06, 0.80 * self.body.half_width)
        x0, x1, y = self.bed
        tub.cut(*_x(x0, x1), lambda p, uv: y - p[:, 1], *_v(1.0, 3))

    def _bed(self) -> list[Shell]:
        x0, x1, y = self.bed
        z1 = float(self.body.deck_z(np.array(0.5 * (x0 + x1)), np.array(y))) + 0.004
        if self.rng.random() < 0.3:  # cover
            return [flat_polygon(np.array([(x0, -y, z1), (x1, -y, z1), (x1, y, z1), (x0, y, z1)]), "plastic")]
        z0 = z1 - 0.5 * min(1.0, self.style.height / 1.8)
        material = "paint" if self.rng.random() < 0.5 else "plastic"
        walls = [
            [(x0, -y, z0), (x1, -y, z0), (x1, y, z0), (x0, y, z0)],
            [(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)],
            [(x1, -y, z0), (x0, -y, z0), (x0, -y, z1), (x1, -y, z1)],
            [(x1, y, z0), (x1, -y, z0), (x1, -y, z1), (x1, y, z1)],
            [(x0, -y, z0), (x0, y, z0), (x0, y, z1), (x0, -y, z1)],
        ]
        return [flat_polygon(np.array(w), material) for w in walls]

    def _cabin(self) -> list[Shell]:
        body, s, rng = self.body, self.style, self.rng
        u = _steps(5, 5, 16, 5, 5)[:, None]
        v = np.concatenate([np.linspace(0, 1, 6), 2 - TOP_K])[None, :]
        cabin = grid(body.cabin(u, v), np.stack(np.broadcast_arrays(u, v), -1), "paint", symmetric=True)
        low, high = GLASS_V
        trim = "plastic" if rng.random() < 0.7 else "chrome"
        # a dark frame a little larger than each pane, then the pane
        cabin.paint("plastic", _pane(SCREEN_U, GLASS_V, 1, 0.004), *_v(0, high + 0.01))
        cabin.paint("glass", _pane(SCREEN_U, GLASS_V, 1), *_v(low, high))
        if s.body in ("hatchback", "wagon", "suv", "minivan") and rng.random() < 0.3:  # tail lamps run up beside the window
            cabin.paint("taillamp", *_u(0.735, BACK_U[1] - 0.01), *_v(-1, rng.uniform(0.35, 0.9)))
        if not (self.cargo and rng.random() < 0.5):
            cabin.paint("plastic", _pane(BACK_U, BACK_V, -1, 0.004), *_v(BACK_V[0] - 0.03, BACK_V[1] + 0.01))
            cabin.paint("glass", _pane(BACK_U, BACK_V, -1), *_v(*BACK_V))
        else:  # two doors
            cabin.paint("glass", _pane(BACK_U, BACK_V, -1), *_u(-1, 0.985), *_v(*BACK_V))
        rear_low = self._on_sill(self.quarter_x)
        lean = {"sedan": 0.62, "coupe": 0.8, "hatchback": 0.3}.get(s.body, 0.12)
        rise = float(np.interp(-self.quarter_x, -self._head[:, 0], self._head[:, 2]) - rear_low[2])
        a, b = (rear_low[0], rear_low[2]), (rear_low[0] + lean * rise, rear_low[2] + rise)
        rear_edge = _line(b, a)  # positive ahead of the glass's rear edge

        def frame(p: np.ndarray, uv: np.ndarray) -> np.ndarray:
            return rear_edge(p, uv) + 0.012

        if s.body != "pickup" and rng.random() < 0.2:  # sunroof
            x = body.header[0]
            cabin.paint("glass", *_x(x - 0.75, x - 0.28), lambda p, uv: 0.4 - p[:, 1], *_v(1.1, 3))
        cabin.paint(trim, *_u(SIDE_U[0] - 0.004, SIDE_U[1] + 0.004), *_v(low - 0.02, high - 0.03), frame)
        cabin.paint("glass", *_u(*SIDE_U), *_v(low, high - 0.05), rear_edge)
        self._pillars(cabin, rear_edge)
        if rng.random() < 0.4:  # third brake lamp
            cabin.paint("taillamp", *_u(0.975, 2), *_v(BACK_V[1] - 0.05, BACK_V[1] - 0.01))
        return [cabin, *self._roof_trim()]

    def _roof_trim(self) -> list[Shell]:
        """Roof rails and a spoiler over the rear window."""
        s, body, rng = self.style, self.body, self.rng
        shells = []
        (xt, zt), xh = body.tailgate, body.header[0]
        if s.body in ("wagon", "suv", "minivan") and rng.random() < 0.5:
            y = 0.93 * s.roof_y * body.half_width
            x = np.linspace(xt + 0.15, xh - 0.35, 9)
            z = body.roof_z(x, np.full(9, y)) + 0.035
            w = 0.018
            ring = [(y - w, z - 0.03), (y + w, z - 0.05), (y + w, z), (y - w, z), (y - w, z - 0.03)]
            points = np.stack([np.stack([x, np.full(9, a), b], -1) for a, b in ring[::-1]], 0)
            shells.append(grid(points, np.zeros((5, 9, 2)), str(rng.choice(["plastic", "chrome"]))))
        if s.body in ("hatchback", "suv", "wagon") and rng.random() < 0.4:
            half = np.array([0.11, 0.8 * s.roof_y * body.half_width, 0.022])
            shells.append(details.rounded_box(np.array([xt + 0.02, 0.0, zt + 0.005]), half, "paint", 4.0, 5))
        elif s.body in ("sedan", "coupe") and rng.random() < 0.15:
            x, z = s.x_rear + 0.17, s.tail_z * s.height + 0.09
            half = np.array([0.10, 0.62 * body.half_width, 0.018])
            shells.append(details.rounded_box(np.array([x, 0.0, z]), half, "paint", 4.0, 5))
            foot = np.array([0.04, 0.03, 0.06])
            shells.append(details.rounded_box(np.array([x, 0.5 * body.half_width, z - 0.05]), foot, "paint", 4.0, 5))
        return shells

    def _pillars(self, cabin: Shell, rear_edge: Test) -> None:
        """B pillar, and the bars between the panes behind it."""
        rng = self.rng
        material = "plastic" if rng.random() < 0.6 else "paint"
        bars = []
        if not self.cargo:
            bars.append((self.pillar_x - 0.035, rng.uniform(0.035, 0.065), 0.06, material))
        rest = self.pillar_x - self.quarter_x
        if rest > 1.25:
            bars.append((self.pillar_x - min(0.95, 0.55 * rest), rng.uniform(0.03, 0.06), 0.14, material))
        elif rest > 0.7:
            bars.append((self.pillar_x - 0.72 * rest, 0.016, 0.1, "plastic"))
        low, high = GLASS_V
        for x, half, lean, what in bars:
            z = float(self._on_sill(x)[2])
            a, b = (x, z), (x + lean, z + 0.5)
            cabin.paint(
                what, self._beside(a, b, half, 1), self._beside(a, b, half, -1),
                *_u(0.36, 0.675), *_v(low - 0.03, high), rear_edge,
            )  # fmt: skip

    def _wheels(self) -> list[Shell]:
        s, rng = self.style, self.rng
        spokes = int(rng.choice([0, 5, 5, 6, 7, 8, 10]))
        share = rng.uniform(0.62, 0.72)
        one = details.wheel(self.hub, s.tyre_radius, s.tyre_width, spokes, share)
        if rng.random() < 0.08:  # black steel
            one.materials[one.materials == MATERIALS.index("rim")] = MATERIALS.index("plastic")
        return [one, one.moved((-2 * self.axle, 0.0, 0.0))]

    def _wells(self) -> list[Shell]:
        """Dark wheel housings behind the arches."""
        inner = self.tyre_face - self.style.tyre_width - 0.12
        shells = []
        turn = np.linspace(-0.15 * np.pi, 1.15 * np.pi, 17)
        z0, r = self.style.tyre_radius, self.arch + 0.012
        low = float(self.body.bottom_z(0.0))
        for x in (self.axle, -self.axle):
            ring = np.stack([x + r * np.cos(turn), 0 * turn, np.maximum(z0 + r * np.sin(turn), low)], -1)
            outer_y = np.array([self._side_y(p[0], p[2]) for p in ring]) - 0.015
            a, b = ring.copy(), ring.copy()
            a[:, 1], b[:, 1] = outer_y, inner
            shells.append(grid(np.stack([a, b], 1), np.zeros((17, 2, 2)), "underbody"))
            wall = ring.copy()
            wall[:, 1] = inner
            shells.append(flat_polygon(wall[::-1], "underbody"))
        return shells

    def _side_y(self, x: float, z: float) -> float:
        low, high = float(self.body.bottom_z(x)), float(self.body.shoulder_z(x))
        v = float(np.clip((z - low) / (high - low), 0, 1))
        return float(self.body._side(v) * self.body.half_width * self.body._taper(np.array(x)))

    def _mirror(self) -> tuple[Shell, np.ndarray]:
        s = self.style
        tip_y = self.body.half_width + s.mirror_out
        return details.mirror(self.side_front, tip_y, s.mirror_size, self.mirror_material)

    def _handles(self) -> list[Shell]:
        z = self.body.belt_rear_z - 0.13
        places = [self.pillar_x + 0.16]
        if not self._two_doors():
            places.append(max(self.quarter_x + 0.2, -self.axle + 0.3))
        material = str(self.rng.choice(["paint", "paint", "chrome", "plastic"]))
        half = np.array([0.10, 0.022, 0.018])
        return [
            details.rounded_box(np.array([x, self._side_y(x, z), z]), half, material, 3.0, 5) for x in places
        ]

    def _middle(self) -> list[Shell]:
        """What crosses the centre line."""
        s, body, rng = self.style, self.body, self.rng
        u = np.linspace(0, 1, 41)
        rim = body.tub(u, 0.0)
        floor = np.stack([rim, rim * (1, -1, 1)], 1)
        floor[:, :, 2] = np.minimum(floor[:, :, 2], floor[:, :, 2]) + 0.01
        shells = [grid(floor, np.zeros((41, 2, 2)), "underbody")]
        size = (0.31, 0.155) if rng.random() < 0.5 else (0.52, 0.115)
        if rng.random() < 0.7:
            shells.append(details.plate(s.x_front + 0.012, 0.3 * s.height, size, True))
        high = rng.random() < 0.6
        x, _, z = body.tub(1.0, 0.68 if high else 0.36)
        shells.append(details.plate(float(x) - 0.02, float(z), size, False))
        roof_z = s.height
        rows = 1 if self.cargo or (s.body == "pickup" and self._two_doors()) else (3 if s.body == "minivan" else 2)
        dash = body.cowl[0] - s.screen_bow - 0.25
        rear = body.backlight[0] + 0.15 if s.body != "van" else -self.axle
        width = s.belt_y * body.half_width - 0.1
        floor_z = 0.06 + max(float(body.bottom_z(rear)), float(body.bottom_z(dash)), 0.28)
        shells.append(details.interior(dash, rear, width, floor_z, s.belt_front_z * s.height, roof_z, rows))
        if s.body == "pickup":
            shells += self._bed()
        return shells


TOP_K = np.array([0.985, 0.95, 0.88, 0.75, 0.55, 0.3, 0.0])
