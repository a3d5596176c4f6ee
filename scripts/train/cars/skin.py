"""The skin of a car: tub and cabin, cut open for wheels and seats, with lamps, glass, trim and gaps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .body import TURNS
from .layout import BACK_U, BACK_V, GLASS_V, SCREEN_U, SIDE_U, Layout
from .regions import disc, left_of, pane, quadrilateral, stripe, u_between, v_between, x_between, z_between
from .surface import Shell, Test, grid

TOP_K = np.array([0.985, 0.95, 0.88, 0.75, 0.55, 0.3, 0.0])  # rows of the tops: share of the half width
DARK_BUMPERS = {"van": 0.4, "pickup": 0.3, "hatchback": 0.15, "suv": 0.15}  # how many have them unpainted


def _steps(*counts: int) -> np.ndarray:
    """u rows with `counts` cells in each part of the outline."""
    parts = [np.linspace(a, b, n, endpoint=False) for (a, b), n in zip(pairwise(TURNS), counts)]
    return np.concatenate([*parts, [1.0]])


class Skin:
    """The left side of tub and cabin; `rng` chooses the trim."""

    def __init__(self, place: Layout, rng: np.random.Generator) -> None:
        self.place, self.body, self.style, self.rng = place, place.body, place.style, rng
        self.dark_bumpers = rng.random() < DARK_BUMPERS.get(self.style.body, 0.02)

    def tub(self) -> Shell:
        """Builds everything below the glass, with bonnet and boot."""
        place = self.place
        body = self.body
        u = _steps(6, 7, 28, 6, 6)[:, None]
        v = np.concatenate([[0, 0.06], np.linspace(0.15, 0.9, 8), [0.955, 1.0], 2 - TOP_K])[None, :]
        tub = grid(body.tub(u, v), np.stack(np.broadcast_arrays(u, v), -1), "paint", symmetric=True)
        for x in (place.axle, -place.axle):
            tub.cut(self._arch(x), *v_between(-1, 1.05), *u_between(0.25, 0.755))
        self._paint_front(tub)
        self._paint_rear(tub)
        self._paint_sides(tub)
        self._paint_top(tub)
        return tub

    def _arch(self, x: float, beyond: float = 0.0) -> Test:
        """Returns a test for the inside of the wheel arch about the axle at x, extended by `beyond`."""
        return disc(x, self.style.tyre_radius, self.place.arch + beyond)

    def _paint_front(self, tub: Shell) -> None:
        place = self.place
        rng = self.rng
        if self.dark_bumpers:
            tub.paint("plastic", *u_between(-1, 0.345), *v_between(-1, 0.42))
        inner_u = place.head_lamp[0][0]
        tub.paint("headlamp", *quadrilateral(place.head_lamp))
        top = min(place.head_lamp[0][1] + 0.02, 0.96)
        bottom = place.head_lamp[1][1] - rng.uniform(0.0, 0.08)
        grille_u = inner_u - rng.uniform(0.015, 0.05)
        if rng.random() < 0.5:
            tub.paint("chrome", *u_between(-1, grille_u), *v_between(bottom, top))
            tub.paint("plastic", *u_between(-1, grille_u - 0.006), *v_between(bottom + 0.025, top - 0.03))
        else:
            tub.paint("plastic", *u_between(-1, grille_u), *v_between(bottom, top - 0.01))
        # lower intake
        tub.paint("plastic", *u_between(-1, rng.uniform(0.1, 0.2)), *v_between(0.06, rng.uniform(0.2, 0.3)))
        if rng.random() < 0.6:  # fog lamps
            tub.paint("headlamp", *u_between(0.2, 0.225), *v_between(0.17, 0.25))
        # bumper's upper edge
        tub.paint("gap", *u_between(grille_u, 0.335), *v_between(bottom - 0.015, bottom - 0.004))

    def _paint_rear(self, tub: Shell) -> None:
        place = self.place
        rng = self.rng
        tub.paint("taillamp", *quadrilateral(place.tail_lamp))
        ledge = rng.uniform(0.42, 0.5)
        if self.dark_bumpers:
            tub.paint("plastic", *u_between(0.68, 2), *v_between(-1, ledge))
        tub.paint("gap", *u_between(0.7, 2), *v_between(ledge, ledge + 0.012))
        tub.paint("plastic", *u_between(0.84, 2), *v_between(-1, rng.uniform(0.05, 0.16)))
        inner = place.tail_lamp[0][0]
        if rng.random() < 0.25:  # strip over the plate
            tub.paint("chrome", *u_between(0.92, 2), *v_between(0.8, 0.83))
        lid_u = max(inner, 0.83) + 0.004
        tub.paint("gap", *u_between(lid_u, lid_u + 0.004), *v_between(ledge, 1.0))

    def _paint_sides(self, tub: Shell) -> None:
        place = self.place
        s, rng, body = self.style, self.rng, self.body
        side = u_between(0.3, 0.72)
        if s.body in ("suv", "pickup") and rng.random() < 0.45:
            tub.paint("plastic", *v_between(-1, 0.2), *u_between(0.25, 0.78))
            for x in (place.axle, -place.axle):
                tub.paint("plastic", self._arch(x, 0.06), *v_between(-1, 0.9), *side)
        else:
            tub.paint("plastic", *v_between(-1, 0.035), *side)
        if rng.random() < 0.3:  # rubbing strip
            z = 0.36 * s.height
            reach = place.axle - place.arch
            tub.paint("plastic", *z_between(z, z + 0.06), *x_between(-reach, reach), *side)
        sill_v, half = 0.1, 0.0045
        lines = [(place.side_front[0] + 0.06, 0.02), (place.pillar_x, 0.0)]
        if not place.two_doors:
            lines.append((max(place.quarter_x - 0.02, -place.axle + 0.05), 0.35))
        for x, slope in lines:
            foot_z = float(body.bottom_z(x)) + 0.05
            a, b = (x, body.belt_rear_z), (x + slope * (body.belt_rear_z - foot_z), foot_z)
            tub.paint("gap", *stripe(a, b, half), *v_between(sill_v, 1.06), *side)
        last = lines[-1][0]
        tub.paint("gap", *v_between(sill_v, sill_v + 0.013), *x_between(last, lines[0][0]), *side)

    def _paint_top(self, tub: Shell) -> None:
        s, body = self.style, self.body
        cowl = body.cowl[0]
        edge = 2 - 0.86  # v of the bonnet's shut line
        tub.paint("gap", *v_between(edge, edge + 0.012), *x_between(cowl - 0.2, s.x_front - s.front_bow - 0.12))
        # cowl: dark strip ahead of the windscreen
        bow, half = s.screen_bow, s.belt_y * body.half_width
        tub.paint(
            "plastic",
            lambda p, uv: cowl + 0.07 - bow * (p[:, 1] / half) ** 2 - p[:, 0],
            lambda p, uv: p[:, 0] - cowl + bow + 0.25,
            *v_between(1.06, 3),
        )
        # no deck under the cabin, so that the seats show through the glass
        tail, tail_bow = body.backlight[0], s.backlight_bow
        tub.cut(
            lambda p, uv: half - 0.03 - p[:, 1],
            lambda p, uv: cowl - 0.03 - bow * (p[:, 1] / half) ** 2 - p[:, 0],
            lambda p, uv: p[:, 0] - tail - 0.03 - tail_bow * (p[:, 1] / half) ** 2,
            *v_between(1.02, 3),
        )
        if s.body in ("sedan", "coupe"):
            tub.paint("gap", *v_between(1.2, 1.213), *x_between(s.x_rear + 0.1, body.backlight[0] + 0.02))
            tub.paint("gap", *x_between(body.backlight[0] - 0.055, body.backlight[0] - 0.046), *v_between(1.2, 3))
        if s.body == "pickup":
            x0, x1, y = self.place.bed
            tub.cut(*x_between(x0, x1), lambda p, uv: y - p[:, 1], *v_between(1.0, 3))

    def cabin(self) -> Shell:
        """Pillars, glass and roof."""
        place = self.place
        body, s, rng = self.body, self.style, self.rng
        u = _steps(5, 5, 16, 5, 5)[:, None]
        v = np.concatenate([np.linspace(0, 1, 6), 2 - TOP_K])[None, :]
        cabin = grid(body.cabin(u, v), np.stack(np.broadcast_arrays(u, v), -1), "paint", symmetric=True)
        low, high = GLASS_V
        trim = "plastic" if rng.random() < 0.7 else "chrome"
        # a dark frame a little larger than each pane, then the pane
        cabin.paint("plastic", pane(SCREEN_U, GLASS_V, 1, 0.004), *v_between(0, high + 0.01))
        cabin.paint("glass", pane(SCREEN_U, GLASS_V, 1), *v_between(low, high))
        if s.body in ("hatchback", "wagon", "suv", "minivan") and rng.random() < 0.3:
            # lamps extend up beside the window
            cabin.paint("taillamp", *u_between(0.735, BACK_U[1] - 0.01), *v_between(-1, rng.uniform(0.35, 0.9)))
        if not (place.panel_van and rng.random() < 0.5):
            cabin.paint("plastic", pane(BACK_U, BACK_V, -1, 0.004), *v_between(BACK_V[0] - 0.03, BACK_V[1] + 0.01))
            cabin.paint("glass", pane(BACK_U, BACK_V, -1), *v_between(*BACK_V))
        else:  # two doors
            cabin.paint("glass", pane(BACK_U, BACK_V, -1), *u_between(-1, 0.985), *v_between(*BACK_V))
        rear_low = place.on_sill(place.quarter_x)
        lean = {"sedan": 0.62, "coupe": 0.8, "hatchback": 0.3}.get(s.body, 0.12)
        rise = float(np.interp(-place.quarter_x, -place.head[:, 0], place.head[:, 2]) - rear_low[2])
        a, b = (rear_low[0], rear_low[2]), (rear_low[0] + lean * rise, rear_low[2] + rise)
        rear_edge = left_of(b, a)  # positive ahead of the glass's rear edge
        if s.body != "pickup" and rng.random() < 0.2:  # sunroof
            x = body.header[0]
            cabin.paint("glass", *x_between(x - 0.75, x - 0.28), lambda p, uv: 0.4 - p[:, 1], *v_between(1.1, 3))
        frame = [*u_between(SIDE_U[0] - 0.004, SIDE_U[1] + 0.004), *v_between(low - 0.02, high - 0.03)]
        cabin.paint(trim, *frame, left_of(b, a, 0.012))
        cabin.paint("glass", *u_between(*SIDE_U), *v_between(low, high - 0.05), rear_edge)
        self._pillars(cabin, rear_edge)
        if rng.random() < 0.4:  # third brake lamp
            cabin.paint("taillamp", *u_between(0.975, 2), *v_between(BACK_V[1] - 0.05, BACK_V[1] - 0.01))
        return cabin

    def _pillars(self, cabin: Shell, rear_edge: Test) -> None:
        """B pillar, and the bars between the panes behind it."""
        place = self.place
        rng = self.rng
        material = "plastic" if rng.random() < 0.6 else "paint"
        bars = []
        if not place.panel_van:
            bars.append((place.pillar_x - 0.035, rng.uniform(0.035, 0.065), 0.06, material))
        rest = place.pillar_x - place.quarter_x
        if rest > 1.25:
            bars.append((place.pillar_x - min(0.95, 0.55 * rest), rng.uniform(0.03, 0.06), 0.14, material))
        elif rest > 0.7:
            bars.append((place.pillar_x - 0.72 * rest, 0.016, 0.1, "plastic"))
        low, high = GLASS_V
        for x, half, lean, what in bars:
            z = float(place.on_sill(x)[2])
            a, b = (x, z), (x + lean, z + 0.5)
            where = [*u_between(0.36, 0.675), *v_between(low - 0.03, high), rear_edge]
            cabin.paint(what, *stripe(a, b, half), *where)
