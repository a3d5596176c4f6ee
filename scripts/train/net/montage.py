"""Draws a sheet of crops with predicted keypoints.

roadplane-train net montage --weights RUN/last.pt --out FILE.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import torch

from roadplane_train.net.data import Shards, read_real
from roadplane_train.net.evaluate import LEAST_SCORE, Crop, confusion_of, load, predict, real_crops, shard_crops
from roadplane_train.net.model import Deployed

LEFT, RIGHT, FAINT, TRUTH = (255, 60, 60), (60, 140, 255), (150, 150, 150), (0, 255, 0)


def montage(net: Deployed, crops: list[Crop], columns: int = 6, zoom: int = 3) -> np.ndarray:
    """Draws crops with their truth (green) and a line to each prediction, RGB.

    In the other half, all predictions: the car's left red, right blue, grey if the score says hidden. A yellow frame
    marks cars with exchanged names.
    """
    means, _, seen = predict(net, [c.image for c in crops])
    tiles = []
    for crop, mean, score in zip(crops, means, seen):
        tile = cv2.resize(crop.image, None, fx=zoom, fy=zoom)

        def at(point: np.ndarray) -> tuple[int, int]:
            return tuple(int(v) for v in (point + 0.5) * zoom)

        for k in np.flatnonzero(crop.clear):
            cv2.line(tile, at(crop.points[k]), at(mean[k]), TRUTH, 1, cv2.LINE_AA)
            cv2.circle(tile, at(crop.points[k]), 4, TRUTH, 1, cv2.LINE_AA)
        for k in range(len(mean)):
            shown = score[k] > LEAST_SCORE
            colour = (LEFT if k < 18 else RIGHT) if shown else FAINT
            cv2.circle(tile, at(mean[k]), 3 if shown else 1, colour, -1, cv2.LINE_AA)
        if confusion_of(mean, crop):
            cv2.rectangle(tile, (1, 1), (tile.shape[1] - 2, tile.shape[0] - 2), (255, 255, 0), 3)
        tiles.append(tile)
    while len(tiles) % columns:
        tiles.append(np.zeros_like(tiles[0]))
    return np.vstack([np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)])


def main() -> None:
    """Writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path, required=True)
    parser.add_argument("--work-px", type=int)
    parser.add_argument("--crops", type=Path, default=Path(".work/crops/eval"))
    parser.add_argument("--real", type=Path, help="draw the labelled real cars of this folder instead")
    parser.add_argument("--only", nargs="*", help="real images (file stems)")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.real:
        crops = [c for c in real_crops(read_real(args.real)) if not args.only or c.group in args.only]
    else:
        crops = shard_crops(Shards(args.crops, limit=args.count))
    cv2.imwrite(str(args.out), montage(load(args.weights, args.work_px), crops[: args.count])[..., ::-1])


if __name__ == "__main__":
    main()
