"""Draws a sheet of the crops of a shard, with their keypoints.

roadplane-train render montage SHARD.npz OUT.png [--first N]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from roadplane_train.cars.mesh import KEYPOINTS


def montage(shard: dict[str, np.ndarray], first: int = 0, rows: int = 8, scale: int = 2, marks: bool = True) -> np.ndarray:
    """Draws a BGR sheet of crops: left side red, right side green.

    Filled = visible, hollow = hidden; the wireframe thin.
    """
    tiles = []
    for i in range(first, min(first + rows * rows, len(shard["image"]))):
        tile = cv2.resize(shard["image"][i][..., ::-1], None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        points = (shard["keypoints"][i] + 0.5) * scale - 0.5
        if marks:
            for a, b in KEYPOINTS["edges"]:
                if np.isfinite(points[[a, b]]).all() and shard["visible"][i][[a, b]].all():
                    cv2.line(tile, *(tuple(int(v) for v in points[k].round()) for k in (a, b)), (255, 160, 0), 1, cv2.LINE_AA)
            for k, point in enumerate(points):
                if np.isfinite(point).all():
                    colour = (60, 60, 255) if k < 18 else (60, 220, 60)
                    at = tuple(int(v) for v in point.round())
                    if shard["visible"][i][k]:
                        cv2.circle(tile, at, 3, colour, -1, cv2.LINE_AA)
                    else:
                        cv2.circle(tile, at, 2, colour, 1, cv2.LINE_AA)
        tiles.append(tile)
    blank = np.zeros_like(tiles[0])
    tiles += [blank] * (-len(tiles) % rows)
    return np.vstack([np.hstack(tiles[i : i + rows]) for i in range(0, len(tiles), rows)])


def main() -> None:
    """Writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shard", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rows", type=int, default=8)
    parser.add_argument("--scale", type=int, default=2)
    parser.add_argument("--bare", action="store_true", help="without keypoints")
    options = parser.parse_args()
    with np.load(options.shard) as shard:
        sheet = montage(dict(shard), options.first, options.rows, options.scale, not options.bare)
    cv2.imwrite(str(options.out), sheet)


if __name__ == "__main__":
    main()
