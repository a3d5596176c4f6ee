"""Writes a trained net into models/ as the product's detector, with its card.

  roadplane-train detect release --net FILE [--share S] [--models DIR]

FILE is an ONNX file or a checkpoint. The weights become S times the trained and 1 − S times the original ones
(arXiv 2109.01903). Such a mean keeps more of the original's knowledge of pictures that the training lacks. Make the
int8 file after it: scripts/models/quantise.py detector. To measure a net only, use `detect evaluate`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from roadplane_train.detect.model import NanoDet, with_classes
from roadplane_train.detect.onnx_file import read_net, write_net
from roadplane_train.detect.product import MODELS, card_of
from roadplane_train.detect.train import averaged_net

# Chosen on held-out pictures, and on pictures without vehicles (models/detector.md).
SHARE = 0.9
LICENCE = (
    "MIT OR Apache-2.0; original weights: Apache-2.0 (NanoDet), MIT (package), models/detector.LICENSE; "
    "pictures: CC BY and CC0, models/CREDITS.md"
)


def mixed(trained: NanoDet, share: float) -> NanoDet:
    """Returns the mean of the trained and the original weights; `share` is the weight of the trained ones.

    Classes that the original lacks keep their trained weights in the last layers.
    """
    published = read_net()
    original = with_classes(published, trained.classes).state_dict()
    state = {name: original[name] + share * (v - original[name]) for name, v in trained.state_dict().items()}
    for name, values in trained.state_dict().items():
        if ".out." in name:
            state[name][published.classes : trained.classes] = values[published.classes : trained.classes]
    net = NanoDet(trained.classes)
    net.load_state_dict(state)
    return net


def read_trained(path: Path) -> NanoDet:
    """Returns the net of an ONNX file or the averaged net of a checkpoint."""
    return read_net(path) if path.suffix == ".onnx" else averaged_net(path)


def main() -> None:
    """Writes the net and its card."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--net", type=Path, required=True)
    parser.add_argument("--share", type=float, default=SHARE, help="weight of the trained net, 0–1")
    parser.add_argument("--models", type=Path, default=MODELS)
    options = parser.parse_args()
    trained = read_trained(options.net)
    path = options.models / "detector.onnx"
    write_net(mixed(trained, options.share), path, half=True)
    card = card_of(path.read_bytes(), trained.classes) | {
        "version": "3",
        "licence": LICENCE,
        "source": "fine-tuned from models/detector_coco.onnx by scripts/train/detect (models/detector.md)",
        "how_made": {"command": f"roadplane-train detect release --share {options.share}"},
    }
    recipe = options.net.parent / "recipe.json"
    if recipe.exists():
        names = ("run", "steps", "batch", "rate", "decay", "hold", "input_px", "seed")
        card["how_made"] |= {name: value for name, value in json.loads(recipe.read_text()).items() if name in names}
    (options.models / "detector.card.json").write_text(json.dumps(card, indent=2, ensure_ascii=False) + "\n")
    print(f"{path.name}: {card['sha256']}")


if __name__ == "__main__":
    main()
