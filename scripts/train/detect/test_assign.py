"""Tests of cells, boxes and their assignment; they need PyTorch."""

# ruff: noqa: E402

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")

from roadplane_train.detect.assign import BACKGROUND, IGNORED, assign, targets_of
from roadplane_train.detect.boxes import boxes_from, cells_of, detections, iou, without_copies
from roadplane_train.detect.model import BINS, STRIDES

NONE = torch.zeros(0, 4)


def test_cells_come_level_by_level() -> None:
    cells = cells_of(64, 96)
    assert cells.counts == (96, 24, 6) and len(cells.centres) == 126
    assert cells.centres[13].tolist() == [12.0, 12.0] and cells.centres[-1].tolist() == [80.0, 48.0]
    assert cells.strides[-1] == 32


def test_a_cell_becomes_its_box() -> None:
    """The same cell as in `crates/detect/src/decode.rs`."""
    levels = [(torch.full((1, 3, 64 // s, 64 // s), -9.0), torch.zeros(1, 4 * BINS, 64 // s, 64 // s)) for s in STRIDES]
    logits, bins = levels[0]
    logits[0, 1, 2, 3] = 2.0
    for side in range(4):
        bins[0, side * BINS + side + 1, 2, 3] = 50.0
    ((row,),) = (found.tolist() for found in detections(levels))
    x, y = 3.5 * 8, 2.5 * 8
    assert row[:4] == pytest.approx([x - 8, y - 16, x + 24, y + 32], abs=1e-4)
    assert row[4] == pytest.approx(0.8808, abs=1e-4) and row[5] == 1


def test_copies_go_and_neighbours_stay() -> None:
    rows = torch.tensor([[0.0, 0, 10, 10, 0.9], [1, 0, 11, 10, 0.8], [6, 0, 16, 10, 0.7]])
    assert without_copies(rows, 0.6)[:, 4].tolist() == pytest.approx([0.9, 0.7])
    assert float(iou(rows[0, :4], rows[1, :4])) == pytest.approx(9 / 11)


@pytest.mark.parametrize(("side", "stride"), [(30, 8), (80, 16), (180, 32)])
def test_boxes_are_learnt_where_squares_fit_them(side: float, stride: int) -> None:
    cells = cells_of(416, 416)
    box = torch.tensor([[150.0, 140, 150 + 1.2 * side, 140 + side]])
    chosen = assign(cells, box, NONE)
    positive = chosen == 0
    strides = cells.strides[positive]
    assert 1 <= len(strides) <= 12
    assert float((strides == stride).float().mean()) > 0.7
    centres = cells.centres[positive]
    assert bool(((centres > box[0, :2]) & (centres < box[0, 2:])).all())


def test_the_choice_is_that_of_the_paper() -> None:
    """Checks mean + sd over the nine nearest cells of each level, for one box, by a plain loop."""
    cells, box = cells_of(256, 256), torch.tensor([[60.0, 70, 150, 130]])
    candidates = []
    start = 0
    for count in cells.counts:
        far = (cells.centres[start : start + count] - torch.tensor([105.0, 100.0])).norm(dim=1)
        candidates += (far.argsort()[:9] + start).tolist()
        start += count
    overlaps = []
    for cell in candidates:
        half = 2.5 * float(cells.strides[cell])
        x, y = cells.centres[cell].tolist()
        overlaps.append(float(iou(torch.tensor([x - half, y - half, x + half, y + half]), box[0])))
    mean = sum(overlaps) / len(overlaps)
    sd = (sum((v - mean) ** 2 for v in overlaps) / (len(overlaps) - 1)) ** 0.5
    expected = {
        cell
        for cell, value in zip(candidates, overlaps, strict=True)
        if value >= mean + sd and 60 < cells.centres[cell][0] < 150 and 70 < cells.centres[cell][1] < 130
    }
    assert set((assign(cells, box, NONE) == 0).nonzero().flatten().tolist()) == expected


def test_each_of_two_close_boxes_has_cells() -> None:
    cells = cells_of(416, 416)
    boxes = torch.tensor([[100.0, 100, 180, 160], [150.0, 104, 230, 164]])
    chosen = assign(cells, boxes, NONE)
    assert {0, 1} <= set(chosen.tolist())
    cell = cells.centres[chosen == 1]
    assert bool((cell[:, 0] > 150).all())


def test_ignored_cells_belong_to_no_box() -> None:
    cells = cells_of(256, 256)
    boxes, ignored = torch.tensor([[40.0, 40, 120, 100]]), torch.tensor([[30.0, 30, 130, 110], [180, 180, 250, 250]])
    chosen = assign(cells, boxes, ignored)
    assert bool((chosen == 0).any())
    covered = ((cells.centres > 180) & (cells.centres < 250)).all(1)
    assert bool((chosen[covered] == IGNORED).all())
    assert bool((assign(cells, NONE, NONE) == BACKGROUND).all())


def test_targets_name_the_right_boxes() -> None:
    cells = cells_of(128, 128)
    boxes = [torch.tensor([[10.0, 10, 50, 40], [70, 60, 120, 110]]), NONE, torch.tensor([[40.0, 40, 100, 90]])]
    classes = [torch.tensor([0, 2]), torch.zeros(0, dtype=torch.long), torch.tensor([1])]
    targets = targets_of(cells, boxes, classes, [NONE] * 3)
    seen = {(int(p), int(c), tuple(b)) for (p, _), c, b in zip(targets.positive, targets.classes, targets.boxes.tolist())}
    assert seen == {(0, 0, (10, 10, 50, 40)), (0, 2, (70, 60, 120, 110)), (2, 1, (40, 40, 100, 90))}
    assert bool(targets.background[1].all()) and not bool(targets.ignored.any())
    found = boxes_from(cells.centres, cells.strides, torch.ones(len(cells.centres), 4))
    assert found[0].tolist() == [-4, -4, 12, 12]
