"""Puts a trained net in place of the product's own one."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.model import CLASSES
from roadplane_train.detect.onnx_file import read_net

MODELS = REPOSITORY / "models"
ORIGINAL_CARD = MODELS / "detector_coco.card.json"


def write_models(net: Path, folder: Path) -> None:
    """Makes a folder of models that differs from models/ in the detector's f32 net alone; it has no other precision."""
    for path in MODELS.iterdir():
        if path.name not in ("detector.card.json", "detector.onnx", "detector.int8.onnx"):
            (folder / path.name).symlink_to(path)
    data = net.read_bytes()
    (folder / "detector.onnx").write_bytes(data)
    card = card_of(data, read_net(net).classes)
    (folder / "detector.card.json").write_text(json.dumps(card, indent=2))


def card_of(data: bytes, classes: int) -> dict:
    """Returns the card of the original net, changed for the file `data` with the first classes of CLASSES."""
    card = json.loads(ORIGINAL_CARD.read_text())
    outputs = [
        {**output, "shape": ["batch", classes, *output["shape"][2:]]} if output["name"].startswith("scores_") else output
        for output in card["outputs"]
    ]
    changed = {
        **card,
        "name": "detector",
        "file": "detector.onnx",
        "decoding": "models/detector.md",
        "sha256": hashlib.sha256(data).hexdigest(),
        "classes": list(CLASSES[:classes]),
        "outputs": outputs,
    }
    changed.pop("variants", None)
    return changed
