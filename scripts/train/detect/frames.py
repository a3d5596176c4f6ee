"""Takes stills with truth from rendered clips, as pictures to learn from.

  roadplane-train detect frames --clips DIR --out DIR [--every SECONDS]

Existing stills are kept.
"""

from __future__ import annotations

import argparse
import gzip
import json
from pathlib import Path

import cv2

from roadplane_train.json_files import write_json

QUALITY = 92


def stills_of(truth_path: Path, out: Path, every_s: float) -> int:
    """Writes frames of a clip as stills, and returns their number."""
    with gzip.open(truth_path, "rt") as file:
        truth = json.load(file)
    stem = f"{truth_path.parent.parent.name}_{truth_path.name.split('.')[0]}"
    video = cv2.VideoCapture(str(truth_path.parent / truth["media"]))
    next_s, count = 0.0, 0
    for frame in truth["frames"]:
        done, image = video.read()
        if not done:
            raise ValueError(f"{truth['media']} ends before its truth")
        if frame["time_s"] < next_s - 1e-6:
            continue
        next_s, count = frame["time_s"] + every_s, count + 1
        name = f"{stem}_{frame['frame']:05d}"
        path = out / f"{name}.truth.json.gz"
        if path.exists():
            continue
        cv2.imwrite(str(out / f"{name}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        shown = {car["id"] for car in frame["cars"]}
        models = [model for model in truth["models"] if model["id"] in shown]
        still = {**truth, "media": f"{name}.jpg", "kind": "still", "fps": None, "models": models, "frames": [frame]}
        write_json(path, still)
    return count


def main() -> None:
    """Takes the stills."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path, required=True, help="folder of data sets with clips")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--every", type=float, default=1.0, help="seconds between the stills")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for path in sorted(options.clips.rglob("*.truth.json.gz")):
        print(f"{path}: {stills_of(path, options.out, options.every)} stills", flush=True)


if __name__ == "__main__":
    main()
