"""Finds the false boxes of a net in the training pictures, so that the training looks there more often.

  roadplane-train detect mistakes --net FILE [--out FILE]

Run it again after a training. The file lists boxes of each picture, left, top, right, bottom in px.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import torch

from roadplane_train.detect.augment import letterbox
from roadplane_train.detect.data import Batch, whole_pictures
from roadplane_train.detect.metrics import overlaps
from roadplane_train.detect.model import NanoDet
from roadplane_train.detect.onnx_file import read_net
from roadplane_train.detect.pictures import Picture, key_of
from roadplane_train.detect.train import WORK, found_in, parse_options, pictures_of

LEAST_SCORE = 0.25  # below the product's threshold: other views of the same thing may score more
FARTHEST_IOU = 0.25  # with every vehicle, as in `rolled.json`
MOST = 12  # of a picture, the best-scored ones
INPUT_PX = 960


def mistakes_of(net: NanoDet, picture: Picture, batch: Batch | None = None, input_px: int = INPUT_PX) -> np.ndarray:
    """Returns the boxes [n, 4] in the picture that are no vehicle, best-scored first.

    Boxes that lie by half in an ignored one are left out. `batch` is the whole picture, if it is read already.
    """
    batch = batch or whole_pictures([picture], input_px)[0]
    found = found_in(net, batch, LEAST_SCORE)[:, :4]
    vehicles, ignored = batch.boxes[0].numpy(), batch.ignored[0].numpy()
    near, within = (overlaps(found, known) for known in (np.concatenate([vehicles, ignored]), ignored))
    false = (near[0] < FARTHEST_IOU).all(1) & (within[1] < 0.5).all(1)
    view = letterbox(picture.size_px, input_px)
    corners = (found[false][:MOST].reshape(-1, 2, 2) - input_px / 2) / view.scale + np.array(view.centre)
    return corners.reshape(-1, 4)


def main() -> None:
    """Writes the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--net", type=Path, required=True, help="ONNX file")
    parser.add_argument("--out", type=Path, default=WORK / "mistakes.json")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--jobs", type=int, default=1, help="threads that read pictures")
    options = parser.parse_args()
    torch.set_num_threads(1)
    net = read_net(options.net).to(options.device, memory_format=torch.channels_last)
    listed: dict[str, list[list[float]]] = {}
    for name, pictures in pictures_of(parse_options(["--preset", "full"])).items():
        before = sum(map(len, listed.values()))
        with ThreadPoolExecutor(options.jobs) as pool:
            for start in range(0, len(pictures), 64):  # a part at a time, as read pictures take memory
                part = pictures[start : start + 64]
                for picture, (batch,) in zip(part, pool.map(lambda one: whole_pictures([one], INPUT_PX), part), strict=True):
                    if len(boxes := mistakes_of(net, picture, batch)):
                        listed[key_of(picture)] = boxes.round(1).tolist()
        print(f"{name}: {sum(map(len, listed.values())) - before} mistakes in {len(pictures)} pictures", flush=True)
    options.out.write_text(json.dumps(listed))


if __name__ == "__main__":
    main()
