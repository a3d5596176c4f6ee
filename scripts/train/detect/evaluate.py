"""Measures a net in the product's binary: AP50, AP70, vehicles found at 90 and 95 % precision, false boxes.

  roadplane-train detect evaluate [--net FILE] [--data ../shared/data/detect] [--empty DIR] [--set KEY=VALUE]

It needs a release build (`cargo build --release`). FILE is an ONNX file or a checkpoint. Without it the net of models/
is measured. It reads `eval.json` and `rolled.json` of the folder. Both are for measuring only.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.metrics import Judged, overlaps
from roadplane_train.detect.pictures import empty_pictures
from roadplane_train.detect.product import PROGRAM, detect

SMALLEST_PX = 24.0  # width, as in the product's `detect.min_width_px`
NEIGHBOUR_IOU = 0.25  # a box on a rolled picture is false if it overlaps no vehicle by this


def judge(records: list[dict], found: list[np.ndarray], least_iou: float, smallest_px: float) -> Judged:
    """Judges found boxes on the pictures of `eval.json`; narrower vehicles are ignored."""
    judged = Judged(least_iou)
    for record, rows in zip(records, found, strict=True):
        true = np.array(record["boxes_px"], float).reshape(-1, 4)
        ignored = np.array(record["ignore_px"], float).reshape(-1, 4)
        small = true[:, 2] - true[:, 0] < smallest_px
        judged.add(rows, true[~small], np.concatenate([ignored, true[small]]))
    return judged


def summary(records: list[dict], found: list[np.ndarray], smallest_px: float, least_score: float) -> str:
    """Returns the line of figures of `eval.json`."""
    at50, at70 = (judge(records, found, least, smallest_px) for least in (0.5, 0.7))
    (n90, s90), (n95, s95) = at50.found_at(0.9), at50.found_at(0.95)
    right, false, score = at50.best_f1()
    kept, wrong = at50.from_score(least_score)
    return (
        f"{at50.vehicles} vehicles: AP50 {at50.average_precision():.1f} AP70 {at70.average_precision():.1f}; "
        f"found at 90 % {n90} (score {s90:.2f}), at 95 % {n95} ({s95:.2f}); "
        f"best F1 {right} / {false} false ({score:.2f}); from {least_score:.2f} {kept} / {wrong} false"
    )


def rolled(records: list[dict], found: list[np.ndarray], least_score: float) -> dict[int, tuple[int, int, int]]:
    """Returns for each angle the labelled cars, those found, and false boxes of `rolled.json`."""
    counts: dict[int, np.ndarray] = {}
    for record, rows in zip(records, found, strict=True):
        rows = rows[rows[:, 4] >= least_score]
        judged = Judged(0.5)
        judged.add(rows, np.array(record["boxes_px"], float), np.zeros((0, 4)))
        near = overlaps(rows, np.array(record["neighbours_px"], float).reshape(-1, 4))[0]
        false = int((near.max(1, initial=0) < NEIGHBOUR_IOU).sum())
        row = np.array([judged.vehicles, sum(judged.right), false])
        counts[record["angle_deg"]] = counts.get(record["angle_deg"], 0) + row
    return {angle: tuple(row.tolist()) for angle, row in counts.items()}


def as_onnx(net: Path, folder: Path) -> Path:
    """Returns the net as an ONNX file; of a checkpoint it takes the averaged weights."""
    if net.suffix == ".onnx":
        return net
    from roadplane_train.detect.onnx_file import write_net
    from roadplane_train.detect.train import averaged_net

    write_net(averaged_net(net), folder / "net.onnx", half=True)
    return folder / "net.onnx"


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--net", type=Path, help="ONNX file or checkpoint (default: the net of models/)")
    parser.add_argument("--data", type=Path, default=REPOSITORY.parent / "shared/data/detect")
    parser.add_argument("--empty", type=Path, help="folder of photographs without vehicles, to count false boxes on")
    parser.add_argument("--leave-out", nargs="*", default=[], metavar="STEM", help="pictures of eval.json to leave out")
    parser.add_argument("--least-score", type=float, default=0.35, help="threshold of the product")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="setting of the product")
    parser.add_argument("--program", type=Path, default=PROGRAM)
    options = parser.parse_args()
    if not options.program.exists():
        parser.error(f"{options.program} is missing: cargo build --release")
    with tempfile.TemporaryDirectory() as folder:
        net = as_onnx(options.net, Path(folder)) if options.net else None

        def run(paths: list[Path]) -> list[np.ndarray]:
            return list(detect(paths, net, options.set, options.program))

        if (options.data / "eval.json").exists():
            records = json.loads((options.data / "eval.json").read_text())["images"]
            records = [record for record in records if Path(record["file"]).stem not in options.leave_out]
            found = run([options.data / record["file"] for record in records])
            print("all:", summary(records, found, 0.0, options.least_score))
            print("24 px and more:", summary(records, found, SMALLEST_PX, options.least_score))
        if (options.data / "rolled.json").exists():
            records = json.loads((options.data / "rolled.json").read_text())["images"]
            found = run([options.data / record["file"] for record in records])
            for angle, (cars, right, false) in rolled(records, found, options.least_score).items():
                print(f"rolled by {angle}°: {right} of {cars} found, {false} false boxes")
        if options.empty:
            pictures = [picture.path for picture in empty_pictures(options.empty)]
            false = sum(int((rows[:, 4] >= options.least_score).sum()) for rows in run(pictures))
            print(f"{len(pictures)} pictures without vehicles: {false} false boxes")


if __name__ == "__main__":
    main()
