"""Tests of the figures and of the product's models; they need PyTorch."""

# ruff: noqa: E402

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")

from roadplane_train.detect.metrics import Judged, overlaps
from roadplane_train.detect.model import CLASSES, with_classes
from roadplane_train.detect.onnx_file import read_net, write_net
from roadplane_train.detect.product import MODELS, write_models

NONE = np.zeros((0, 4))


def box(x: float, score: float | None = None, width: float = 40) -> list[float]:
    """Returns a box of 40 px, with a score or without."""
    return [x, 0, x + width, 40, *([] if score is None else [score])]


def test_overlaps_are_those_of_areas() -> None:
    iou, within = overlaps(np.array([[0.0, 0, 10, 10]]), np.array([[5.0, 0, 15, 10], [0, 0, 20, 20], [30, 30, 40, 40]]))
    assert iou[0].tolist() == pytest.approx([1 / 3, 1 / 4, 0])
    assert within[0].tolist() == pytest.approx([0.5, 1, 0])


def test_average_precision_of_a_curve_with_one_false_box() -> None:
    """Right, false, right, of four vehicles: precision 1 up to recall 1/4, 2/3 up to 1/2, then 0."""
    judged = Judged(0.5)
    judged.add(np.array([box(0, 0.9), box(500, 0.8), box(100, 0.7)]), np.array([box(x) for x in (0, 100, 200, 300)]), NONE)
    expected = (26 * 1 + 25 * 2 / 3) / 101
    assert judged.average_precision() == pytest.approx(100 * expected)


def test_each_vehicle_is_found_once_and_by_the_best_box() -> None:
    judged = Judged(0.5)
    judged.add(np.array([box(4, 0.6), box(0, 0.9), box(38, 0.5)]), np.array([box(0), box(40)]), NONE)
    assert sorted(zip(judged.scores, judged.right, strict=True)) == [(0.5, True), (0.6, False), (0.9, True)]


def test_ignored_boxes_change_no_figure() -> None:
    judged = Judged(0.5)
    judged.add(np.array([box(0, 0.9), box(210, 0.8), box(400, 0.7)]), np.array([box(0)]), np.array([box(200, width=200)]))
    assert judged.scores == [0.9, 0.7] and judged.right == [True, False]


def test_nothing_found_and_nothing_there() -> None:
    assert Judged(0.5).average_precision() == 0


def test_the_product_gets_the_net_and_its_card(tmp_path: Path) -> None:
    write_net(with_classes(read_net(), len(CLASSES)), tmp_path / "net.onnx", half=True)
    (tmp_path / "models").mkdir()
    write_models(tmp_path / "net.onnx", tmp_path / "models")
    written = tmp_path / "models/detector.onnx"
    card = json.loads((tmp_path / "models/detector.card.json").read_text())
    assert card["sha256"] == hashlib.sha256(written.read_bytes()).hexdigest() and "variants" not in card
    assert card["classes"] == list(CLASSES)
    assert [output["shape"][1] for output in card["outputs"]] == [len(CLASSES), 44] * 3
    assert {path.name for path in (tmp_path / "models").iterdir()} >= {path.name for path in MODELS.iterdir()} - {
        "detector.int8.onnx"
    }
