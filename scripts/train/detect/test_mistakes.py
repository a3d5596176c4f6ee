"""Tests of the search for false boxes; they need PyTorch."""

# ruff: noqa: E402

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.augment import random_view
from roadplane_train.detect.metrics import overlaps
from roadplane_train.detect.mistakes import mistakes_of
from roadplane_train.detect.onnx_file import read_net
from roadplane_train.detect.outlines import bounds
from roadplane_train.detect.pictures import Picture, key_of, rendered_pictures, with_mistakes

LOTS = REPOSITORY / "tests/data/lots/scenes"


@pytest.fixture(scope="module")
def lot() -> Picture:
    """Returns a rendering of the repository with clear cars."""
    return next(p for p in rendered_pictures(LOTS) if p.path.name == "still_0000.jpg")


def test_a_car_without_truth_is_a_mistake_and_one_with_truth_is_none(lot: Picture) -> None:
    net = read_net()
    vehicles = np.array([bounds(outline) for outline in lot.outlines])

    def known(boxes: np.ndarray) -> int:
        return int((overlaps(boxes, vehicles)[0] >= 0.5).any(1).sum())

    assert known(mistakes_of(net, replace(lot, outlines=(), classes=()))) >= 3
    assert known(mistakes_of(net, lot)) == 0


def test_views_look_at_the_mistakes_of_a_list(lot: Picture, tmp_path: Path) -> None:
    file = tmp_path / "mistakes.json"
    assert with_mistakes([lot], file) == [lot], "the list may be missing"
    file.write_text(json.dumps({key_of(lot): [[100.0, 80.0, 140.0, 110.0]]}))
    (listed,) = with_mistakes([lot], file)
    assert [m.tolist() for m in listed.mistakes] == [[100.0, 80.0, 140.0, 110.0]]
    shown = {}
    for picture in (lot, listed):
        views = [random_view(np.random.default_rng(k), picture) for k in range(300)]
        inside = [np.abs(v.matrix() @ [120.0, 95.0, 1.0] - 208).max() < 208 for v in views]
        shown[picture is listed] = float(np.mean(inside))
    assert shown[True] > shown[False] + 0.15
