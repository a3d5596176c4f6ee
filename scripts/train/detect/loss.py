"""The loss of a batch: the original losses, and a term that holds the original net's answers."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from roadplane_train.detect.assign import Targets
from roadplane_train.detect.boxes import Cells, boxes_from, distances, iou
from roadplane_train.detect.losses import distribution_focal, giou_loss, quality_focal
from roadplane_train.detect.model import BINS

# Weights of the original training.
GIOU_WEIGHT, BINS_WEIGHT = 2.0, 0.25
# Farthest distance that the bins give, cells; at the last bin itself the next one would be missing.
FARTHEST_CELLS = BINS - 1 - 0.1


@dataclass(frozen=True)
class Losses:
    """The parts of the loss, already weighted."""

    score: torch.Tensor
    box: torch.Tensor
    bins: torch.Tensor
    distilled: torch.Tensor

    def total(self) -> torch.Tensor:
        """Returns the sum of all parts."""
        return self.score + self.box + self.bins + self.distilled

    def parts(self) -> dict[str, float]:
        """Returns the parts as numbers, for the log."""
        return {name: float(getattr(self, name).detach()) for name in ("score", "box", "bins", "distilled")}


def losses_of(
    logits: torch.Tensor,
    bins: torch.Tensor,
    cells: Cells,
    targets: Targets,
    original: torch.Tensor | None,
    real: torch.Tensor,
    hold: float,
) -> Losses:
    """Returns the losses of a batch.

    `logits` [B, N, classes] and `bins` [B, N, 4, 11] are those of all cells. `original` holds the score logits of the
    original net on the same pictures. `real` [B] is true for photographs and false for renderings.

    Scores learn the overlap of their own box with the true one, and 0 on background. On photographs every cell without
    a box also learns the original score, with the weight `hold`. There the truth may miss vehicles, and the original
    net has seen people and walls. The truth of renderings is complete, so the net unlearns false boxes on them.
    """
    picture, cell = targets.positive.unbind(1)
    positive = torch.zeros_like(targets.background)
    positive[picture, cell] = True
    sides = bins[picture, cell]
    strides, centres = cells.strides[cell], cells.centres[cell]
    found = boxes_from(centres, strides, distances(sides))
    quality = torch.zeros_like(logits)
    with torch.no_grad():
        quality[picture, cell, targets.classes] = iou(found, targets.boxes)
        weight = logits[picture, cell].sigmoid().amax(1)
    count = max(len(cell), 1)
    judged = (positive | targets.background).unsqueeze(2)
    score = (quality_focal(logits, quality) * judged).sum() / count
    reach = torch.cat([centres - targets.boxes[:, :2], targets.boxes[:, 2:] - centres], 1) / strides.unsqueeze(1)
    # Sure cells count more, as their boxes are the ones that remain.
    total = weight.sum().clamp(min=1e-6)
    box = GIOU_WEIGHT * (giou_loss(found, targets.boxes) * weight).sum() / total
    side = distribution_focal(sides, reach.clamp(0, FARTHEST_CELLS)).mean(1)
    bin_loss = BINS_WEIGHT * (side * weight).sum() / total
    distilled = logits.new_zeros(())
    if original is not None and hold > 0:
        kept = (~positive & real.unsqueeze(1)).unsqueeze(2)
        distilled = hold * (quality_focal(logits[..., : original.shape[2]], original.sigmoid()) * kept).sum() / count
    return Losses(score, box, bin_loss, distilled)
