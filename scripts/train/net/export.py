"""Calibrates a trained net and exports it with its card.

  roadplane-train net export --run NAME

It writes hourglass.onnx, hourglass.card.json and hourglass.md, by default into models/.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.net.calibrate import calibrate
from roadplane_train.net.card import card, markdown
from roadplane_train.net.data import Shards, read_real
from roadplane_train.net.decode import decode
from roadplane_train.net.evaluate import Crop, evaluate, load, real_crops, shard_crops
from roadplane_train.net.model import INPUT_PX, Deployed, gflop
from roadplane_train.net.train import split_real

# With more crops the check would only take longer.
PARITY_CROPS = 32
RENDERED_CROPS = 1536
SMALL_CAR_PX = 60


def export_onnx(net: Deployed, path: Path) -> None:
    """Exports with fixed names and a dynamic batch size."""
    names = ["image", "heatmaps", "visibility"]
    torch.onnx.export(
        net,
        torch.zeros(2, 3, INPUT_PX, INPUT_PX),
        str(path),
        opset_version=16,
        input_names=names[:1],
        output_names=names[1:],
        dynamic_axes={name: {0: "batch"} for name in names},
    )


def parity(net: Deployed, path: Path, crops: list[Crop]) -> dict[str, float]:
    """Returns the largest differences between PyTorch and ONNX Runtime, at another batch size than the export."""
    images = np.stack([c.image for c in crops[:PARITY_CROPS]]).transpose(0, 3, 1, 2).astype(np.float32) / 255
    with torch.no_grad():
        heat, seen = (x.numpy() for x in net(torch.from_numpy(images)))
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    other_heat, other_seen = session.run(["heatmaps", "visibility"], {"image": images})
    points = np.abs(decode(heat)[0] - decode(other_heat)[0])
    return {
        "max_abs_logit_difference": round(float(np.abs(heat - other_heat).max()), 6),
        "max_abs_visibility_difference": round(float(np.abs(seen - other_seen).max()), 7),
        "max_keypoint_difference_crop_px": round(float(points.max()), 5),
    }


def main() -> None:
    """Exports a net and prints its evaluation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", default="hourglass")
    parser.add_argument("--runs", type=Path, default=Path(".work/runs"))
    parser.add_argument("--crops", type=Path, default=Path(".work/crops/eval"))
    parser.add_argument("--real", type=Path, help="folder of hand-labelled cars")
    parser.add_argument("--note", default="", help="further text for the card on how the net was made")
    parser.add_argument("--test", type=Path, help="folder of labelled cars for the evaluation alone")
    parser.add_argument("--work-px", type=int, help="input size of the net, px (default: that of its last training)")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "models")
    args = parser.parse_args()
    torch.set_num_threads(1)
    weights = args.runs / args.run / "last.pt"
    net, state = load(weights, args.work_px), torch.load(weights, map_location="cpu")
    recipe = json.loads((weights.parent / "recipe.json").read_text())
    rendered = shard_crops(Shards(args.crops), RENDERED_CROPS)
    if isinstance(recipe["hold_out"], str):
        recipe["hold_out"] = recipe["hold_out"].strip("[]").replace("'", "").replace(",", " ").split()
    for name in ("crops", "real", "runs", "start_from"):  # the folders of one machine mean nothing on others
        recipe[name] = None if recipe[name] in (None, "None") else Path(recipe[name]).name
    learnt, held_out = split_real(read_real(args.real) if args.real else [], recipe["hold_out"])
    held_out_crops = real_crops(held_out)
    calibration = calibrate(net, rendered[::2], held_out_crops)
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "hourglass.onnx"
    export_onnx(net, path)
    small = [c for c in rendered[1::2] if c.car_px < SMALL_CAR_PX]
    measured = {"rendered cars": rendered[1::2], f"rendered cars below {SMALL_CAR_PX} px": small}
    for crop in held_out_crops:
        measured.setdefault(f"real {crop.group}, held out", []).append(crop)
    for crop in real_crops(read_real(args.test)) if args.test else []:
        measured.setdefault(f"real {crop.group}, test", []).append(crop)
    metrics = {name: evaluate(net, crops, calibration).numbers() for name, crops in measured.items() if crops}
    metrics["parity_with_pytorch"] = parity(net, path, rendered)
    how_made = {
        "stacks": state["stacks"],
        "channels": state["channels"],
        "work_px": net.work_px,
        "parameters": sum(p.numel() for p in net.parameters()),
        "gflop_per_crop": round(gflop(net), 4),
        "stages": state["stages"],
        "rendered_crops": state["shards"],
        "real_cars": len(learnt) if recipe["real"] else 0,
        "real_held_out": sorted({c.group for c in held_out_crops}),
        "recipe": recipe,
        "note": args.note,
    }
    made = card(path, calibration, how_made, metrics)
    (args.out / "hourglass.card.json").write_text(json.dumps(made, indent=1) + "\n")
    (args.out / "hourglass.md").write_text(markdown(made))
    print(json.dumps({"calibration": made["calibration"], **metrics}, indent=1))


if __name__ == "__main__":
    main()
