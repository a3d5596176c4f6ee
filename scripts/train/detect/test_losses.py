"""Tests of the losses against closed forms; they need PyTorch."""

# ruff: noqa: E402

from __future__ import annotations

import math

import pytest

torch = pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")

from roadplane_train.detect.assign import targets_of
from roadplane_train.detect.boxes import boxes_from, cells_of, distances, iou
from roadplane_train.detect.loss import Losses, losses_of
from roadplane_train.detect.losses import distribution_focal, giou_loss, quality_focal
from roadplane_train.detect.model import BINS


@pytest.mark.parametrize(("logit", "quality"), [(0.3, 0.8), (-2.0, 0.0), (1.5, 1.0)])
def test_quality_focal_is_its_formula(logit: float, quality: float) -> None:
    sigma = 1 / (1 + math.exp(-logit))
    entropy = -quality * math.log(sigma) - (1 - quality) * math.log(1 - sigma)
    found = quality_focal(torch.tensor([logit]), torch.tensor([quality]))
    assert float(found) == pytest.approx((quality - sigma) ** 2 * entropy, rel=1e-5)


def test_quality_focal_is_least_at_the_quality() -> None:
    logits = torch.linspace(-4, 4, 401)
    best = logits[quality_focal(logits, torch.full_like(logits, 0.7)).argmin()].sigmoid()
    assert float(best) == pytest.approx(0.7, abs=0.01)


def test_distribution_focal_is_its_formula() -> None:
    bins = torch.tensor([0.5, -1.0, 2.0, 0.0])
    log_p = [value - math.log(sum(math.exp(b) for b in bins.tolist())) for value in bins.tolist()]
    found = distribution_focal(bins, torch.tensor(1.3))
    assert float(found) == pytest.approx(-0.7 * log_p[1] - 0.3 * log_p[2], rel=1e-5)
    last = distribution_focal(bins, torch.tensor(3.0))
    assert float(last) == pytest.approx(-log_p[3], rel=1e-5)


def test_distribution_focal_leads_to_the_distance() -> None:
    bins = torch.zeros(1, BINS, requires_grad=True)
    optimiser = torch.optim.Adam([bins], lr=0.3)
    for _ in range(300):
        optimiser.zero_grad()
        distribution_focal(bins, torch.tensor([6.4])).sum().backward()
        optimiser.step()
    assert float(distances(bins)) == pytest.approx(6.4, abs=0.05)


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ([0.0, 0, 2, 2], 0.0),  # the same
        ([1.0, 0, 3, 2], 1 - 1 / 3),  # half beside it: the hull is the union
        ([4.0, 0, 6, 2], 1 + 1 / 3),  # apart: hull 12, union 8
        ([1.0, 1, 3, 3], 1 - 1 / 7 + 2 / 9),  # hull 9, union 7
    ],
)
def test_giou_of_boxes_in_a_plane(found: list[float], expected: float) -> None:
    loss = giou_loss(torch.tensor(found), torch.tensor([0.0, 0, 2, 2]))
    assert float(loss) == pytest.approx(expected, abs=1e-6)


def test_giou_draws_boxes_together_that_do_not_touch() -> None:
    box = torch.tensor([4.0, 0, 6, 2], requires_grad=True)
    giou_loss(box, torch.tensor([0.0, 0, 2, 2])).backward()
    assert float(box.grad[0]) > 0


def perfect(original_score: float | None = None, real: bool = False) -> tuple[Losses, torch.Tensor]:
    """Returns the losses of a net that is right about one box, and the gradient of its logits."""
    cells = cells_of(128, 128)
    true = torch.tensor([[20.0, 30, 76, 70]])
    targets = targets_of(cells, [true], [torch.tensor([1])], [torch.tensor([[90.0, 90, 120, 120]])])
    cell = targets.positive[:, 1]
    reach = torch.cat([cells.centres - true[:, :2], true[:, 2:] - cells.centres], 1) / cells.strides[:, None]
    grid = torch.arange(BINS)
    bins = -30 * (grid - reach.clamp(0, 9.9).unsqueeze(-1)).abs().clamp(max=1.5)
    near = (1 - (grid - reach.clamp(0, 9.9).unsqueeze(-1)).abs()).clamp(min=0)
    bins = torch.where(near > 0, near.clamp(min=1e-12).log(), bins)[None]
    logits = torch.full((1, len(cells.centres), 3), -12.0)
    logits[0, cell, 1] = 12.0
    logits.requires_grad_()
    original = (
        None if original_score is None else torch.full_like(logits, math.log(original_score / (1 - original_score))).detach()
    )
    losses = losses_of(logits, bins, cells, targets, original, torch.tensor([real]), 1.0)
    losses.total().backward()
    found = boxes_from(cells.centres[cell], cells.strides[cell], distances(bins[0, cell]))
    assert float(iou(found, true).min()) > 0.99
    return losses, logits.grad[0]


def test_a_right_answer_costs_nothing_but_the_entropy_of_its_bins() -> None:
    losses, _ = perfect()
    assert float(losses.score) < 1e-3 and float(losses.box) < 1e-3 and float(losses.distilled) == 0
    assert 0 < float(losses.bins) < 0.25 * math.log(2) + 1e-3


def test_only_photographs_hold_the_original_answers() -> None:
    assert float(perfect(0.3, real=False)[0].distilled) == 0
    losses, gradient = perfect(0.3, real=True)
    assert float(losses.distilled) > 0
    cells = cells_of(128, 128)
    ignored = ((cells.centres > 90) & (cells.centres < 120)).all(1)
    assert bool((gradient[ignored] < 0).all()), "ignored cells rise to the original score"
    assert float(perfect(real=True)[1][ignored].abs().max()) == 0, "without the original nothing moves there"
