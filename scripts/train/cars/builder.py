"""Parametric cars: `sample_car(rng)` draws a style, `build(style, rng)` builds the car with its keypoints."""

from __future__ import annotations

import numpy as np

from . import details
from .body import Body
from .layout import Layout
from .mesh import KEYPOINT_NAMES, MATERIALS, MIRROR, CarMesh
from .skin import Skin
from .specs import SPECS
from .style import Style, model_style, sample_style
from .surface import Shell, flat_polygon, grid, join, rounded_box


def sample_car(rng: np.random.Generator, body: str | None = None, split: str = "train") -> CarMesh:
    """Returns a random car; body types are as common as in traffic unless given. Splits share no base model."""
    return build(sample_style(rng, body, split), rng)


def named_cars(split: str) -> list[CarMesh]:
    """Returns every base model of a split; the result is always the same."""
    return [build(model_style(s), np.random.default_rng(i)) for i, s in enumerate(SPECS) if s.split == split]


def build(style: Style, rng: np.random.Generator) -> CarMesh:
    """Builds the car of a style; `rng` chooses trim that does not move keypoints."""
    place = _place(style, rng)
    whole = _Assembly(place, rng).shell()
    return CarMesh(
        style.name, style.body, whole.points.astype(np.float32), whole.normals.astype(np.float32),
        whole.faces.astype(np.int32), whole.materials.astype(np.uint8), both_sides(place.keypoints()),
        np.array([style.length, style.width, style.height]),
    )  # fmt: skip


def keypoints_of(style: Style, rng: np.random.Generator) -> np.ndarray:
    """Returns the 36 keypoints (36, 3) of the car that `build` would make, without building its mesh."""
    return both_sides(_place(style, rng).keypoints())


def both_sides(left: dict[str, np.ndarray]) -> np.ndarray:
    """Returns all 36 keypoints (36, 3) from those of the left side, by name."""
    keypoints = np.full((len(KEYPOINT_NAMES), 3), np.nan)
    for i in range(18):
        keypoints[i] = left[KEYPOINT_NAMES[i].removeprefix("left_")]
        keypoints[MIRROR[i]] = keypoints[i] * (1, -1, 1)
    return keypoints


def _place(style: Style, rng: np.random.Generator) -> Layout:
    return Layout(Body(style), panel_van=style.body == "van" and rng.random() < 0.5)


class _Assembly:
    """The skin and the parts attached to it."""

    def __init__(self, place: Layout, rng: np.random.Generator) -> None:
        self.place, self.body, self.style, self.rng = place, place.body, place.style, rng

    def shell(self) -> Shell:
        """All triangles of the car."""
        skin = Skin(self.place, self.rng)
        mirror, _ = self.place.mirror(str(self.rng.choice(["paint", "paint", "plastic"])))
        halves = [
            skin.tub(),
            skin.cabin(),
            *self._wheels(),
            *self._wells(),
            mirror,
            *self._handles(),
            *self._rails(),
        ]
        left = join(halves)
        return join([left, left.mirrored(), *self._middle(), *self._spoiler()])

    def _wheels(self) -> list[Shell]:
        s, rng = self.style, self.rng
        spokes = int(rng.choice([0, 5, 5, 6, 7, 8, 10]))
        share = rng.uniform(0.62, 0.72)
        one = details.wheel(self.place.hub, s.tyre_radius, s.tyre_width, spokes, share)
        if rng.random() < 0.08:  # black steel
            one.materials[one.materials == MATERIALS.index("rim")] = MATERIALS.index("plastic")
        return [one, one.moved((-2 * self.place.axle, 0.0, 0.0))]

    def _wells(self) -> list[Shell]:
        """Dark wheel housings behind the arches."""
        inner = self.place.tyre_face - self.style.tyre_width - 0.12
        shells = []
        turn = np.linspace(-0.15 * np.pi, 1.15 * np.pi, 17)
        z0, r = self.style.tyre_radius, self.place.arch + 0.012
        low = float(self.body.bottom_z(0.0))
        for x in (self.place.axle, -self.place.axle):
            ring = np.stack([x + r * np.cos(turn), 0 * turn, np.maximum(z0 + r * np.sin(turn), low)], -1)
            outer_y = np.array([self.place.side_y(p[0], p[2]) for p in ring]) - 0.015
            a, b = ring.copy(), ring.copy()
            a[:, 1], b[:, 1] = outer_y, inner
            shells.append(grid(np.stack([a, b], 1), np.zeros((17, 2, 2)), "underbody"))
            wall = ring.copy()
            wall[:, 1] = inner
            shells.append(flat_polygon(wall[::-1], "underbody"))
        return shells

    def _handles(self) -> list[Shell]:
        z = self.body.belt_rear_z - 0.13
        places = [self.place.pillar_x + 0.16]
        if not self.place.two_doors:
            places.append(max(self.place.quarter_x + 0.2, -self.place.axle + 0.3))
        material = str(self.rng.choice(["paint", "paint", "chrome", "plastic"]))
        half = np.array([0.10, 0.022, 0.018])
        return [rounded_box(np.array([x, self.place.side_y(x, z), z]), half, material, 3.0, 5) for x in places]

    def _rails(self) -> list[Shell]:
        """Roof rail."""
        s, body, rng = self.style, self.body, self.rng
        if s.body not in ("wagon", "suv", "minivan") or rng.random() < 0.5:
            return []
        y = 0.93 * s.roof_y * body.half_width
        x = np.linspace(body.tailgate[0] + 0.15, body.header[0] - 0.35, 9)
        z = body.roof_z(x, np.full(9, y)) + 0.035
        w = 0.018
        ring = [(y - w, z - 0.03), (y + w, z - 0.05), (y + w, z), (y - w, z), (y - w, z - 0.03)]
        points = np.stack([np.stack([x, np.full(9, a), b], -1) for a, b in ring[::-1]], 0)
        return [grid(points, np.zeros((5, 9, 2)), str(rng.choice(["plastic", "chrome"])))]

    def _spoiler(self) -> list[Shell]:
        """Over the rear window, or a wing on the boot."""
        s, body, rng = self.style, self.body, self.rng
        if s.body in ("hatchback", "suv", "wagon") and rng.random() < 0.4:
            xt, zt = body.tailgate
            half = np.array([0.11, 0.8 * s.roof_y * body.half_width, 0.022])
            return [rounded_box(np.array([xt + 0.02, 0.0, zt + 0.005]), half, "paint", 4.0, 5)]
        if s.body in ("sedan", "coupe") and rng.random() < 0.15:
            x, z = s.x_rear + 0.17, s.tail_z * s.height + 0.09
            wing = rounded_box(np.array([x, 0.0, z]), np.array([0.10, 0.62 * body.half_width, 0.018]), "paint", 4.0, 5)
            foot_y, half = 0.5 * body.half_width, np.array([0.04, 0.03, 0.06])
            feet = [rounded_box(np.array([x, y, z - 0.05]), half, "paint", 4.0, 5) for y in (-foot_y, foot_y)]
            return [wing, *feet]
        return []

    def _middle(self) -> list[Shell]:
        """Adds the parts that cross the centre line."""
        s, body, rng = self.style, self.body, self.rng
        u = np.linspace(0, 1, 41)
        rim = body.tub(u, 0.0)
        floor = np.stack([rim, rim * (1, -1, 1)], 1)
        floor[:, :, 2] += 0.01
        shells = [grid(floor, np.zeros((41, 2, 2)), "underbody")]
        size = (0.31, 0.155) if rng.random() < 0.5 else (0.52, 0.115)
        if rng.random() < 0.7:
            shells.append(details.plate(s.x_front + 0.012, 0.3 * s.height, size, True))
        high = rng.random() < 0.6
        x, _, z = body.tub(1.0, 0.68 if high else 0.36)
        shells.append(details.plate(float(x) - 0.02, float(z), size, False))
        rows = 1 if self.place.panel_van or (s.body == "pickup" and self.place.two_doors) else (3 if s.body == "minivan" else 2)
        dash = body.cowl[0] - s.screen_bow - 0.25
        rear = body.backlight[0] + 0.15 if s.body != "van" else -self.place.axle
        width = s.belt_y * body.half_width - 0.1
        floor_z = 0.06 + max(float(body.bottom_z(rear)), float(body.bottom_z(dash)), 0.28)
        shells.append(details.interior(dash, rear, width, floor_z, s.belt_front_z * s.height, s.height, rows))
        if s.body == "pickup":
            shells += self._bed()
        return shells

    def _bed(self) -> list[Shell]:
        x0, x1, y = self.place.bed
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
