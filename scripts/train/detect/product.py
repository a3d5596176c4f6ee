"""Runs a net in the product's own binary."""

from __future__ import annotations

import hashlib
import json
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.model import first_classes
from roadplane_train.detect.onnx_file import read_net, write_net

PROGRAM = REPOSITORY / "target/release/roadplane"
MODELS = REPOSITORY / "models"
LEAST_SCORE = 0.05
CLASSES = 3  # that the product reads so far: car, truck, bus


def write_models(net: Path, folder: Path) -> None:
    """Makes a folder of models that differs from models/ in the detector's f32 net alone; it has no other precision."""
    for path in MODELS.iterdir():
        if path.name not in ("detector.card.json", "detector.onnx"):
            (folder / path.name).symlink_to(path)
    write_net(first_classes(read_net(net), CLASSES), folder / "detector.onnx", half=True)
    data = (folder / "detector.onnx").read_bytes()
    card = json.loads((MODELS / "detector.card.json").read_text())
    card["sha256"] = hashlib.sha256(data).hexdigest()
    card.pop("variants", None)
    (folder / "detector.card.json").write_text(json.dumps(card, indent=2))


def detect(
    pictures: Iterable[Path], net: Path | None = None, settings: Iterable[str] = (), program: Path = PROGRAM
) -> Iterator[np.ndarray]:
    """Yields the boxes [n, 5] of each picture: left, top, right, bottom, score, in the product's pixels.

    Without a net it runs the one in models/. The precision is f32, unless a setting says otherwise.
    """
    with tempfile.TemporaryDirectory() as name:
        options = ["infer.provider=cpu", f"detect.min_score={LEAST_SCORE}", *settings]
        if net:
            write_models(net, Path(name))
            options.append(f"models.folder={name}")
        for picture in pictures:
            command = [str(program), "stage", "detect", "--out", "-", *(w for option in options for w in ("--set", option))]
            done = subprocess.run([*command, str(picture)], capture_output=True, text=True, check=False)
            if done.returncode:
                raise RuntimeError(f"{program} failed on {picture}:\n{done.stderr}")
            rows = [[*car["bbox_px"], car["score"]] for car in json.loads(done.stdout.splitlines()[0])["cars"]]
            yield np.array(rows).reshape(-1, 5)
