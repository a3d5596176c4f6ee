"""Tests of the logistic fits."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from . import existence, logistic, same_vehicle


def drawn(count: int, weights: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns random features and classes that follow a logistic model."""
    random = np.random.default_rng(seed)
    features = np.column_stack([np.ones(count), random.normal(size=(count, len(weights) - 1))])
    return features, (random.uniform(size=count) < logistic.probability(weights, features)).astype(float)


def test_the_fit_finds_the_model_that_made_the_data() -> None:
    """With much data, the weights are those of the model, and predictions are calibrated."""
    weights = np.array([0.5, 2.0, -1.0, 0.0])
    features, vehicles = drawn(20_000, weights, 1)
    found = logistic.fit(features, vehicles)
    assert np.abs(found - weights).max() < 0.1
    others, truth = drawn(20_000, weights, 2)
    predicted = logistic.probability(found, others)
    for low in np.arange(0, 1, 0.1):
        inside = (predicted >= low) & (predicted < low + 0.1)
        assert abs(truth[inside].mean() - predicted[inside].mean()) < 0.05


def test_classes_that_can_be_separated_have_finite_weights() -> None:
    """The prior keeps the weights finite."""
    features = np.array([[1.0, x] for x in (-2.0, -1.0, 1.0, 2.0)])
    found = logistic.fit(features, np.array([0.0, 0.0, 1.0, 1.0]))
    assert np.isfinite(found).all() and 1.0 < found[1] < 10.0


@pytest.mark.parametrize("command", [existence, same_vehicle])
def test_a_command_writes_its_weights_and_keeps_the_others(
    command: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file has one weight for each feature, beside those of the other model."""
    features, truth = drawn(300, np.array([0.0, 3.0]), 3)
    lines = ["clip,track,is_true,feature_0,feature_1"]
    lines += [f"c{i % 5},{i},{int(y)},{x[0]},{x[1]}" for i, (x, y) in enumerate(zip(features, truth, strict=True))]
    (tmp_path / "all.csv").write_text("\n".join(lines))
    (tmp_path / "tracks.json").write_text('{"other": [1.0]}')
    monkeypatch.setattr(sys, "argv", ["fit", str(tmp_path / "all.csv"), "--out", str(tmp_path / "tracks.json")])
    command.main()
    assert "300 claims" in capsys.readouterr().out
    written = json.loads((tmp_path / "tracks.json").read_text())
    key = command.__name__.rpartition(".")[2]
    assert written["schema"] == logistic.SCHEMA and len(written[key]) == 2 and written["other"] == [1.0]
