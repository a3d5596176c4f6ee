"""Welds, simplifies and shades triangles, so that a modeller's file is quick to draw."""

from __future__ import annotations

import fast_simplification
import numpy as np

SMALL_PART = 300  # faces


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns normals (F, 3), each as long as twice the area of its face."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def weld(vertices: np.ndarray, faces: np.ndarray, distance: float = 1e-4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merges vertices within about `distance`; returns vertices, faces and which faces are kept (not degenerate)."""
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


def thin_out(vertices: np.ndarray, faces: np.ndarray, parts: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Simplifies each part (F,) by quadrics to the same share of its faces, at most `most` in all.

    Returns vertices, faces and their parts; the input if there are few enough. Small parts stay unchanged.
    """
    if len(faces) <= most:
        return vertices, faces, parts
    names, sizes = np.unique(parts, return_counts=True)
    small = sizes < SMALL_PART
    share = (most - sizes[small].sum()) / sizes[~small].sum()
    out_vertices, out_faces, out_parts, offset = [], [], [], 0
    for name, whole in zip(names, small):
        used, index = np.unique(faces[parts == name], return_inverse=True)
        v, f = vertices[used], index.reshape(-1, 3)
        if not whole:
            v, f = fast_simplification.simplify(v, f, target_reduction=1 - share, agg=4)
        out_vertices.append(v)
        out_faces.append(f + offset)
        out_parts.append(np.full(len(f), name))
        offset += len(v)
    v, f, kept = _without_degenerate(np.concatenate(out_vertices), np.concatenate(out_faces))
    return v, f, np.concatenate(out_parts)[kept]


def smooth_normals(vertices: np.ndarray, faces: np.ndarray, crease_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Splits vertices at creases; returns vertices (n, 3), unit normals (n, 3) and faces into them.

    The normal of a corner is the area-weighted mean over the faces around its vertex that lie within the crease angle
    of its own.
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
