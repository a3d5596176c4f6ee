"""Five kinds of lorries and their sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .fittings import LIGHT_WHEEL_M, WHEEL_M
from .solids import Span


@dataclass(frozen=True)
class Kind:
    """Ranges of sizes, m: common lorries of Europe, ESTIMATES."""

    share: float
    length: Span
    width: Span
    height: Span
    cab: Span  # length
    cab_height: Span
    wheel: float


KINDS = {
    "light": Kind(0.25, (5.8, 7.2), (2.1, 2.3), (2.7, 3.2), (1.9, 2.2), (2.2, 2.45), LIGHT_WHEEL_M),
    "box": Kind(0.25, (7.6, 10.2), (2.45, 2.55), (3.2, 3.8), (1.7, 2.1), (2.6, 3.0), WHEEL_M),
    "curtain": Kind(0.15, (8.5, 11.0), (2.5, 2.55), (3.6, 4.0), (2.1, 2.3), (2.9, 3.5), WHEEL_M),
    "tipper": Kind(0.15, (7.2, 8.8), (2.5, 2.55), (2.9, 3.3), (1.7, 1.9), (2.8, 3.0), WHEEL_M),
    "articulated": Kind(0.2, (13.5, 15.5), (2.5, 2.55), (3.8, 4.0), (2.0, 2.3), (3.3, 3.8), WHEEL_M),
}
FLOOR_M = 1.05  # height of the load over wheels of WHEEL_M; in proportion over smaller wheels


class Lorry:
    """The sizes of a lorry of a kind; `rng` chooses them, and the trim. The origin is at half its length."""

    def __init__(self, rng: np.random.Generator, kind: str) -> None:
        self.rng, self.kind, sizes = rng, kind, KINDS[kind]
        self.length, self.width, self.height = (rng.uniform(*r) for r in (sizes.length, sizes.width, sizes.height))
        self.cab_length, self.wheel = rng.uniform(*sizes.cab), sizes.wheel
        self.cab_height = min(rng.uniform(*sizes.cab_height), self.height)
        self.front, self.rear, self.half = self.length / 2, -self.length / 2, self.width / 2
        self.floor = FLOOR_M * self.wheel / WHEEL_M
        self.cab_half = min(self.half, 1.25) - rng.uniform(0.0, 0.06)
        self.load_front = self.front - self.cab_length - rng.uniform(0.08, 0.2)
        self.first_axle = self.front - (1.0 if kind == "light" else rng.uniform(1.3, 1.42))
