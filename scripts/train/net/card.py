"""Writes the model card: JSON for programs (read by `infer`) and Markdown for people."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from roadplane_train.net.data import CONTEXT
from roadplane_train.net.decode import Calibration
from roadplane_train.net.model import CELLS, INPUT_PX, KEYPOINTS

RENDERED_CREDITS = "rendered cars and scenes of `scripts/train` (credits in `CREDITS.md`)"
REAL_CREDITS = (
    "hand-labelled real cars that are not in this repository: PKLot (Almeida et al. 2015, CC BY 4.0), MEVA "
    "(Kitware and IARPA, CC BY 4.0), Intel sample videos (CC BY 4.0), Udacity CarND (MIT)"
)
NOTES = """Boxes are the true ones. Rendered: held-out car models, and the half of the crops that the calibration did
not use. Real test: never used for training, selection or calibration. Real held-out cars also calibrated the sd, so
their normalised error is not independent. The average shape of the rendered cars was adjusted once to all labelled
real training cars (`scripts/train/cars/README.md`). The AUC of real cars compares "clear" with "hidden or blurred"
labels, which is easier to satisfy than visible against hidden."""


def card(path: Path, calibration: Calibration, how_made: dict, metrics: dict) -> dict:
    """Returns the card of the ONNX file at `path`."""
    return {
        "schema": "roadplane.model-card/1",
        "name": "hourglass",
        "version": "-".join([how_made["recipe"]["run"], *(str(stage["steps"]) for stage in how_made["stages"])]),
        "file": path.name,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "licence": "MIT OR Apache-2.0",
        "inputs": [{"name": "image", "dtype": "f32", "shape": ["batch", 3, INPUT_PX, INPUT_PX]}],
        "outputs": [
            {"name": "heatmaps", "dtype": "f32", "shape": ["batch", KEYPOINTS, CELLS, CELLS]},
            {"name": "visibility", "dtype": "f32", "shape": ["batch", KEYPOINTS]},
        ],
        "preprocess": {
            "colour": "RGB",
            "range": [0, 1],
            "context": CONTEXT,
            "outside": "grey 0.5",
        },
        "calibration": asdict(calibration),
        "source": "trained from random weights by scripts/train (models/hourglass.md)",
        "how_made": how_made,
        "metrics": metrics,
    }


def _row(name: str, m: dict) -> str:
    swapped = ", ".join(f"{k} {v}" for k, v in m["confused_cars"].items() if v) or "none"
    auc = "–" if m["visibility_auc"] is None else f"{m['visibility_auc']:.3f}"
    return (
        f"| {name} | {m['cars']} / {m['points']} | {100 * m['median_error_of_box']:.2f} % | "
        f"{100 * m['pck_0.05']:.1f} % | {100 * m['pck_0.1']:.1f} % | {auc} | "
        f"{m['normalised_error_robust_sd']:.2f} | {swapped} |"
    )


def markdown(card: dict) -> str:
    """Returns the card as Markdown."""
    made, recipe, calibration = card["how_made"], card["how_made"]["recipe"], card["calibration"]
    measured = {k: v for k, v in card["metrics"].items() if "pck_0.05" in v}
    data, real, credits = f"{made['rendered_crops']} rendered crops", "none", RENDERED_CREDITS
    if recipe["real"]:
        data += f" and {made['real_cars']} hand-labelled real cars ({recipe['real_share']} of each batch)"
        held_out = ", ".join(made["real_held_out"]) or "none"
        real = f"used for training, except {held_out}, which are held out for measurement and calibration"
        credits += "; " + REAL_CREDITS
    net = (
        f"{made['stacks']} stacks of {made['channels']} channels, {made['parameters']} parameters, "
        f"{made['gflop_per_crop']} GFLOP per crop"
    )
    stages = "; ".join(
        f"{stage['steps']} steps of {stage['batch']} crops at {stage['px']} px, {stage['stacks']} stacks of "
        f"{stage['channels']} channels, rate {stage['rate']:g}, seed {stage['seed']} ({stage['minutes']:.0f} minutes)"
        for stage in made["stages"]
    )
    items = {
        "Net": f"{net}, no normalisation layers, f32, {made['work_px']} px inside",
        "Training": f"{data}; {stages}",
        "Real images": real,
        "Calibration": f"sd² = {calibration['sd_per_variance']}² · variance² + "
        f"{calibration['sd_floor_crop_px']}² crop px²; prior of locations {calibration['prior_mean_crop_px']} ± "
        f"{calibration['prior_sd_crop_px']} crop px",
        "Licence": f"{card['licence']}; trained on {credits}",
        "Made by": "`scripts/train/run" + (" --real DIR`" if recipe["real"] else "`"),
        "ONNX against PyTorch": json.dumps(card["metrics"]["parity_with_pytorch"]),
    }
    if made["note"]:
        items["Note"] = made["note"]
    heads = [
        "clear keypoints of",
        "cars / points",
        "median error / box",
        "PCK@0.05",
        "PCK@0.1",
        "visibility AUC",
    ]
    heads += ["normalised error, robust", "names exchanged"]
    lines = [
        "# hourglass",
        "",
        "This net finds 36 car keypoints (`keypoints.json`) in a crop of 128 px. `docs/book/developers/architecture.md`",
        "describes its inputs and outputs.",
        "",
    ]
    lines += [f"- **{name}**: {text}" for name, text in items.items()]
    lines += ["", f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    lines += [_row(name, m) for name, m in measured.items()]
    return "\n".join([*lines, "", NOTES, ""])
