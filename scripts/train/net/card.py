"""The model card: for programs (JSON, read by `infer`) and for people (Markdown)."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from net.calibrate import Calibration
from net.model import CELLS, INPUT_PX, KEYPOINTS

DATA_CREDITS = (
    """Rendered cars and scenes: `scripts/train` (credits of the meshes and pictures in `CREDITS.md`)."""
)
REAL_CREDITS = """Hand-labelled real cars (not in this repository): PKLot (Almeida et al. 2015, CC BY 4.0), MEVA \
(Kitware and IARPA, CC BY 4.0), Intel sample videos (CC BY 4.0), Udacity CarND (MIT)."""


def card(path: Path, calibration: Calibration, how_made: dict, metrics: dict) -> dict:
    """The card of the ONNX file at `path`."""
    return {
        "schema": "roadplane.model-card/1",
        "name": "hourglass",
        "version": f"{how_made['recipe']['run']}-{how_made['steps']}",
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
            "crop": "1.25 x longer side of the box, grey 0.5 outside",
        },
        "calibration": {
            "sd_scale": calibration.sd_scale,
            "sd_floor_crop_px": calibration.sd_floor_crop_px,
        },
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


def markdown(card: dict, command: str) -> str:
    """The same for people."""
    made, recipe = card["how_made"], card["how_made"]["recipe"]
    measured = {k.replace("_", " "): v for k, v in card["metrics"].items() if "pck_0.05" in v}
    real = recipe.get("real") not in (None, "None")
    held_out = ", ".join(made["real_held_out"]) or "none"
    return f"""# hourglass

36 car keypoints (`keypoints.json`) in a 128 px crop; contract and decoding rule in `ARCHITECTURE.md`.

- **Net** {made["stacks"]} stacks of {made["channels"]} channels, {made["parameters"]} parameters, no normalisation \
layers, f32; {made["work_px"]} px inside.
- **Training** {made["steps"]} steps, {made["samples"]} samples, {made["minutes"]} minutes, \
{made["rendered_crops"]} rendered crops{" and " + str(made["real_cars"]) + " hand-labelled real cars" if real else ""}, \
seed {recipe["seed"]}; the input grows 64 → 96 → 128 px on the way.
- **Real images** {"learnt from, except " + held_out + ", which calibrated and measured it" if real else "none"}.
- **Calibration** sd² = {card["calibration"]["sd_scale"]}² · variance + \
{card["calibration"]["sd_floor_crop_px"]}² crop px².
- **Licence** {card["licence"]}; learnt from: {DATA_CREDITS}{" " + REAL_CREDITS if real else ""}
- **Made by** `{command}`

| measured on clear keypoints | cars / points | median error, of the box | PCK@0.05 | PCK@0.1 | visibility AUC | \
error / sd, robust | names exchanged |
|---|---|---|---|---|---|---|---|
{chr(10).join(_row(name, m) for name, m in measured.items())}

Boxes are the true ones. Rendered: cars not learnt from, the half that did not calibrate. Real held-out cars also
calibrated the sd, so their error / sd is not independent. The AUC of real cars sets labels "clear" against "hidden or
blurred", which is a softer question than visible against not.

ONNX against PyTorch: {json.dumps(card["metrics"]["parity_with_pytorch"])}
"""
