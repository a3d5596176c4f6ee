"""Weld, thin out and shade triangles: what turns a modeller's file into something quick to draw."""

from __future__ import annotations

import numpy as np


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals (F, 3) as long as twice the face's area."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def weld(vertices: np.ndarray, faces: np.ndarray, distance: float = 1e-4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge vertices closer than about `distance`; returns vertices, faces and which faces are kept (not degenerate)."""
    used = np.unique(faces)
    _, first, cell = np.unique(np.round(vertices[used] / distance), axis=0, return_index=True, return_inverse=True)
    index = np.zeros(len(vertices), int)
    index[used] = cell.ravel()
    return _without_degenerate(vertices[used[first]], index[faces])


def _without_degenerate(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a, b, c = faces.T
    kept = (a != b) & (b != c) & (c != a)
    kept[kept] = np.linalg.norm(face_normals(vertices, faces[kept]), axis=1) > 1e-9
    return vertices, faces[kept], kept


def thin_out(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertex clustering with the smallest cell that leaves at most `most` faces; input as it is if already few.

    Vertices that face different octants stay apart, so that a shell's inner and outer skin do not fall together.
    Clusters span materials: no cracks open between them.
    """
    everything = np.ones(len(faces), bool)
    if len(faces) <= most:
        return vertices, faces, everything
    normal = np.zeros_like(vertices)
    np.add.at(normal, faces.ravel(), np.repeat(face_normals(vertices, faces), 3, axis=0))
    octant = normal > 0
    for cell in 0.004 * 1.15 ** np.arange(24):
        key = np.concatenate([np.floor(vertices / cell), octant], axis=1)
        _, cluster = np.unique(key, axis=0, return_inverse=True)
        cluster = cluster.ravel()
        count = np.bincount(cluster)
        mean = np.stack([np.bincount(cluster, axis) / count for axis in vertices.T], axis=1)
        result = _without_degenerate(mean, cluster[faces])
        if len(result[1]) <= most:
            break
    return result


def smooth_normals(vertices: np.ndarray, faces: np.ndarray, crease_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split vertices at creases; returns vertices (n, 3), unit normals (n, 3) and faces into them.

    A corner's normal is the area-weighted mean of the faces around its vertex that lie within the crease angle of its own.
    """
    area_normal = face_normals(vertices, faces)
    unit = area_normal / np.linalg.norm(area_normal, axis=1, keepdims=True)
    corner_vertex = faces.ravel()
    order = np.argsort(corner_vertex, kind="stable")
    degree = np.bincount(corner_vertex, minlength=len(vertices))
    start = np.concatenate([[0], np.cumsum(degree)[:-1]])
    # every ordered pair of corners that share a vertex
    mine = np.repeat(np.arange(len(corner_vertex)), degree[corner_vertex])
    before = np.cumsum(degree[corner_vertex]) - degree[corner_vertex]
    step = np.arange(len(mine)) - np.repeat(before, degree[corner_vertex])
    other = order[np.repeat(start[corner_vertex], degree[corner_vertex]) + step]
    near = (unit[mine // 3] * unit[other // 3]).sum(1) > np.cos(np.radians(crease_deg))
    normal = np.zeros((len(corner_vertex), 3))
    np.add.at(normal, mine[near], area_normal[other[near] // 3])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    key = np.concatenate([corner_vertex[:, None], np.round(normal * 200)], axis=1)
    _, first, corner = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return vertices[corner_vertex[first]], normal[first], corner.reshape(-1, 3)
