"""Tests of lorries and buses."""

from __future__ import annotations

import unittest

import numpy as np

from roadplane_train.cars.bus import HEIGHT, Bus
from roadplane_train.cars.heavy import sample_heavy
from roadplane_train.cars.lorry import KINDS, Lorry
from roadplane_train.cars.mesh import MATERIALS, CarMesh
from roadplane_train.cars.solids import box, prism
from roadplane_train.cars.surface import Shell

TYRE, RIM, GLASS = (MATERIALS.index(name) for name in ("tyre", "rim", "glass"))


def every_kind(seed: int) -> dict[str, CarMesh]:
    """Returns two of each kind, by name."""
    meshes: dict[str, CarMesh] = {}
    rng = np.random.default_rng(seed)
    while len(meshes) < 2 * (len(KINDS) + len(HEIGHT)):
        for kind in ("truck", "bus"):
            mesh = sample_heavy(rng, kind)
            name = mesh.name.split("-")[0]
            if name not in meshes:
                meshes[name] = mesh
            elif name + " again" not in meshes:
                meshes[name + " again"] = mesh
    return meshes


def volume(solid: Shell) -> float:
    """Returns the volume by the divergence theorem: right only for a closed solid with outward faces."""
    a, b, c = (solid.points[solid.faces[:, i]] for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


class Solids(unittest.TestCase):
    def test_closed_with_normals_outwards(self) -> None:
        outline = [(0.0, 0.0), (3.0, 0.0), (2.5, 2.0), (0.0, 2.0)]
        for corners in (outline, outline[::-1]):
            solid = prism(corners, (-1.0, 1.5), "paint", 0.02)
            self.assertAlmostEqual(volume(solid), 5.5 * 2.5, delta=0.05)
            np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0)
            flat = np.cross(*(solid.points[solid.faces[:, i]] - solid.points[solid.faces[:, 0]] for i in (1, 2)))
            self.assertTrue(((flat * solid.normals[solid.faces].mean(1)).sum(1) > 0).all())

    def test_fills_the_given_extents(self) -> None:
        solid = box((1.0, 2.0), (-0.5, 0.75), (0.25, 3.0), "paint", 0.1)
        np.testing.assert_allclose(solid.points.min(0), [1.0, -0.5, 0.25], atol=1e-9)
        np.testing.assert_allclose(solid.points.max(0), [2.0, 0.75, 3.0], atol=1e-9)


class Heavy(unittest.TestCase):
    def test_has_the_given_size(self) -> None:
        """Bumpers, lamps and mirrors may protrude."""
        for name, mesh in every_kind(1).items():
            low, high = mesh.vertices.min(0), mesh.vertices.max(0)
            self.assertTrue((np.abs((high - low)[[0, 2]] - mesh.dims[[0, 2]]) < [0.15, 0.08]).all(), f"{name} {high - low}")
            beside = mesh.vertices[mesh.vertices[:, 0] < 0]
            self.assertAlmostEqual(float(np.ptp(beside[:, 1])), mesh.dims[1], delta=0.1, msg=name)
            self.assertLess(abs(low[0] + high[0]), 0.15, name)

    def test_wheels_touch_the_ground_and_are_visible_from_the_side(self) -> None:
        """From the side, at least nine tenths of each wheel's outer face is unobstructed."""
        for name, mesh in every_kind(2).items():
            points = mesh.vertices[mesh.faces].astype(float)
            wheel = np.isin(mesh.materials, (TYRE, RIM))
            self.assertAlmostEqual(float(points[wheel][:, :, 2].min()), 0.0, delta=1e-3, msg=name)
            outer = wheel & (mesh.normals[mesh.faces, 1].min(1) > 0.5) & (points[:, :, 1].mean(1) > 0)
            self.assertTrue(outer.any(), name)
            places = points[outer].mean(1)
            area = np.linalg.norm(np.cross(*(points[outer][:, i] - points[outer][:, 0] for i in (1, 2))), axis=1)
            before = points[~wheel]
            hidden = np.array([_lies_before(place, before) for place in places])
            self.assertLess(area[hidden].sum() / area.sum(), 0.1, name)

    def test_faces_are_wound_like_their_normals(self) -> None:
        for name, mesh in every_kind(3).items():
            a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
            cross = np.cross(b - a, c - a)
            agree = (cross * mesh.normals[mesh.faces].mean(1)).sum(1) > 0
            area = np.linalg.norm(cross, axis=1)
            self.assertGreater(area[agree].sum() / area.sum(), 0.995, name)

    def test_outermost_sides_face_outwards(self) -> None:
        for name, mesh in every_kind(4).items():
            middles, normals = mesh.vertices[mesh.faces].mean(1), mesh.normals[mesh.faces[:, 0]]
            outer = (np.abs(normals[:, 1]) > 0.9) & (np.abs(middles[:, 1]) > 0.49 * mesh.dims[1]) & (middles[:, 0] < 0)
            self.assertTrue((normals[outer, 1] * middles[outer, 1] > 0).all(), name)

    def test_has_what_makes_a_lorry_or_a_bus(self) -> None:
        """Lamps, plates and indicators before and behind, panes to the front, a second paint on lorries."""
        for name, mesh in every_kind(5).items():
            used = {MATERIALS[i] for i in np.unique(mesh.materials)}
            self.assertLessEqual({"paint", "glass", "tyre", "rim", "headlamp", "taillamp", "plate", "indicator"}, used, name)
            x = {material: mesh.vertices[mesh.material_faces(material)][:, :, 0].mean(1) for material in used}
            self.assertGreater(x["headlamp"].min(), 0.4 * mesh.dims[0], name)
            self.assertLess(x["taillamp"].max(), -0.4 * mesh.dims[0], name)
            self.assertTrue((x["plate"] > 0).any() and (x["plate"] < 0).any(), name)
            glass = mesh.faces[mesh.materials == GLASS]
            self.assertGreater((mesh.normals[glass[:, 0], 0] > 0.6).sum(), 0, name)
            if mesh.body == "truck":
                self.assertIn("livery", used, name)
            self.assertLess(len(mesh.faces), 20_000, name)

    def test_sizes_are_drawn_from_their_ranges(self) -> None:
        rng = np.random.default_rng(6)
        for kind, sizes in KINDS.items():
            lorry = Lorry(rng, kind)
            self.assertTrue(sizes.length[0] <= lorry.length <= sizes.length[1])
        for kind, height in HEIGHT.items():
            self.assertTrue(height[0] <= Bus(rng, kind).height <= height[1])
        self.assertAlmostEqual(sum(sizes.share for sizes in KINDS.values()), 1.0)

    def test_same_seed_same_vehicle(self) -> None:
        for kind in ("truck", "bus"):
            one, two = (sample_heavy(np.random.default_rng(9), kind) for _ in range(2))
            np.testing.assert_array_equal(one.vertices, two.vertices)
            np.testing.assert_array_equal(one.materials, two.materials)


def _lies_before(place: np.ndarray, triangles: np.ndarray) -> bool:
    """Returns whether a triangle (n, 3, 3) lies between a point and a viewer far to the left."""
    a, b, c = (triangles[:, i][:, [0, 2]] - place[[0, 2]] for i in range(3))
    sides = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))], 1)
    total = sides.sum(1)
    inside = (np.abs(total) > 1e-9) & ((sides * np.sign(total)[:, None]) > 0).all(1)
    y = (sides[inside] * triangles[inside, :, 1]).sum(1) / total[inside]
    return bool((y > place[1] + 0.002).any())
