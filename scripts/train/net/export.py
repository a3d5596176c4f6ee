"""Calibrates a trained net and exports it with its card: `python -m net.export --run NAME`.

Writes hourglass.onnx, hourglass.card.json and hourglass.md, by default into models/.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from cars.mesh import REPOSITORY
from net.calibrate import calibrate
from net.card import card, markdown
from net.data import Shards, read_real
from net.decode import decode
from net.evaluate import Crop, evaluate, load, real_crops, shard_crops
from net.model import INPUT_PX, Deployed, gflop
from net.train import split_real

# More and the check would cost more than it tells.
PARITY_CROPS = 32
RENDERED_CROPS = 1536
SMALL_CAR_PX = 60


def export_onnx(net: Deployed, path: Path) -> None:
    """Fixed names, dynamic batch."""
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
    """Largest differences between PyTorch and ONNX Runtime; another batch size than the one exported with."""
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
    """Exports and says how good it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", default="hourglass")
    parser.add_argument("--runs", type=Path, default=Path(".work/runs"))
    parser.add_argument("--crops", type=Path, default=Path(".work/crops/eval"))
    parser.add_argument("--real", type=Path, help="folder of hand-labelled cars")
    parser.add_argument("--note", default="", help="what else the card must say about how the net was made")
    parser.add_argument("--test", type=Path, help="folder of labelled cars that are only ever measured on")
    parser.add_argument("--work-px", type=int, help="picture size to use the net at, instead of its last one")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "models")
    args = parser.parse_args()
    torch.set_num_threads(1)
    weights = args.runs / args.run / "last.pt"
    net, state = load(weights, args.work_px), torch.load(weights)
    recipe = json.loads((weights.parent / "recipe.json").read_text())
    rendered = shard_crops(Shards(args.crops), RENDERED_CROPS)
    if isinstance(recipe["hold_out"], str):
        recipe["hold_out"] = recipe["hold_out"].strip("[]").replace("'", "").replace(",", " ").split()
    for name in ("crops", "real", "runs", "start_from"):  # folders of one machine tell nobody anything
        recipe[name] = None if recipe[name] in (None, "None") else Path(recipe[name]).name
    learnt, held = split_real(read_real(args.real) if args.real else [], recipe["hold_out"])
    held_crops = real_crops(held)
    calibration = calibrate(net, rendered[::2], held_crops)
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "hourglass.onnx"
    export_onnx(net, path)
    small = [c for c in rendered[1::2] if c.car_px < SMALL_CAR_PX]
    measured = {"rendered cars": rendered[1::2], f"rendered cars below {SMALL_CAR_PX} px": small}
    for crop in held_crops:
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
        "real_held_out": sorted({c.group for c in held_crops}),
        "recipe": recipe,
        "note": args.note,
    }
    made = card(path, calibration, how_made, metrics)
    (args.out / "hourglass.card.json").write_text(json.dumps(made, indent=1) + "\n")
    (args.out / "hourglass.md").write_text(markdown(made))
    print(json.dumps({"calibration": made["calibration"], **metrics}, indent=1))


if __name__ == "__main__":
    main()
