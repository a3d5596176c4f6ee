"""Draws the batches of the training."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch

from roadplane_train.detect.augment import degrade, letterbox, random_view
from roadplane_train.detect.model import INPUT_PX
from roadplane_train.detect.pictures import IGNORED, Picture


@dataclass(frozen=True)
class Batch:
    """Inputs of the net with their vehicles."""

    image: torch.Tensor  # u8 [B, 3, n, n] RGB, channels last in memory
    boxes: list[torch.Tensor]  # [n, 4] each
    classes: list[torch.Tensor]
    ignored: list[torch.Tensor]  # boxes [m, 4]
    real: torch.Tensor  # [B]

    def input(self) -> torch.Tensor:
        """Returns the net's input, 0…1."""
        return self.image.float().div(255)


def batch_of(samples: list[tuple[np.ndarray, np.ndarray, np.ndarray, bool]]) -> Batch:
    """Joins pixels, boxes, classes and whether the picture is real."""
    images, boxes, classes, real = zip(*samples, strict=True)
    kept = [c != IGNORED for c in classes]
    return Batch(
        torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2),
        [torch.from_numpy(b[k]) for b, k in zip(boxes, kept, strict=True)],
        [torch.from_numpy(c[k]) for c, k in zip(classes, kept, strict=True)],
        [torch.from_numpy(b[~k]) for b, k in zip(boxes, kept, strict=True)],
        torch.tensor(real),
    )


class Sampler:
    """Draws batches from kinds of pictures, each kind with its share.

    A sample depends on the seed, the step and its number alone. So a resumed training sees the same samples.
    """

    def __init__(self, kinds: list[list[Picture]], shares: list[float], batch: int, seed: int, input_px: int = INPUT_PX) -> None:
        present = [(pictures, share) for pictures, share in zip(kinds, shares, strict=True) if pictures and share > 0]
        if not present:
            raise ValueError("there are no pictures to learn from")
        self.kinds = [pictures for pictures, _ in present]
        total = sum(share for _, share in present)
        self.shares = [share / total for _, share in present]
        self.batch, self.seed, self.input_px = batch, seed, input_px

    def at(self, step: int) -> Batch:
        """Returns the batch of a step."""
        return batch_of([self._sample(np.random.default_rng([self.seed, step, k])) for k in range(self.batch)])

    def _sample(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        pictures = self.kinds[rng.choice(len(self.kinds), p=self.shares)]
        picture = pictures[rng.integers(len(pictures))]
        view = random_view(rng, picture, self.input_px)
        boxes, classes = view.boxes(picture)
        return degrade(rng, view.pixels(picture.read())), boxes, classes, picture.real


class Prefetch:
    """Prepares the next batch while the net learns from the current one, on one more thread."""

    def __init__(self, sampler: Sampler, step: int) -> None:
        self.sampler, self.step = sampler, step
        self.pool = ThreadPoolExecutor(1)
        self.future = self.pool.submit(sampler.at, step)

    def next(self) -> Batch:
        """Returns the next batch."""
        batch = self.future.result()
        self.step += 1
        self.future = self.pool.submit(self.sampler.at, self.step)
        return batch


def whole_pictures(pictures: list[Picture], input_px: int = INPUT_PX) -> list[Batch]:
    """Returns each picture unchanged, as a batch of one."""
    batches = []
    for picture in pictures:
        view = letterbox(picture.size_px, input_px)
        batches.append(batch_of([(view.pixels(picture.read()), *view.boxes(picture), picture.real)]))
    return batches
