"""The average precision of a detector, to watch its training. `roadplane-lab eval detector` has more figures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


def overlaps(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns intersection over union, and the share of each box of `a` inside each of `b`, [n, m] each."""
    a, b = a[:, None, :4], b[None, :, :4]
    common = np.maximum(np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2]), 0).prod(-1)
    of_a, of_b = (np.maximum(x[..., 2:] - x[..., :2], 0).prod(-1) for x in (a, b))
    return common / np.maximum(of_a + of_b - common, 1e-9), common / np.maximum(of_a, 1e-9)


@dataclass
class Judged:
    """Found boxes of many pictures, judged against true ones."""

    least_iou: float
    vehicles: int = 0
    scores: list[float] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)

    def add(self, found: np.ndarray, true: np.ndarray, ignored: np.ndarray) -> None:
        """Adds a picture: found boxes [n, ≥ 5] with their scores, true ones [m, 4], and ignored ones [k, 4].

        The best boxes choose first. Each takes the true box that it overlaps most. A box without one counts neither way
        if it overlaps an ignored box by `least_iou`, or lies in it by half.
        """
        self.vehicles += len(true)
        taken = np.zeros(len(true), bool)
        for row in found[np.argsort(-found[:, 4], kind="stable")]:
            box = row[None, :4]
            iou = np.where(taken, 0.0, overlaps(box, true)[0][0])
            if len(true) and iou.max() >= self.least_iou:
                taken[iou.argmax()] = True
                self._judge(row[4], True)
                continue
            near, within = overlaps(box, ignored)
            if not (near >= self.least_iou).any() and not (within >= 0.5).any():
                self._judge(row[4], False)

    def _judge(self, score: float, right: bool) -> None:
        self.scores.append(float(score))
        self.right.append(right)

    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the falling scores, with the vehicles found and the precision down to each of them."""
        order = np.argsort(-np.array(self.scores), kind="stable")
        right = np.cumsum(np.array(self.right, float)[order])
        return np.array(self.scores)[order], right, right / np.arange(1, len(right) + 1)

    def average_precision(self) -> float:
        """Returns COCO's average precision, %: the mean of the best precision from each of 101 levels of recall on."""
        _, right, precision = self.curve()
        if not len(right) or not self.vehicles:
            return 0.0
        best = np.maximum.accumulate(precision[::-1])[::-1]
        recalls = np.linspace(0, 1, 101)
        index = np.searchsorted(right / self.vehicles, recalls - 1e-9)
        return 100 * float(np.append(best, 0.0)[np.minimum(index, len(best))].mean())
