"""Cells of the net and boxes: decoding, overlaps, and the removal of copies.

A box is left, top, right, bottom in px from the picture's corner. The centre of the cell (i, j) lies at
((j + 0.5) s, (i + 0.5) s), where s is the stride of its level.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from roadplane_train.detect.model import BINS, STRIDES, Level


@dataclass(frozen=True)
class Cells:
    """All cells of a picture, finest level first, row by row."""

    centres: torch.Tensor  # [N, 2] x and y, px
    strides: torch.Tensor  # [N] px
    counts: tuple[int, ...]  # cells of each level

    def to(self, device: torch.device) -> Cells:
        """Returns the cells on a device."""
        return Cells(self.centres.to(device), self.strides.to(device), self.counts)


def cells_of(height: int, width: int) -> Cells:
    """Returns the cells of a picture of this size, px."""
    centres, strides, counts = [], [], []
    for stride in STRIDES:
        y = (torch.arange(height // stride) + 0.5) * stride
        x = (torch.arange(width // stride) + 0.5) * stride
        rows, columns = torch.meshgrid(y, x, indexing="ij")
        centres.append(torch.stack([columns, rows], -1).view(-1, 2))
        counts.append(len(centres[-1]))
        strides.append(torch.full((counts[-1],), float(stride)))
    return Cells(torch.cat(centres), torch.cat(strides), tuple(counts))


def flat(levels: list[Level]) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns score logits [B, N, classes] and bin logits [B, N, 4, 11] of all cells."""
    scores, bins = (torch.cat([part.flatten(2) for part in parts], 2).transpose(1, 2) for parts in zip(*levels, strict=True))
    return scores, bins.reshape(*bins.shape[:2], 4, BINS)


def distances(bins: torch.Tensor) -> torch.Tensor:
    """Returns the mean of each side's distribution [..., 4], in cells."""
    return bins.softmax(-1) @ torch.arange(BINS, dtype=bins.dtype, device=bins.device)


def boxes_from(centres: torch.Tensor, strides: torch.Tensor, sides: torch.Tensor) -> torch.Tensor:
    """Returns the boxes [..., 4] around cell centres, from distances in cells to left, top, right and bottom."""
    px = sides * strides.unsqueeze(-1)
    return torch.cat([centres - px[..., :2], centres + px[..., 2:]], -1)


def area(boxes: torch.Tensor) -> torch.Tensor:
    """Returns the areas of boxes [..., 4], px²; empty ones have 0."""
    return (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(-1)


def overlap(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Returns the common areas of boxes that broadcast, px²."""
    low = torch.maximum(a[..., :2], b[..., :2])
    high = torch.minimum(a[..., 2:], b[..., 2:])
    return (high - low).clamp(min=0).prod(-1)


def iou(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Returns intersection over union of boxes that broadcast, 0 for empty ones."""
    common = overlap(a, b)
    return common / (area(a) + area(b) - common).clamp(min=1e-9)


def detections(levels: list[Level], least: float = 0.05, same: float = 0.6) -> list[torch.Tensor]:
    """Returns the boxes of each picture [n, 6]: left, top, right, bottom, score, class; best first.

    Of boxes that overlap by more than `same` only the best remains. The product merges in another way.
    """
    height, width = (length * STRIDES[0] for length in levels[0][0].shape[2:])
    cells = cells_of(height, width)
    logits, bins = flat(levels)
    found = []
    for scores, sides in zip(logits.sigmoid(), bins, strict=True):
        best, kind = scores.max(1)
        keep = best >= least
        boxes = boxes_from(cells.centres[keep], cells.strides[keep], distances(sides[keep]))
        rows = torch.cat([boxes, best[keep, None], kind[keep, None].float()], 1)
        found.append(without_copies(rows[rows[:, 4].argsort(descending=True)], same))
    return found


def without_copies(rows: torch.Tensor, same: float) -> torch.Tensor:
    """Keeps rows [n, ≥ 4], best first, that overlap no better one by more than `same`."""
    overlaps = iou(rows[:, None, :4], rows[None, :, :4]) > same
    kept: list[int] = []
    for i in range(len(rows)):
        if not overlaps[i, kept].any():
            kept.append(i)
    return rows[kept]
