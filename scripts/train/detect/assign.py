"""Chooses the cells that learn each box: ATSS, as in the training of the original net.

S. Zhang et al., "Bridging the Gap Between Anchor-based and Anchor-free Detection", CVPR 2020. The net knows boxes from
just these cells already, so a short training need not move them. Dynamic assignment depends on the net's answers. It
would give other cells to cars that today's net misses, and other targets after each resumption.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch

from roadplane_train.detect.boxes import Cells, iou

NEAREST = 9  # cells per level that come into question
ANCHOR_STRIDES = 5  # side of the square around a cell that is compared with boxes
BACKGROUND, IGNORED = -1, -2


def assign(cells: Cells, boxes: torch.Tensor, ignored: torch.Tensor) -> torch.Tensor:
    """Returns for each cell the number of its box, `BACKGROUND`, or `IGNORED`.

    Candidates of a box are the nearest cells of each level. Those inside the box whose squares overlap it by at least
    mean + sd of the candidates' overlaps learn it. A cell of several boxes learns the one that it overlaps most. Other
    cells inside ignored boxes [m, 4] are left out of the loss.
    """
    found = torch.full((len(cells.centres),), BACKGROUND)
    if len(ignored):
        found[inside(cells.centres, ignored).any(1)] = IGNORED
    if not len(boxes):
        return found
    half = cells.strides[:, None] * ANCHOR_STRIDES / 2
    squares = torch.cat([cells.centres - half, cells.centres + half], 1)
    overlaps = iou(squares[:, None], boxes[None])  # [N, n]
    middles = (boxes[:, :2] + boxes[:, 2:]) / 2
    far = torch.cdist(cells.centres, middles)
    candidates, start = [], 0
    for count in cells.counts:
        nearest = far[start : start + count].topk(min(NEAREST, count), 0, largest=False).indices
        candidates.append(nearest + start)
        start += count
    chosen = torch.cat(candidates)  # [k, n]
    theirs = overlaps.gather(0, chosen)
    enough = theirs >= theirs.mean(0) + theirs.std(0)
    within = inside(cells.centres, boxes).gather(0, chosen)
    marked = torch.zeros_like(overlaps).scatter_(0, chosen, (enough & within).float() * (theirs + 1))
    best, number = marked.max(1)
    found[best > 0] = number[best > 0]
    return found


def inside(points: torch.Tensor, boxes: torch.Tensor) -> torch.Tensor:
    """Returns whether each point [N, 2] lies inside each box [n, 4], [N, n]."""
    points = points[:, None]
    return ((points > boxes[None, :, :2]) & (points < boxes[None, :, 2:])).all(-1)


@dataclass(frozen=True)
class Targets:
    """The targets of the cells of a batch."""

    positive: torch.Tensor  # [P, 2] picture and cell
    boxes: torch.Tensor  # [P, 4] px
    classes: torch.Tensor  # [P]
    background: torch.Tensor  # [B, N] cells that show no vehicle
    ignored: torch.Tensor  # [B, N] cells that nothing is known of

    def to(self, device: torch.device) -> Targets:
        """Returns the targets on a device."""
        return Targets(*(getattr(self, field.name).to(device, non_blocking=True) for field in fields(self)))


def targets_of(cells: Cells, boxes: list[torch.Tensor], classes: list[torch.Tensor], ignored: list[torch.Tensor]) -> Targets:
    """Returns the targets of a batch from each picture's boxes [n, 4], classes [n] and ignored boxes [m, 4]."""
    numbers = torch.stack([assign(cells, b, i) for b, i in zip(boxes, ignored, strict=True)])
    positive = (numbers >= 0).nonzero()
    picture, cell = positive.unbind(1)
    first = torch.tensor([0, *(len(b) for b in boxes)]).cumsum(0)[picture]
    which = first + numbers[picture, cell]
    return Targets(positive, torch.cat(boxes)[which], torch.cat(classes)[which], numbers == BACKGROUND, numbers == IGNORED)
