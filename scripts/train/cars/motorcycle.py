"""Motorcycles and motor scooters with their riders; the origin is on the ground at half the machine's length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .mesh import MATERIALS, CarMesh

SIDES, RINGS = 10, 5  # of a limb
HELMET_M = 0.15  # radius
PILLION_SHARE = 0.15
# Joints of a rider's left side, m forwards, left and up of the seat. ESTIMATES of an adult.
HIP, SHOULDER, ELBOW, HAND = (0.0, 0.11, 0.06), (0.18, 0.19, 0.5), (0.38, 0.27, 0.28), (0.58, 0.3, 0.26)
KNEE, FOOT = (0.38, 0.2, -0.05), (0.16, 0.2, -0.45)


def limb(start: np.ndarray, end: np.ndarray, radii: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns a tapered tube with round ends: points [n, 3], normals [n, 3], faces [m, 3]."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    axis = axis / max(length, 1e-9)
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    turns = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    around = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * other
    points, normals = [], []
    for centre, radius, slopes in (
        (start, radii[0], np.linspace(-np.pi / 2, 0, RINGS)),
        (end, radii[1], np.linspace(0, np.pi / 2, RINGS)),
    ):
        for slope in slopes:
            normal = np.cos(slope) * around + np.sin(slope) * axis
            points.append(centre + radius * normal)
            normals.append(normal)
    rows = len(points)
    k = np.arange(SIDES)
    faces = [
        np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])
        for row in range(rows - 1)
        for a, b, c, d in [
            (row * SIDES + k, row * SIDES + (k + 1) % SIDES, (row + 1) * SIDES + k, (row + 1) * SIDES + (k + 1) % SIDES)
        ]
    ]
    return np.concatenate(points), np.concatenate(normals), np.concatenate(faces)


def rider(rng: np.random.Generator, seat: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, str]]:
    """Returns the limbs of a person who sits at a point (x, y, z) of the machine, each with its material."""
    size, lean = rng.uniform(0.92, 1.06), rng.uniform(-0.12, 0.35)
    cos, sin = np.cos(lean), np.sin(lean)
    bend = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])  # of the trunk, forwards

    def joint(at: tuple[float, float, float], side: int, trunk: bool) -> np.ndarray:
        point = np.array(at) * [1, side, 1] * size
        return seat + (bend @ point if trunk else point)

    jacket, trousers = ("livery", "plastic") if rng.random() < 0.7 else ("plastic", "underbody")
    shoulders, hips = ((joint(p, 1, True) + joint(p, -1, True)) / 2 for p in (SHOULDER, HIP))
    head = shoulders + bend @ np.array([0.06, 0.0, 0.26]) * size
    parts = [
        (hips, shoulders, (0.17, 0.2), jacket),
        (head, head + [0.01, 0, 0.03], (HELMET_M, HELMET_M), "paint" if rng.random() < 0.5 else "livery"),
    ]
    for side in (-1, 1):
        parts += [
            (joint(SHOULDER, side, True), joint(ELBOW, side, True), (0.07, 0.05), jacket),
            (joint(ELBOW, side, True), joint(HAND, side, False), (0.05, 0.045), jacket),
            (joint(HIP, side, False), joint(KNEE, side, False), (0.1, 0.075), trousers),
            (joint(KNEE, side, False), joint(FOOT, side, False), (0.07, 0.06), trousers),
        ]
    return [(*limb(start, end, radii), material) for start, end, radii, material in parts]


def sample_motorcycle(rng: np.random.Generator, machines: list[CarMesh], ridden: bool = True) -> CarMesh:
    """Returns a machine of `machines`, a little longer or shorter, with a rider and sometimes a pillion rider."""
    machine = machines[rng.integers(len(machines))]
    scale = rng.uniform(0.93, 1.1) * rng.uniform(0.97, 1.03, 3)
    vertices = machine.vertices * scale.astype(np.float32)
    people: list[tuple[np.ndarray, np.ndarray, np.ndarray, str]] = []
    if ridden:
        seat = np.array([-0.12 * machine.dims[0], 0.0, 0.66 * machine.dims[2]]) * scale + rng.normal(0, 0.02, 3) * [1, 0, 1]
        people += rider(rng, seat)
        if rng.random() < PILLION_SHARE:
            people += rider(rng, seat + [-0.34, 0.0, 0.08])
    points, normals, faces, materials = [vertices], [machine.normals], [machine.faces], [machine.materials]
    for at, normal, triangles, material in people:
        faces.append(triangles + sum(map(len, points)))
        points.append(at)
        normals.append(normal)
        materials.append(np.full(len(triangles), MATERIALS.index(material)))
    whole = np.concatenate(points)
    dims = np.array([*np.ptp(vertices[:, :1], axis=0), machine.dims[1] * scale[1], whole[:, 2].max()])
    return replace(
        machine,
        vertices=whole.astype(np.float32),
        normals=np.concatenate(normals).astype(np.float32),
        faces=np.concatenate(faces).astype(np.int32),
        materials=np.concatenate(materials).astype(np.uint8),
        dims=dims,
    )
