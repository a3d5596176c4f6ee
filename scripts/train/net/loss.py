"""The loss of the hourglass."""

from __future__ import annotations

import torch
from torch import nn

from roadplane_train.batches import fast
from roadplane_train.net.data import Batch
from roadplane_train.net.decode import WINDOW_CELLS
from roadplane_train.net.model import STRIDE

TARGET_SD_CELLS = 0.6
DISTANCE_WEIGHT = 1.0  # weight of a pixel against a nat
SMOOTH_PX = 0.1


def targets(points: torch.Tensor, cells: int) -> torch.Tensor:
    """Returns a narrow Gaussian over the cells [B, K, n²], sum 1, around locations [B, K, 2] in input px."""
    cell = (points - (STRIDE - 1) / 2) / STRIDE
    grid = torch.arange(cells, dtype=torch.float32, device=points.device)
    x = -((grid - cell[..., :1]) ** 2) / (2 * TARGET_SD_CELLS**2)
    y = -((grid - cell[..., 1:]) ** 2) / (2 * TARGET_SD_CELLS**2)
    return (y.softmax(-1).unsqueeze(-1) * x.softmax(-1).unsqueeze(-2)).flatten(2)


def peak_distance(logits: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """Returns the distance of the decoded peaks [B, K] of logits [B, K, n, n] from locations [B, K, 2], input px.

    It is zero, without a gradient, if the peak is another one: the mean over its window would not move there.
    """
    cells = logits.shape[-1]
    peak = logits.flatten(2).argmax(2)
    row, column = torch.div(peak, cells, rounding_mode="floor"), peak % cells
    grid = torch.arange(cells, device=logits.device)
    in_rows = (grid - row.unsqueeze(-1)).abs() <= WINDOW_CELLS
    in_columns = (grid - column.unsqueeze(-1)).abs() <= WINDOW_CELLS
    window = in_rows.unsqueeze(-1) & in_columns.unsqueeze(-2)
    p = logits.masked_fill(~window, -1e9).flatten(2).softmax(2).view_as(logits)
    cell = torch.stack([(p.sum(2) * grid).sum(-1), (p.sum(3) * grid).sum(-1)], -1)
    off = cell * STRIDE + (STRIDE - 1) / 2 - points
    near = off.detach().abs().amax(-1) < (WINDOW_CELLS + 0.5) * STRIDE
    return ((off * near.unsqueeze(-1)).square().sum(-1) + SMOOTH_PX**2).sqrt() * near


def loss_of(net: nn.Module, batch: Batch) -> tuple[torch.Tensor, dict[str, float]]:
    """Returns the losses of each stack's heatmaps, of the last one's peaks, and of the visibility."""
    image = batch.image.permute(0, 3, 1, 2).float().div(255)
    with fast(image.device):
        heatmaps, visibility = net(image.contiguous(memory_format=torch.channels_last))
    visibility = visibility.float()
    located, points = batch.located, batch.points
    target = targets(points, image.shape[-1] // STRIDE)
    count = located.sum().clamp(min=1)
    parts = []
    for logits in heatmaps:
        entropy = -(target * logits.flatten(2).log_softmax(2)).sum(2)
        parts.append((entropy * located).sum() / count)
    off = (peak_distance(heatmaps[-1], points) * located).sum() / count
    judged = batch.judged
    seen = nn.functional.binary_cross_entropy_with_logits(visibility, batch.visible, reduction="none")
    visible = (seen * judged).sum() / judged.sum().clamp(min=1)
    loss = sum(parts[:-1], start=torch.zeros_like(off)) * 0.5 + parts[-1] + DISTANCE_WEIGHT * off + visible
    return loss, {"heat": float(parts[-1]), "off": float(off), "visible": float(visible)}
