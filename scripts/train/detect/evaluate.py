"""Measures a net with `roadplane-lab eval detector`, in f32.

  roadplane-train detect evaluate [--net FILE] [INPUT ...] [--out DIR] [--set KEY=VALUE]

It needs a release build (`cargo build --release`). FILE is an ONNX file or a checkpoint. Without it the net of models/
is measured. An INPUT is a list of pictures with boxes, a data set, or a folder of pictures without vehicles. Without
INPUT it measures eval.json and rolled.json of ../shared/data/detect, which are for measuring only.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.product import write_models

PROGRAM = REPOSITORY / "target/release/roadplane-lab"
DATA = REPOSITORY.parent / "shared/data/detect"


def as_onnx(net: Path, folder: Path) -> Path:
    """Returns the net as an ONNX file; of a checkpoint it takes the averaged weights."""
    if net.suffix == ".onnx":
        return net
    from roadplane_train.detect.onnx_file import write_net
    from roadplane_train.detect.train import averaged_net

    write_net(averaged_net(net), folder / "net.onnx", half=True)
    return folder / "net.onnx"


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="*", type=Path, default=[DATA / "eval.json", DATA / "rolled.json"])
    parser.add_argument("--net", type=Path, help="ONNX file or checkpoint (default: the net of models/)")
    parser.add_argument("--out", type=Path, help="write the tables and the pictures with the most errors into this folder")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="setting of the product")
    parser.add_argument("--program", type=Path, default=PROGRAM)
    options = parser.parse_args()
    if not options.program.exists():
        parser.error(f"{options.program} is missing: cargo build --release")
    with tempfile.TemporaryDirectory() as name:
        folder, settings = Path(name), list(options.set)
        if options.net:
            (folder / "models").mkdir()
            write_models(as_onnx(options.net, folder), folder / "models")
            settings.append(f"models.folder={folder / 'models'}")
        command = [str(options.program), "eval", "detector", *map(str, options.inputs), "--format", "f32"]
        command += [word for setting in settings for word in ("--set", setting)]
        command += ["--out", str(options.out)] if options.out else []
        sys.exit(subprocess.run(command, check=False).returncode)


if __name__ == "__main__":
    main()
