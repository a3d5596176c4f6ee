"""Deforms a car smoothly into another one; wheels stay round, sides alike, and tyres on the ground."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from .mesh import MATERIALS, CarMesh

LATTICE = (7, 3, 4)  # control points along x, across (y²) and up
WHEEL_MATERIALS = [MATERIALS.index(name) for name in ("tyre", "rim")]
WHEEL_KEYPOINTS = np.isin(np.arange(36) % 18, (0, 1, 2, 3))
STEP_M = 1e-3  # for the derivative that turns normals


def deform(mesh: CarMesh, rng: np.random.Generator, strength: float = 1.0) -> CarMesh:
    """Returns a car with the same parts but other proportions.

    Keypoints and normals follow. `strength` scales every change.
    """
    warp = _Warp.random(mesh, rng, strength)
    in_wheel = np.zeros(len(mesh.vertices), bool)
    in_wheel[mesh.faces[np.isin(mesh.materials, WHEEL_MATERIALS)]] = True
    vertices = mesh.vertices.astype(float)
    along, across = _tangents(mesh.normals.astype(float))
    moved, moved_along, moved_across = (warp(vertices + STEP_M * step, in_wheel) for step in (np.zeros(3), along, across))
    normals = np.cross(moved_along - moved, moved_across - moved)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    known = np.isfinite(mesh.keypoints).all(1)
    keypoints = mesh.keypoints.copy()
    keypoints[known] = warp(keypoints[known], WHEEL_KEYPOINTS[known])
    # the origin stays midway between the axles, so it moves with them
    return replace(
        mesh, vertices=moved.astype(np.float32), normals=normals.astype(np.float32), keypoints=keypoints,
        dims=_dims(mesh, moved, warp),
    )  # fmt: skip


@dataclass(frozen=True)
class _Warp:
    """`car' = warp(car)`: scales by axis and adds a cubic B-spline lattice of offsets; near a wheel it is rigid."""

    scale: np.ndarray  # (3,)
    offsets: np.ndarray  # (*LATTICE, 3): metres; the second component per half width
    low: np.ndarray  # (3,) of x, (y / half width)², z
    high: np.ndarray
    half_width: float
    hubs: np.ndarray  # (2, 3) left front and left rear
    tyre_radius: float

    @staticmethod
    def random(mesh: CarMesh, rng: np.random.Generator, strength: float) -> _Warp:
        """Draws proportions within the range of cars of one kind: a few per cent in size, centimetres in shape."""
        x, y, z = mesh.vertices.T.astype(float)
        offsets = rng.normal(0, 1, (*LATTICE, 3)).clip(-2, 2) * (0.02, 0.012, 0.015)
        up = np.linspace(0, 1, LATTICE[2])  # 0 at the lowest layer
        front, rear = rng.uniform(-0.09, 0.09, 2)
        offsets[-2:, :, :, 0] += front * np.array([0.5, 1])[:, None, None]
        offsets[:2, :, :, 0] += rear * np.array([1, 0.5])[:, None, None]
        bonnet, roof, boot = rng.uniform(-1, 1, 3) * (0.06, 0.09, 0.07)
        offsets[..., 2] += np.array([boot, boot, 0.7 * roof, roof, 0.7 * roof, bonnet, bonnet])[:, None, None] * up
        offsets[..., 0] += rng.uniform(-0.06, 0.06) * up**2  # rake of both screens
        offsets[:, :, 0, 2] = 0  # sills and floor stay level
        tyres = mesh.vertices[np.unique(mesh.material_faces("tyre"))]
        half_width = float(abs(y).max())
        return _Warp(
            scale=1 + strength * rng.uniform(-1, 1, 3) * (0.07, 0.05, 0.06), offsets=strength * offsets,
            low=np.array([x.min(), 0, 0]), high=np.array([x.max(), 1, z.max()]), half_width=half_width,
            hubs=mesh.keypoints[:2].copy(), tyre_radius=float(tyres[:, 2].max()) / 2,
        )  # fmt: skip

    def free(self, points: np.ndarray) -> np.ndarray:
        """Applies the lattice alone, without regard to wheels; it is even in y, so both sides stay alike."""
        coordinates = points.copy()
        coordinates[:, 1] = (points[:, 1] / self.half_width) ** 2
        coordinates = ((coordinates - self.low) / (self.high - self.low)).clip(0, 1)
        weights = [_basis(c, n) for c, n in zip(coordinates.T, LATTICE)]
        x, y, z = weights
        blend = (x[:, :, None, None] * (y[:, None, :, None] * z[:, None, None, :])).reshape(len(points), -1)
        offset = blend @ self.offsets.reshape(-1, 3)
        offset[:, 1] *= points[:, 1] / self.half_width
        return points * self.scale + offset

    def __call__(self, points: np.ndarray, in_wheel: np.ndarray) -> np.ndarray:
        """Maps points (n, 3); those `in_wheel` move with their wheel as one rigid part."""
        moved = self.free(points)
        free_hubs = self.free(self.hubs)
        grow = self.scale[2]
        middle = free_hubs[:, 0].mean()
        side = np.where(points[:, 1] < 0, -1.0, 1.0)
        for hub, free_hub in zip(self.hubs, free_hubs):
            relative = (points - hub * (1, 0, 0))[:, [0, 2]] - (0, self.tyre_radius)
            distance = np.linalg.norm(relative, axis=1) / self.tyre_radius
            # arches keep their gap to the tyre; away from them the deformation of the body applies
            follow = 1 - _smoothstep((distance - 1.1) / 0.8)
            target_xz = grow * relative + (free_hub[0], grow * self.tyre_radius)
            moved[:, [0, 2]] += follow[:, None] * (target_xz - moved[:, [0, 2]])
            mine = in_wheel & (distance < 1.2)
            moved[mine, 1] = points[mine, 1] + side[mine] * (free_hub[1] - hub[1])
        moved[:, 0] -= middle
        return moved


def _basis(t: np.ndarray, count: int) -> np.ndarray:
    """Returns the clamped uniform B-spline basis (n, count) on 0…1: cubic, or lower with few control points."""
    degree = min(3, count - 1)
    inner = np.linspace(0, 1, count - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    return BSpline.design_matrix(t, knots, degree).toarray()


def _smoothstep(t: np.ndarray) -> np.ndarray:
    t = t.clip(0, 1)
    return t * t * (3 - 2 * t)


def _tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across each normal, right-handed with it."""
    helper = np.where(abs(normals[:, :1]) < 0.7, (1.0, 0, 0), (0, 1.0, 0))
    along = np.cross(normals, helper)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return along, np.cross(normals, along)


def _dims(mesh: CarMesh, moved: np.ndarray, warp: _Warp) -> np.ndarray:
    """Returns length, width and height after the warp; mirrors and aerials protrude as far as before."""
    body = mesh.vertices[:, 2] <= mesh.dims[2] + 0.002
    height = moved[body, 2].max()
    side = np.array([[0.0, mesh.dims[1] / 2, 0.45 * mesh.dims[2]]])
    return np.array([np.ptp(moved[:, 0]), 2 * warp.free(side)[0, 1], height])
