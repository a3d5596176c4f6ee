"""The losses of the original NanoDet.

Quality focal loss and distribution focal loss: X. Li et al., "Generalized Focal Loss", NeurIPS 2020, equations 3 and 6.
GIoU: H. Rezatofighi et al., "Generalized Intersection over Union", CVPR 2019.
"""

from __future__ import annotations

import torch
from torch import nn

from roadplane_train.detect.boxes import area, overlap


def quality_focal(logits: torch.Tensor, quality: torch.Tensor, power: float = 2.0) -> torch.Tensor:
    """Returns |y − σ|^power · cross-entropy(σ, y) of each logit, with σ the score and y its target in 0…1."""
    entropy = nn.functional.binary_cross_entropy_with_logits(logits, quality, reduction="none")
    return (quality - logits.sigmoid()).abs().pow(power) * entropy


def distribution_focal(bins: torch.Tensor, distance: torch.Tensor) -> torch.Tensor:
    """Returns the cross-entropy of bin logits [..., n] against the two bins beside a distance [...] in 0…n − 1.

    The nearer bin counts more, so that the best distribution has the distance as its mean.
    """
    low = distance.floor().clamp(0, bins.shape[-1] - 2)
    share = (distance - low).clamp(0, 1)
    log_p = bins.log_softmax(-1)
    index = low.long().unsqueeze(-1)
    below, above = (log_p.gather(-1, index + k).squeeze(-1) for k in (0, 1))
    return -(1 - share) * below - share * above


def giou_loss(found: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Returns 1 − GIoU of boxes [..., 4], 0…2: 1 − IoU + (hull − union) / hull."""
    common = overlap(found, true)
    union = (area(found) + area(true) - common).clamp(min=1e-6)
    low, high = torch.minimum(found[..., :2], true[..., :2]), torch.maximum(found[..., 2:], true[..., 2:])
    hull = (high - low).clamp(min=0).prod(-1).clamp(min=1e-6)
    return 1 - common / union + (hull - union) / hull
