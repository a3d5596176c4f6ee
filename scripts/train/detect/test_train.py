"""Tests of the training; they need PyTorch."""

# ruff: noqa: E402

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.evaluate import as_onnx
from roadplane_train.detect.model import STRIDES
from roadplane_train.detect.onnx_file import answers, read_net
from roadplane_train.detect.pictures import Picture
from roadplane_train.detect.train import Training, averaged_net, parse_options, split, train

LOTS = REPOSITORY / "tests/data/lots/scenes"


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a folder of three renderings, a real picture with one label, and two pictures without vehicles."""
    folder = tmp_path_factory.mktemp("pictures")
    for part in ("rendered", "empty", "train"):
        (folder / part).mkdir()
    for k in range(3):
        for suffix in ("jpg", "truth.json.gz"):
            shutil.copy(LOTS / f"still_{k:04d}.{suffix}", folder / "rendered")
    rng = np.random.default_rng(1)
    for name in ("empty/a.png", "empty/b.png", "train/a.jpg", "train/b.jpg"):
        cv2.imwrite(str(folder / name), rng.integers(0, 255, (160, 200, 3), np.uint8))
    lines = [
        {"file": f"train/{name}.jpg", "size_px": [200, 160], "labels": [[20, 20, 120, 90, "bus"]], "teacher": []} for name in "ab"
    ]
    (folder / "train.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


def options(pictures: Path, runs: Path, run: str, *more: str) -> list[str]:
    """Returns the options of a training that takes seconds."""
    return [
        *("--runs", str(runs), "--run", run, "--rendered", str(pictures / "rendered"), "--empty", str(pictures / "empty")),
        *("--real", str(pictures / "train.jsonl"), "--hold-out", "2", "--steps", "6", "--batch", "3", "--input-px", "96"),
        *more,
    ]


def test_a_killed_training_goes_on_as_if_it_had_not_been(pictures: Path, tmp_path: Path) -> None:
    def advanced(run: str, steps: int) -> Training:
        training = Training(parse_options(options(pictures, tmp_path, run)))
        training.read_pictures()
        while training.step < steps:
            training.advance()
        training.save()
        return training

    whole = advanced("whole", 4)
    advanced("killed", 2)
    resumed = advanced("killed", 4)
    for name, value in whole.average.weights.items():
        np.testing.assert_array_equal(value.numpy(), resumed.average.weights[name].numpy(), name)
    assert any(not torch.equal(value, whole.original.state_dict()[name]) for name, value in whole.net.state_dict().items())


def test_a_training_ends_with_a_net_that_the_product_can_run(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train(parse_options(options(pictures, tmp_path, "run")))
    lines = capsys.readouterr().out
    assert "done: 6 steps of 3 pictures" in lines and "held out, rendered: AP50" in lines
    image = torch.rand(1, 3, 96, 96)
    written = answers(read_net(tmp_path / "run/net.onnx"), image)
    averaged = answers(averaged_net(tmp_path / "run/last.pt"), image)
    for stride in STRIDES:  # the file stores f16
        np.testing.assert_allclose(written[f"scores_{stride}"], averaged[f"scores_{stride}"], atol=5e-3)
    assert as_onnx(tmp_path / "run/last.pt", tmp_path) == tmp_path / "net.onnx"
    assert (tmp_path / "net.onnx").read_bytes() == (tmp_path / "run/net.onnx").read_bytes()
    train(parse_options(options(pictures, tmp_path, "run")))
    assert "finished earlier" in capsys.readouterr().out


def test_the_net_learns_one_picture(pictures: Path, tmp_path: Path) -> None:
    training = Training(parse_options(options(pictures, tmp_path, "one")))
    training.read_pictures()
    lesson = next(training.lessons)
    first = float(training.losses(lesson).total())
    optimiser = torch.optim.AdamW(training.net.parameters(), lr=2e-4)
    for _ in range(12):
        optimiser.zero_grad()
        training.losses(lesson).total().backward()
        optimiser.step()
    assert float(training.losses(lesson).total()) < 0.8 * first


def test_presets_give_defaults_only() -> None:
    small = parse_options(["--steps", "3"])
    assert (small.steps, small.batch, small.run) == (3, 8, "small") and small.real is None
    full = parse_options(["--preset", "full"])
    assert full.steps == 10_000 and full.real.name == "train.jsonl"


def test_every_nth_picture_is_held_out() -> None:
    pictures = [Picture(Path(str(k)), (1, 1), (), (), real=True) for k in range(7)]
    learn, held_out = split(pictures, 3)
    assert [p.path.name for p in held_out] == ["0", "3", "6"] and len(learn) == 4


def test_frames_of_a_clip_are_held_out_together() -> None:
    names = ["lots/still_0000.jpg", "lots/still_0001.jpg", *(f"busy/busy_clip_{k // 3:04d}_{k % 3:05d}.jpg" for k in range(9))]
    learn, held_out = split([Picture(Path(name), (1, 1), (), (), real=False) for name in names], 2)
    assert [str(p.path) for p in held_out] == [names[0], *names[2:5], *names[8:11]]
    assert [str(p.path) for p in learn] == [names[1], *names[5:8]]
