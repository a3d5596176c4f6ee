"""Evaluates predicted keypoints: errors, PCK, visibility, exchanged names.

roadplane-train net evaluate --weights RUN/last.pt
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from roadplane_train.cars.mesh import KEYPOINT_NAMES, MIRROR
from roadplane_train.net.data import RealCar, Shards, apply, crop_from_box, crop_from_rendered, read_real, warp
from roadplane_train.net.decode import Calibration, decode
from roadplane_train.net.model import Deployed, StackedHourglass
from roadplane_train.net.start import read_weights

# Index of the keypoint at the other end of the car; mirror and B-pillar have none and map to themselves.
_ENDS = [1, 0, 3, 2, 6, 7, 4, 5, 9, 8, 13, 12, 11, 10, 14, 16, 15, 17]
FRONT_BACK = np.array(_ENDS + [k + 18 for k in _ENDS])
LEFT_RIGHT = np.array(MIRROR)
CONFUSIONS = {"left/right": LEFT_RIGHT, "front/back": FRONT_BACK, "turned round": LEFT_RIGHT[FRONT_BACK]}
NORMAL_SD_PER_MAD = 1.4826
SIZES_PX = (0, 30, 60, 100, 200, 10_000)
ELEVATIONS_DEG = (0, 4, 10, 25, 90)
LEAST_SCORE = 0.5  # `solve.min_keypoint_score` of the product: keypoints below it do not count


def robust_sd(values: np.ndarray) -> float:
    """Returns 1.4826 · median |value|: the sd of normal errors around 0, regardless of a few gross ones."""
    return float(NORMAL_SD_PER_MAD * np.median(np.abs(values)))


@dataclass
class Crop:
    """One crop with its truth: points in crop px; `clear` points are measured, `hidden` ones are mainly scored."""

    image: np.ndarray
    points: np.ndarray
    clear: np.ndarray
    hidden: np.ndarray
    side: float  # longer side of the true box, crop px
    car_px: float  # the same in pixels of the picture
    body: str
    group: str
    elevation_deg: float = np.nan  # of the camera above the car's ground; real cars have none


@dataclass
class Result:
    """Errors of all n clear points of a set of crops."""

    error: np.ndarray  # [n] units of the box's longer side
    index: np.ndarray  # [n] keypoint
    car: np.ndarray  # [n] index of the crop
    offset: np.ndarray  # [n, 2] predicted − true, crop px
    covariance: np.ndarray  # [n, 2, 2] crop px²: of the measurement, or of the heatmap around its peak
    score_seen: np.ndarray
    score_hidden: np.ndarray
    error_hidden: np.ndarray  # of the hidden points, units of the box's longer side
    confused: dict[str, list[int]]  # crops whose points fit better with exchanged names
    cars: int

    def pck(self, threshold: float) -> float:
        """Returns the share of points nearer than this."""
        return float((self.error <= threshold).mean())

    def auc(self) -> float:
        """Returns the probability that a visible point scores above a hidden one."""
        n, m = len(self.score_seen), len(self.score_hidden)
        if not n or not m:
            return float("nan")
        ranks = np.concatenate([self.score_seen, self.score_hidden]).argsort().argsort()
        return float((ranks[:n].sum() - n * (n - 1) / 2) / (n * m))

    def robust_sd(self) -> float:
        """Returns the robust sd of the normalised error: 1 if the predicted sds are calibrated."""
        variance = np.diagonal(self.covariance, axis1=1, axis2=2)
        return robust_sd(self.offset / np.sqrt(variance + 1e-9))

    def hidden_that_count(self) -> str:
        """Returns the share of hidden points that the product takes for visible and their median error, as a text."""
        counts = self.score_hidden >= LEAST_SCORE
        if not counts.any():
            return "none"
        return f"{100 * counts.mean():.1f} %, median error {100 * np.median(self.error_hidden[counts]):.2f} %"

    def numbers(self) -> dict[str, float | int | dict]:
        """Returns the figures for a model card."""
        return {
            "cars": self.cars,
            "points": len(self.error),
            "median_error_of_box": round(float(np.median(self.error)), 4),
            "pck_0.05": round(self.pck(0.05), 4),
            "pck_0.1": round(self.pck(0.1), 4),
            "visibility_auc": round(self.auc(), 4) if np.isfinite(self.auc()) else None,
            "normalised_error_robust_sd": round(self.robust_sd(), 3),
            "confused_cars": {name: len(cars) for name, cars in self.confused.items()},
        }

    def line(self) -> str:
        """Returns a summary in one line."""
        confused = ", ".join(f"{name} {len(cars)}" for name, cars in self.confused.items())
        return (
            f"{self.cars} cars, {len(self.error)} points: median {100 * np.median(self.error):.2f} % "
            f"PCK.05 {100 * self.pck(0.05):.1f} PCK.1 {100 * self.pck(0.1):.1f} AUC {self.auc():.3f} "
            f"raw normalised sd {self.robust_sd():.2f}, confused: {confused}; "
            f"hidden points that count: {self.hidden_that_count()}"
        )


def shard_crops(shards: Shards, count: int | None = None) -> list[Crop]:
    """Returns the first `count` rendered crops, as the net's input."""
    matrix, crops = crop_from_rendered(), []
    for i in range(min(len(shards), count or len(shards))):
        exists, seen = np.isfinite(shards.points[i][:, 0]), shards.visible[i] > 0
        crops.append(
            Crop(
                warp(shards.images[i], matrix),
                apply(matrix, shards.points[i]),
                exists & seen,
                exists & ~seen,
                float(shards.sides[i]) * matrix[0, 0],
                float(shards.sizes[i]),
                str(shards.bodies[i]),
                "rendered",
                float(shards.elevations[i]),
            )
        )
    return crops


def real_crops(cars: list[RealCar]) -> list[Crop]:
    """Returns real cars, cropped by their true boxes."""
    crops = []
    for car in cars:
        matrix = crop_from_box(car.box)
        longer = float((car.box[2:] - car.box[:2]).max())
        crops.append(
            Crop(
                warp(car.patch, matrix),
                apply(matrix, car.points),
                car.flag == 2,
                car.flag == 1,
                longer * abs(matrix[0, 0]),
                longer,
                car.body,
                car.source,
            )
        )
    return crops


def predict(net: nn.Module, images: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns means [n, 36, 2], covariances [n, 36, 2, 2] (crop px, uncalibrated) and visibility [n, 36]."""
    means, covariances, seen = [], [], []
    with torch.no_grad():
        for i in range(0, len(images), 32):
            batch = torch.from_numpy(np.stack(images[i : i + 32])).permute(0, 3, 1, 2).float().div(255)
            heatmaps, visibility = net(batch)
            mean, covariance = decode(heatmaps.numpy())
            means.append(mean)
            covariances.append(covariance)
            seen.append(visibility.numpy())
    return np.concatenate(means), np.concatenate(covariances), np.concatenate(seen)


def confusion_of(mean: np.ndarray, crop: Crop) -> str | None:
    """Returns the exchange of names that makes a car's prediction fit better, if any; needs four clear points."""
    clear = np.flatnonzero(crop.clear)
    if len(clear) < 4:
        return None

    def misfit(order: np.ndarray) -> float:
        return float(np.median(np.hypot(*(mean[order[clear]] - crop.points[clear]).T)))

    best = min(CONFUSIONS, key=lambda name: misfit(CONFUSIONS[name]))
    return best if misfit(CONFUSIONS[best]) < misfit(np.arange(len(mean))) else None


def evaluate(net: Deployed, crops: list[Crop], calibration: Calibration | None = None) -> Result:
    """Evaluates a deployed net on crops; without calibration, its bare peaks."""
    means, covariances, seen = predict(net, [c.image for c in crops])
    if calibration:
        means, covariances = calibration.measurement(means, covariances)
    confused: dict[str, list[int]] = {name: [] for name in CONFUSIONS}
    for i, crop in enumerate(crops):
        if name := confusion_of(means[i], crop):
            confused[name].append(i)
    clear = np.stack([c.clear for c in crops])
    hidden = np.stack([c.hidden for c in crops])
    car, index = np.nonzero(clear)
    truth, sides = np.stack([c.points for c in crops]), np.array([c.side for c in crops])
    offset = means[clear] - truth[clear]
    away = np.hypot(*(means[hidden] - truth[hidden]).T) / sides[np.nonzero(hidden)[0]]
    return Result(
        np.hypot(*offset.T) / sides[car],
        index,
        car,
        offset,
        covariances[clear],
        seen[clear],
        seen[hidden],
        away,
        confused,
        len(crops),
    )


def tables(result: Result, crops: list[Crop]) -> str:
    """Returns errors per keypoint, per size, per elevation of the camera, and per body."""
    error = 100 * result.error
    rows = [(name[5:], result.index % 18 == k) for k, name in enumerate(KEYPOINT_NAMES[:18])]
    sizes = np.array([c.car_px for c in crops])[result.car]
    rows += [(f"{a}–{b} px", (sizes >= a) & (sizes < b)) for a, b in zip(SIZES_PX, SIZES_PX[1:])]
    elevations = np.array([c.elevation_deg for c in crops])[result.car]
    rows += [(f"{a}–{b}°", (elevations >= a) & (elevations < b)) for a, b in zip(ELEVATIONS_DEG, ELEVATIONS_DEG[1:])]
    bodies = np.array([c.body for c in crops])[result.car]
    rows += [(body, bodies == body) for body in sorted(set(bodies))]
    return "\n".join(
        f"  {name:<20} n {mine.sum():6d}  median {np.median(error[mine]):6.2f} %  "
        f"PCK.05 {100 * (error[mine] <= 5).mean():5.1f}  PCK.1 {100 * (error[mine] <= 10).mean():5.1f}"
        for name, mine in rows
        if mine.any()
    )


def load(path: Path, work_px: int | None = None) -> Deployed:
    """Loads the averaged weights of a run, or an exported net; `work_px` replaces the input size of the training."""
    if path.suffix == ".onnx":
        made = json.loads(path.with_suffix(".card.json").read_text())["how_made"]
        stacks, channels, trained_px, weights = made["stacks"], made["channels"], made["work_px"], read_weights(path)
    else:
        state = torch.load(path, map_location="cpu")
        stacks, channels, trained_px, weights = state["stacks"], state["channels"], state["input_px"], state["average"]
    net = StackedHourglass(stacks, channels)
    net.load_state_dict(weights)
    return Deployed(net, work_px or trained_px).eval()


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path, default=Path(".work/runs/hourglass/last.pt"))
    parser.add_argument("--work-px", type=int, help="input size of the net, px (default: that of its last training)")
    parser.add_argument("--crops", type=Path, default=Path(".work/crops/eval"))
    parser.add_argument("--real", type=Path, help="folder of hand-labelled cars")
    parser.add_argument("--only", nargs="*", help="real images (file stems) to evaluate on (default: all)")
    parser.add_argument("--count", type=int, default=1024)
    parser.add_argument("--tables", action="store_true", help="prints errors per keypoint, size, elevation and body")
    args = parser.parse_args()
    torch.set_num_threads(1)
    net = load(args.weights, args.work_px)
    groups = {"rendered": shard_crops(Shards(args.crops), args.count)}
    for crop in real_crops(read_real(args.real)) if args.real else []:
        if not args.only or crop.group in args.only:
            groups.setdefault(crop.group, []).append(crop)
    for name, crops in groups.items():
        if crops:
            result = evaluate(net, crops)
            print(f"{name}: {result.line()}")
            if args.tables:
                print(tables(result, crops))


if __name__ == "__main__":
    main()
