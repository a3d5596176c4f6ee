"""Tests of the fit of colours."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from ..json_files import read_json, write_json
from . import colour

NUMBERS = np.array([6.0, 2.0, 3.0])


def changes(count: int, scale: float, random: np.random.Generator) -> np.ndarray:
    """Returns changes of colour with a t distribution, whose sds are those of one vehicle times a factor."""
    light = random.normal(size=(count, 1)) * NUMBERS[0]
    tint = random.normal(size=(count, 3)) * NUMBERS[1]
    gauss = light + tint - tint.mean(1, keepdims=True)
    return scale * gauss / np.sqrt(random.chisquare(4, size=(count, 1)) / 4)


def test_the_fit_finds_the_numbers_that_made_the_data() -> None:
    """With much data, the numbers are those of the model."""
    random = np.random.default_rng(1)
    same, other = changes(20_000, 1.0, random), changes(20_000, NUMBERS[2], random)
    found = colour.fit(same, other)
    assert np.abs(found / NUMBERS - 1).max() < 0.1
    assert colour.loss(found, same, other) < colour.loss(found * [3, 1, 1], same, other)


def test_pairs_are_of_one_vehicle_or_of_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Boxes are compared with those of later seconds. Boxes without a colour or a vehicle do not count."""
    places = {1: [0, 0, 10, 10], 2: [50, 0, 60, 10]}
    cars = [{"id": vehicle, "box": place} for vehicle, place in places.items()]
    for clip in ("a", "b"):
        truth = {"kind": "clip", "frames": [{"frame": i, "cars": cars} for i in range(3)]}
        write_json(tmp_path / f"{clip}.truth.json.gz", truth)
        (tmp_path / clip).mkdir()
        lines = []
        for i in range(3):
            boxes = [{"bbox_px": place, "colour_rgb": [40 * vehicle + i] * 3} for vehicle, place in places.items()]
            boxes += [{"bbox_px": places[1]}, {"bbox_px": [90, 0, 99, 9], "colour_rgb": [0, 0, 0]}]
            lines.append(json.dumps({"frame": i, "time_s": float(i), "cars": boxes}))
        (tmp_path / clip / "frames.jsonl").write_text("\n".join(lines))
    same, other = colour.pairs(read_json(tmp_path / "a.truth.json.gz"), tmp_path / "a/frames.jsonl")
    assert sorted(same[:, 0]) == [1, 1, 1, 1, 2, 2] and sorted(np.abs(other[:, 0])) == [38, 39, 39, 41, 41, 42]
    out = tmp_path / "tracks.json"
    out.write_text('{"other": [1.0]}')
    monkeypatch.setattr(sys, "argv", ["colour", "--clips", str(tmp_path), "--runs", str(tmp_path), "--out", str(out)])
    colour.main()
    assert "2 clips, 12 pairs of one vehicle, 12 of two" in capsys.readouterr().out
    written = json.loads(out.read_text())
    assert len(written["colour"]) == 3 and written["other"] == [1.0]
