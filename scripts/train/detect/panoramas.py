"""Writes the CC0 panoramas of the npm package @pmndrs/assets as photographs without vehicles.

  roadplane-train detect panoramas --out DIR [--package FILE.tgz]

Every second one goes to DIR/learn, the others to DIR/measure. They have 512 × 256 px, so they show walls, clouds and
trees, but few details.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import os
import re
import subprocess
import tarfile
import tempfile
from pathlib import Path

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"  # before OpenCV is loaded
import cv2  # noqa: E402
import numpy as np  # noqa: E402

PACKAGE = "@pmndrs/assets@1.7.0"
PACKAGE_SHA256 = "152bd218a3390703f184f0c6ce16e73c8f0a87f32d38530d418a09d33d8208dc"
LEFT_OUT = ("city",)  # its far roads may show vehicles
BRIGHT_PERCENTILE, BRIGHT_LEVEL, GAMMA = 90, 0.75, 2.2


def exposed(radiance: np.ndarray) -> np.ndarray:
    """Returns radiances as 8-bit pixels, as a camera would expose them."""
    level = radiance[..., :3] / max(float(np.percentile(radiance[..., :3], BRIGHT_PERCENTILE)), 1e-6) * BRIGHT_LEVEL
    return (level.clip(0, 1) ** (1 / GAMMA) * 255 + 0.5).astype(np.uint8)


def write_panoramas(package: Path, out: Path) -> int:
    """Writes the panoramas of the package, and returns their number."""
    with tarfile.open(package) as archive:
        members = sorted(m.name for m in archive.getmembers() if m.name.endswith(".exr.js"))
        names = [name for name in members if Path(name).name.split(".")[0] not in LEFT_OUT]
        for k, name in enumerate(names):
            text = archive.extractfile(name).read().decode()
            data = base64.b64decode(re.search(r"base64,([A-Za-z0-9+/=]+)", text)[1])
            radiance = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            if radiance is None:
                raise ValueError(f"{name} cannot be read: OpenCV has no OpenEXR")
            folder = out / ("learn", "measure")[k % 2]
            folder.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / f"{Path(name).name.split('.')[0]}.png"), exposed(radiance))
    return len(names)


def main() -> None:
    """Fetches the package and writes its panoramas."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--package", type=Path, help="local file of the npm package")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if not options.package:
            subprocess.run(["npm", "pack", "--silent", PACKAGE], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        package = options.package or next(Path(folder).glob("*.tgz"))
        if hashlib.sha256(package.read_bytes()).hexdigest() != PACKAGE_SHA256:
            raise SystemExit(f"{package} is not the pinned package {PACKAGE}")
        print(f"{write_panoramas(package, options.out)} panoramas")


if __name__ == "__main__":
    main()
