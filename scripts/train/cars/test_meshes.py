"""Tests of imported meshes; they need Debian's package sweethome3d-furniture."""

from __future__ import annotations

import unittest
from pathlib import Path

import numpy as np

from roadplane_train.cars.deform import _Warp, deform
from roadplane_train.cars.mesh import MATERIALS, CarMesh
from roadplane_train.cars.meshes import CATALOGUE, FURNITURE, MissingFurnitureError, catalogue, load, load_meshes
from roadplane_train.cars.obj import parse
from roadplane_train.cars.shading import smooth_normals, thin_out

FLIP = np.array([1.0, -1.0, 1.0])


def wheel_spread(mesh: CarMesh) -> float:
    """Returns the spread of the front left tread's outermost radii by direction, m; 0 for a circle."""
    points = mesh.vertices[np.unique(mesh.material_faces("tyre"))].astype(float)
    points = points[(points[:, 0] > 0) & (points[:, 1] > 0)] - mesh.keypoints[0]
    angle = np.floor((np.arctan2(points[:, 2], points[:, 0]) + np.pi) / (2 * np.pi) * 8).clip(0, 7)
    radius = np.hypot(points[:, 0], points[:, 2])
    return float(np.ptp([radius[angle == a].max() for a in range(8)]))


class Parts(unittest.TestCase):
    def test_parse_fans_polygons_and_counts_back(self) -> None:
        read = parse("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\ng door\nusemtl Paint\nf -4//1 -3//1 -2//1 -1//1\n")
        self.assertEqual(read.faces.tolist(), [[0, 1, 2], [0, 2, 3]])
        self.assertEqual((read.materials[0], read.groups[1]), ("Paint", "door"))

    def test_crease_splits_and_soft_edge_does_not(self) -> None:
        for lift, vertices in ((1.0, 6), (0.1, 4)):
            corners = np.array([[0, 0, 0], [0, 1, 0], [-1, 0, -lift], [1, 0, -lift]], float)
            _, normals, faces = smooth_normals(corners, np.array([[0, 1, 2], [1, 0, 3]]), 40)
            self.assertEqual(len(normals), vertices)
            self.assertTrue(np.allclose(np.linalg.norm(normals, axis=1), 1))
            self.assertTrue((normals[faces][..., 2] > 0).all())

    def test_thin_out_keeps_a_sphere_round(self) -> None:
        u, v = (a.ravel() for a in np.meshgrid(np.arange(60), np.arange(40), indexing="ij"))
        theta, phi = 2 * np.pi * np.arange(60) / 60, np.pi * (np.arange(41) + 0.5) / 41.5
        grid = np.stack(np.broadcast_arrays(
            np.sin(phi) * np.cos(theta[:, None]), np.sin(phi) * np.sin(theta[:, None]), np.cos(phi)), -1)  # fmt: skip
        a, b = u * 41 + v, (u + 1) % 60 * 41 + v
        faces = np.concatenate([np.stack([a, b, a + 1], 1), np.stack([b, b + 1, a + 1], 1)])
        vertices, few, parts = thin_out(grid.reshape(-1, 3), faces, np.zeros(len(faces)), 900)
        self.assertLessEqual(len(few), 900)
        self.assertEqual(len(few), len(parts))
        self.assertLess(abs(np.linalg.norm(vertices[np.unique(few)], axis=1) - 1).max(), 0.02)

    def test_missing_package_is_named(self) -> None:
        with self.assertRaisesRegex(MissingFurnitureError, "sweethome3d-furniture"):
            load(catalogue()[0], Path("/nowhere"))


@unittest.skipUnless(FURNITURE.is_dir(), "skipped: sweethome3d-furniture is not installed")
class Meshes(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.meshes = load_meshes()

    def test_splits_share_no_car(self) -> None:
        split = {entry["name"]: entry["split"] for entry in catalogue()}
        self.assertEqual(len(split), len(self.meshes), CATALOGUE)
        self.assertEqual(set(split.values()), {"train", "eval"})
        for pair in (("concept-sedan-02", "concept-sedan-02-sport"), ("concept-sedan-01v1", "concept-sedan-01v2")):
            self.assertEqual(split[pair[0]], split[pair[1]], "the same body under two names")

    def test_frame(self) -> None:
        for mesh in self.meshes:
            with self.subTest(mesh.name):
                tyres = mesh.vertices[np.unique(mesh.material_faces("tyre"))]
                self.assertAlmostEqual(float(tyres[:, 2].min()), 0, delta=0.005)
                self.assertAlmostEqual(float(tyres[:, 0].max() + tyres[:, 0].min()), 0, delta=0.02)
                self.assertAlmostEqual(float(mesh.vertices[:, 1].max() + mesh.vertices[:, 1].min()), 0, delta=0.01)
                self.assertGreater(mesh.keypoints[4, 0], mesh.keypoints[6, 0], "headlamps are in front")
                self.assertTrue((mesh.keypoints[:18, 1][np.isfinite(mesh.keypoints[:18, 1])] > 0).all())
                self.assertLess(wheel_spread(mesh), 0.03)

    def test_keypoints_lie_on_the_car(self) -> None:
        for mesh in self.meshes:
            # points dense enough on every face: corners, edge middles and inner points
            a, b = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, 13), np.linspace(0, 1, 13)))
            weights = np.stack([a, b, 1 - a - b], 1)[a + b <= 1 + 1e-9]
            triangles = mesh.vertices[mesh.faces].astype(float)
            for i in np.flatnonzero(np.isfinite(mesh.keypoints[:18, 0])):
                if i in (2, 3):
                    continue  # the tyre's contact lies below its rounded shoulder
                point = mesh.keypoints[i]
                near = ((triangles.min(1) < point + 0.03) & (triangles.max(1) > point - 0.03)).all(1)
                with self.subTest(mesh.name, keypoint=i):
                    self.assertTrue(near.any())
                    samples = np.einsum("sk,nkx->nsx", weights, triangles[near])
                    self.assertLess(np.linalg.norm(samples - point, axis=2).min(), 0.04)

    def test_deformed_cars_stay_cars(self) -> None:
        for mesh in self.meshes:
            for seed in range(3):
                with self.subTest(mesh.name, seed=seed):
                    other = deform(mesh, np.random.default_rng(seed))
                    self.assertLess(wheel_spread(other), wheel_spread(mesh) + 0.01)
                    tyres = other.vertices[np.unique(other.material_faces("tyre"))]
                    self.assertAlmostEqual(float(tyres[:, 2].min()), 0, delta=0.005)
                    left, right = other.keypoints[:18], other.keypoints[18:]
                    self.assertLess(np.nanmax(abs(left - right * FLIP)), 1e-9)
                    self.assertLess(abs(other.keypoints[0, 0] + other.keypoints[1, 0]), 1e-9, "origin midway")
                    moved = np.nanmax(abs(other.keypoints - mesh.keypoints))
                    self.assertTrue(0.02 < moved < 0.6, moved)
                    ratio = other.dims / mesh.dims
                    self.assertTrue(((0.85 < ratio) & (ratio < 1.15)).all(), ratio)
                    self._orientation_kept(mesh, other)

    def _orientation_kept(self, mesh: CarMesh, other: CarMesh) -> None:
        """Checks that normals agree with the winding of the faces about as well as before."""
        agree = []
        for m in (mesh, other):
            a, b, c = m.vertices[m.faces].astype(float).transpose(1, 0, 2)
            face = np.cross(b - a, c - a)
            agree.append(((face * m.normals[m.faces].mean(1)).sum(1) > 0).mean())
        self.assertGreater(agree[1], agree[0] - 0.01)

    def test_warp_does_not_fold(self) -> None:
        for mesh in self.meshes:
            axes = (np.linspace(low, high, n) for low, high, n in zip((-1, 0.02, 0.02), (1, 1, 1), (25, 6, 10)))
            grid = np.stack(np.meshgrid(*axes), -1).reshape(-1, 3) * (0.5 * mesh.dims[0], 0.5 * mesh.dims[1], mesh.dims[2])
            body = np.zeros(len(grid), bool)
            for seed in range(4):
                warp = _Warp.random(mesh, np.random.default_rng(seed), 1.0)
                start = warp(grid, body)
                jacobian = np.stack([(warp(grid + 1e-3 * axis, body) - start) / 1e-3 for axis in np.eye(3)], -1)
                with self.subTest(mesh.name, seed=seed):
                    self.assertGreater(np.linalg.det(jacobian).min(), 0.1)

    def test_same_seed_same_car(self) -> None:
        one, two = (deform(self.meshes[2], np.random.default_rng(7)) for _ in range(2))
        self.assertTrue(np.array_equal(one.vertices, two.vertices) and np.array_equal(one.keypoints, two.keypoints, True))
        self.assertEqual({MATERIALS[i] for i in np.unique(one.materials)} & {"glass", "paint"}, {"glass", "paint"})
