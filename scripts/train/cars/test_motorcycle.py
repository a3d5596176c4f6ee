"""Tests of motorcycles with riders."""

from __future__ import annotations

import numpy as np
import pytest

from .mesh import MATERIALS, CarMesh
from .motorcycle import limb, sample_motorcycle


@pytest.fixture
def machine() -> CarMesh:
    """Returns a machine of one triangle."""
    points = np.array([[1, 0, 0], [-1, 0.3, 0], [0, 0, 1.1]], np.float32)
    return CarMesh(
        "test", "motorcycle", points, np.tile(np.float32([0, 1, 0]), (3, 1)), np.array([[0, 1, 2]], np.int32),
        np.array([MATERIALS.index("paint")], np.uint8), np.full((36, 3), np.nan), np.array([2.0, 0.8, 1.1]),
    )  # fmt: skip


def test_a_limb_is_a_closed_solid_with_outward_faces() -> None:
    points, normals, faces = limb(np.array([0.0, 0, 0]), np.array([0.3, 0.4, 0]), (0.1, 0.1))
    a, b, c = (points[faces[:, k]] for k in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    exact = np.pi * 0.1**2 * (0.5 + 4 / 3 * 0.1)
    assert 0.85 * exact < volume < exact
    assert (np.cross(b - a, c - a) * normals[faces[:, 0]]).sum(1).min() > -1e-9
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)


def test_riders_sit_on_the_machine(machine: CarMesh) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        mesh = sample_motorcycle(rng, [machine])
        low, high = mesh.vertices.min(0), mesh.vertices.max(0)
        assert 1.4 < high[2] < 1.95 and low[2] >= 0
        assert high[0] - low[0] < 2.5 and 0.5 < high[1] - low[1] < 1.0
        assert mesh.dims[2] == pytest.approx(high[2])
        assert mesh.faces.max() == len(mesh.vertices) - 1 and len(mesh.materials) == len(mesh.faces)


def test_a_parked_machine_has_no_rider(machine: CarMesh) -> None:
    assert len(sample_motorcycle(np.random.default_rng(1), [machine], ridden=False).faces) == 1
