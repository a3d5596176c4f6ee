"""Draws the batches of the training."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch.utils.data import Dataset

from roadplane_train.detect.assign import Targets, targets_of
from roadplane_train.detect.augment import degrade, letterbox, random_view
from roadplane_train.detect.boxes import cells_of
from roadplane_train.detect.model import INPUT_PX
from roadplane_train.detect.pictures import IGNORED, Picture


@dataclass(frozen=True)
class Images:
    """Inputs of the net."""

    image: torch.Tensor  # u8 [B, 3, n, n] RGB, channels last in memory
    real: torch.Tensor  # [B] photographs, not renderings

    def input(self, device: torch.device) -> torch.Tensor:
        """Returns the net's input on a device, 0…1."""
        image = self.image.to(device, non_blocking=True).float().div(255)
        return image.contiguous(memory_format=torch.channels_last)


@dataclass(frozen=True)
class Batch(Images):
    """Inputs of the net with their vehicles."""

    boxes: list[torch.Tensor]  # [n, 4] each
    classes: list[torch.Tensor]
    ignored: list[torch.Tensor]  # boxes [m, 4]


@dataclass(frozen=True)
class Lesson(Images):
    """Inputs of the net with the targets of its cells; few tensors, as processes exchange lessons."""

    targets: Targets


def batch_of(samples: list[tuple[np.ndarray, np.ndarray, np.ndarray, bool]]) -> Batch:
    """Joins pixels, boxes, classes and whether the picture is real."""
    images, boxes, classes, real = zip(*samples, strict=True)
    kept = [c != IGNORED for c in classes]
    return Batch(
        torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2),
        torch.tensor(real),
        [torch.from_numpy(b[k]) for b, k in zip(boxes, kept, strict=True)],
        [torch.from_numpy(c[k]) for c, k in zip(classes, kept, strict=True)],
        [torch.from_numpy(b[~k]) for b, k in zip(boxes, kept, strict=True)],
    )


class Sampler(Dataset[Lesson]):
    """Draws lessons from kinds of pictures, each kind with its share.

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
        self.cells = cells_of(input_px, input_px)

    def __getitem__(self, step: int) -> Lesson:
        """Returns the lesson of a step."""
        batch = batch_of([self._sample(np.random.default_rng([self.seed, step, k])) for k in range(self.batch)])
        return Lesson(batch.image, batch.real, targets_of(self.cells, batch.boxes, batch.classes, batch.ignored))

    def _sample(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        pictures = self.kinds[rng.choice(len(self.kinds), p=self.shares)]
        picture = pictures[rng.integers(len(pictures))]
        view = random_view(rng, picture, self.input_px)
        boxes, classes = view.boxes(picture)
        return degrade(rng, view.pixels(picture.read())), boxes, classes, picture.real


def whole_pictures(pictures: list[Picture], input_px: int = INPUT_PX) -> list[Batch]:
    """Returns each picture unchanged, as a batch of one."""
    batches = []
    for picture in pictures:
        view = letterbox(picture.size_px, input_px)
        batches.append(batch_of([(view.pixels(picture.read()), *view.boxes(picture), picture.real)]))
    return batches
