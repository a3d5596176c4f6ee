"""Writes a trained net as ONNX with its card, checks ONNX Runtime against PyTorch, and writes the fixtures.

roadplane-train activity export --net WORK/3d.pt --name activity --out models
roadplane-train activity export --fixture tests/data/activity/features.json --windows tests/data/activity/windows.json
"""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path

import numpy as np
import torch
from torch import nn

from roadplane_train.json_files import write_json

from . import windows
from .data import made_sequences
from .drives import LABELS, tracked, truth
from .features import FEATURES, STEP_S, features, grid
from .model import Both, Net

ROW_TITLES = {
    "3d": "activities of vehicles, from their motion on the ground",
    "2d": "activities of vehicles, from the motion of their boxes in the picture (baseline of the paper)",
    "2d_size": "activities of vehicles, from the motion of their boxes in the picture over the boxes' size (baseline)",
}


def write_net(net: nn.Module, path: Path, inputs: dict, outputs: dict, examples: list[np.ndarray], about: dict) -> None:
    """Writes an ONNX file and, beside it, its card, which ends with `about`. ONNX Runtime must agree on the examples.

    The shapes of the one input and the one output are given by name. A named dimension may vary.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    shapes = {**inputs, **outputs}
    axes = {name: {i: size for i, size in enumerate(shape) if isinstance(size, str)} for name, shape in shapes.items()}
    names = {"input_names": list(inputs), "output_names": list(outputs)}
    torch.onnx.export(net, (torch.tensor(examples[0]),), str(path), **names, dynamic_axes=axes, opset_version=14)

    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    for example in examples:
        ours = net(torch.tensor(example)).detach().numpy()
        theirs = session.run(None, {next(iter(inputs)): example})[0]
        assert np.abs(ours - theirs).max() < 1e-4, np.abs(ours - theirs).max()
    write_json(
        path.with_suffix(".card.json"),
        {
            "schema": "roadplane.model-card/1",
            "name": path.stem,
            "version": "1",
            "file": path.name,
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "inputs": [{"name": name, "dtype": "f32", "shape": shape} for name, shape in inputs.items()],
            "outputs": [{"name": name, "dtype": "f32", "shape": shape} for name, shape in outputs.items()],
            "calibration": {},
            **about,
        },
        indent=2,
    )


def export(net_path: Path, name: str, out: Path) -> None:
    """Writes `out/name.onnx` and `out/name.card.json`."""
    saved = torch.load(net_path)
    net = Net(saved["result"]["hidden"])
    net.load_state_dict(saved["state"])
    result = saved["result"]
    write_net(
        Both(net, saved["label_weights"]).eval(),
        out / f"{name}.onnx",
        {"motion": ["batch", "steps", FEATURES]},
        {"labels": ["batch", "steps", len(LABELS)]},
        [sequence.values[None] for sequence in made_sequences("3d", 6, 7)],
        {
            "licence": "MIT OR Apache-2.0; trained on MEVA's annotations (CC BY 4.0)",
            "preprocess": {"labels": list(LABELS), "step_s": STEP_S, "features": "scripts/train/activity/features.py"},
            "source": ROW_TITLES[result["row"]],
            "how_made": f"scripts/train/activity/run, row {result['row']}, seed {result['seed']}",
            "metrics": result["metrics"],
        },
    )


def fixture(path: Path) -> None:
    """Returns motions with their features: with heading and sds, with gaps, without either, and a single sample."""
    rng = np.random.default_rng(3)
    cases = []
    for number in range(4):
        drive = truth(rng)
        while len(drive.time_s) > 500:
            drive = truth(rng)
        time_s, xy, heading, sd = (np.round(part, 4) for part in tracked(drive, rng))
        given_heading, given_sd = (heading, sd) if number < 2 else (None, None)
        if number == 1:
            keep = (time_s < 3) | (time_s > 8)
            time_s, xy, given_heading, given_sd = time_s[keep], xy[keep], heading[keep], sd[keep]
        if number == 3:
            time_s, xy = time_s[:1], xy[:1]
        at = grid(time_s)
        cases.append(
            {
                "time_s": time_s.tolist(),
                "xy_m": xy.tolist(),
                "heading_rad": [] if given_heading is None else given_heading.tolist(),
                "sd_m": [] if given_sd is None else given_sd.tolist(),
                "steps": np.round(at / STEP_S).astype(int).tolist(),
                "features": np.round(features(at, time_s, xy, given_heading, given_sd).astype(float), 5).tolist(),
            }
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"schema": "roadplane.activity-features/1", "cases": cases})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--net", type=Path)
    parser.add_argument("--name", default="activity")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--fixture", type=Path)
    parser.add_argument("--windows", type=Path, help="writes the fixture of the windows of the video row to this file")
    options = parser.parse_args()
    if options.fixture:
        fixture(options.fixture)
    if options.windows:
        windows.fixture(options.windows)
    if options.net:
        export(options.net, options.name, options.out)


if __name__ == "__main__":
    main()
