"""How far predicted keypoints are off: `python -m net.evaluate --weights RUN/last.pt` (PYTHONPATH=scripts/train)."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch

from cars.mesh import KEYPOINT_NAMES
from net.data import RealCar, Shards, apply, crop_from_box, read_real, warp
from net.decode import decode
from net.model import Deployed, StackedHourglass


@dataclass
class Crop:
    """One crop with its truth: points crop px, `clear` points are measured, `hidden` ones only scored."""

    image: np.ndarray
    points: np.ndarray
    clear: np.ndarray
    hidden: np.ndarray
    side: float  # longer side of the true box, crop px
    group: str


@dataclass
class Result:
    """Errors of all clear points in units of the box's longer side, and what judges the uncertainty."""

    error: np.ndarray  # [n]
    index: np.ndarray  # [n] keypoint
    car: np.ndarray  # [n]
    normalised: np.ndarray  # [n, 2] error / predicted sd
    score_seen: np.ndarray
    score_hidden: np.ndarray
    turned: int  # cars whose predictions fit the truth better with left/right or front/back exchanged
    cars: int

    def pck(self, threshold: float) -> float:
        """Share of points nearer than this."""
        return float((self.error <= threshold).mean())

    def auc(self) -> float:
        """Probability that a visible point scores above a hidden one."""
        if not len(self.score_seen) or not len(self.score_hidden):
            return float("nan")
        ranks = np.concatenate([self.score_seen, self.score_hidden]).argsort().argsort()
        n, m = len(self.score_seen), len(self.score_hidden)
        return float((ranks[:n].sum() - n * (n - 1) / 2) / (n * m))

    def robust_sd(self) -> float:
        """1.4826 · median |normalised error|: 1 when predicted sd are honest."""
        return float(1.4826 * np.median(np.abs(self.normalised)))

    def line(self) -> str:
        """One line for people."""
        return (
            f"{self.cars} cars, {len(self.error)} points: median {100 * np.median(self.error):.2f} % "
            f"PCK.05 {100 * self.pck(0.05):.1f} PCK.1 {100 * self.pck(0.1):.1f} "
            f"AUC {self.auc():.3f} normalised sd {self.robust_sd():.2f} turned {self.turned}"
        )


def shard_crops(shards: Shards, count: int) -> list[Crop]:
    """Rendered crops; the box's size is taken from the visible and hidden points, as real labels have no better."""
    crops = []
    for image, points, seen in zip(shards.images[:count], shards.points, shards.visible):
        exists = np.isfinite(points[:, 0])
        side = float((np.nanmax(points, 0) - np.nanmin(points, 0)).max())
        crops.append(Crop(image, points, exists & (seen > 0), exists & (seen == 0), side, "rendered"))
    return crops


def real_crops(cars: list[RealCar]) -> list[Crop]:
    """Real cars cut out by their true boxes."""
    crops = []
    for car in cars:
        matrix = crop_from_box(car.box)
        side = float((car.box[2:] - car.box[:2]).max() * abs(matrix[0, 0]))
        points = apply(matrix, car.points)
        crops.append(Crop(warp(car.patch, matrix), points, car.flag == 2, car.flag == 1, side, car.source))
    return crops


def predict(net: StackedHourglass, images: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means [n, 36, 2], covariances [n, 36, 2, 2] (crop px, uncalibrated) and visibility [n, 36]."""
    deployed = Deployed(net).eval()
    means, covariances, seen = [], [], []
    with torch.no_grad():
        for i in range(0, len(images), 32):
            batch = torch.from_numpy(np.stack(images[i : i + 32])).permute(0, 3, 1, 2).float().div(255)
            heatmaps, visibility = deployed(batch)
            mean, covariance = decode(heatmaps.numpy())
            means.append(mean)
            covariances.append(covariance)
            seen.append(visibility.numpy())
    return np.concatenate(means), np.concatenate(covariances), np.concatenate(seen)


def evaluate(net: StackedHourglass, crops: list[Crop], scale: float = 1.0, floor: float = 0.0) -> Result:
    """Measures a net on crops; `scale` and `floor` calibrate the sd as the card's numbers do."""
    means, covariances, seen = predict(net, [c.image for c in crops])
    error, index, car, normalised, score_seen, score_hidden, turned = [], [], [], [], [], [], 0
    side_swap = np.array([(k + 18) % 36 for k in range(36)])
    for i, crop in enumerate(crops):
        clear = np.flatnonzero(crop.clear)
        delta = means[i][clear] - crop.points[clear]
        error.extend(np.hypot(*delta.T) / crop.side)
        index.extend(clear)
        car.extend([i] * len(clear))
        variance = np.diagonal(covariances[i][clear], axis1=1, axis2=2)
        normalised.extend(delta / np.sqrt(scale**2 * variance + floor**2 + 1e-9))
        score_seen.extend(seen[i][clear])
        score_hidden.extend(seen[i][crop.hidden])
        if len(clear) >= 4:
            swapped = np.median(np.hypot(*(means[i][side_swap[clear]] - crop.points[clear]).T))
            turned += bool(swapped < np.median(np.hypot(*delta.T)))
    return Result(
        np.array(error), np.array(index), np.array(car), np.array(normalised).reshape(-1, 2),
        np.array(score_seen), np.array(score_hidden), turned, len(crops),
    )


def montage(net: StackedHourglass, crops: list[Crop], columns: int = 8, zoom: int = 2) -> np.ndarray:
    """Crops with truth (green rings) and prediction (red, faint where it says hidden), RGB."""
    means, _, seen = predict(net, [c.image for c in crops])
    tiles = []
    for crop, mean, score in zip(crops, means, seen):
        tile = cv2.resize(crop.image, None, fx=zoom, fy=zoom)
        for k in np.flatnonzero(crop.clear):
            centre = tuple(int(v) for v in (crop.points[k] + 0.5) * zoom)
            cv2.circle(tile, centre, 2 * zoom, (0, 255, 0), 1, cv2.LINE_AA)
        for k in range(36):
            colour = (255, 40, 40) if score[k] > 0.5 else (90, 90, 200)
            cv2.circle(tile, tuple(int(v) for v in (mean[k] + 0.5) * zoom), zoom, colour, -1, cv2.LINE_AA)
        tiles.append(tile)
    while len(tiles) % columns:
        tiles.append(np.zeros_like(tiles[0]))
    return np.vstack([np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)])


def load(path: Path) -> StackedHourglass:
    """The averaged weights of a run."""
    state = torch.load(path)
    net = StackedHourglass(state["stacks"], state["channels"])
    net.load_state_dict(state["average"])
    return net.eval()


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--weights", type=Path, default=Path(".work/runs/hourglass/last.pt"))
    parser.add_argument("--crops", type=Path, default=Path(".work/crops/eval"))
    parser.add_argument("--real", type=Path, help="folder of hand-labelled cars")
    parser.add_argument("--count", type=int, default=1024)
    parser.add_argument("--montage", type=Path, help="PNG to draw real (else rendered) crops into")
    args = parser.parse_args()
    net = load(args.weights)
    groups = {"rendered": shard_crops(Shards(args.crops), args.count)}
    for car in real_crops(read_real(args.real)) if args.real else []:
        groups.setdefault(car.group, []).append(car)
    for name, crops in groups.items():
        if crops:
            result = evaluate(net, crops)
            print(f"{name}: {result.line()}")
            if name == "rendered":
                for k, label in enumerate(KEYPOINT_NAMES[:18]):
                    mine = result.error[result.index % 18 == k]
                    print(f"  {label[5:]:<20} {100 * np.median(mine):.2f} %" if len(mine) else f"  {label[5:]} -")
    if args.montage:
        drawn = [c for name, crops in groups.items() if name != "rendered" for c in crops] or groups["rendered"]
        cv2.imwrite(str(args.montage), montage(net, drawn[:64])[..., ::-1])


if __name__ == "__main__":
    main()
