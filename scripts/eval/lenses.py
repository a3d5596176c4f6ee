"""Evaluates focal length and distortion on rendered clips with added lens distortion, beside the same clips without.

  python3 scripts/eval/lenses.py [DATASET] [--program target/release/roadplane] [--work FOLDER]

Every clip of the data set (default tests/data/lots) is distorted. OpenCV's k1 is drawn evenly from -0.4 to 0.05, with a
fixed seed; k2 = 0.3 k1², as in published lenses. Then it is run and compared with its truth. The picture is
magnified so that it has no empty rim; the true focal length grows with it. The script prints one line per clip, and the
medians. FOLDER must not hold older runs. It needs numpy, OpenCV and the ffmpeg command.
"""

import argparse
import gzip
import json
import math
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

K1 = (-0.4, 0.05)
SEED = 18


def distort(frames: list[np.ndarray], focal_px: float, k1: float) -> tuple[list[np.ndarray], float]:
    """Returns the distorted frames, and the focal length after magnification."""
    height, width = frames[0].shape[:2]
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    k2 = 0.3 * k1 * k1
    radii = np.linspace(0, 1.5 * math.hypot(*middle), 4000)

    def distorted(straight_px: np.ndarray) -> np.ndarray:
        square = (straight_px / focal_px) ** 2
        return straight_px * (1 + k1 * square + k2 * square**2)

    # Only up to where the lens's radius stops growing.
    falls = np.flatnonzero(np.diff(distorted(radii)) <= 0)
    rising = radii[: falls[0] + 1] if len(falls) else radii
    # Magnification for which the corners and the middles of the sides show something.
    reach = np.array([math.hypot(*middle), middle[0], middle[1]])
    scale = max(1.0, max(r / distorted(np.array(r)) for r in reach))
    rows, columns = np.mgrid[0:height, 0:width]
    from_middle = np.stack([columns - middle[0], rows - middle[1]], axis=-1) / scale
    distance = np.linalg.norm(from_middle, axis=-1)
    straight = np.interp(distance, distorted(rising), rising)
    where = from_middle * (straight / np.maximum(distance, 1e-9))[..., None] + middle
    maps = where.astype(np.float32)
    return [
        cv2.remap(frame, maps[..., 0], maps[..., 1], cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE) for frame in frames
    ], focal_px * scale


def read(clip: Path) -> list[np.ndarray]:
    """Reads all frames of a clip."""
    capture = cv2.VideoCapture(str(clip))
    frames = []
    while True:
        is_there, frame = capture.read()
        if not is_there:
            return frames
        frames.append(frame)


def write(frames: list[np.ndarray], path: Path, rate: float) -> None:
    """Writes a clip with little compression."""
    height, width = frames[0].shape[:2]
    command = [
        "ffmpeg",
        "-loglevel",
        "error",
        "-y",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "bgr24",
        "-s",
        f"{width}x{height}",
        "-r",
        f"{rate}",
        "-i",
        "-",
        "-c:v",
        "libx264",
        "-crf",
        "17",
        "-pix_fmt",
        "yuv420p",
        str(path),
    ]
    subprocess.run(command, input=b"".join(frame.tobytes() for frame in frames), check=True)


def camera_of(program: Path, clip: Path, out: Path) -> dict:
    """Returns a run's estimate of the camera."""
    subprocess.run(
        [str(program), "run", str(clip), "--out", str(out), "--set", "activity.enabled=false"],
        check=True,
        stderr=subprocess.DEVNULL,
    )
    return json.loads((out / clip.stem / "camera.json").read_text())


def truth_of(clip: Path) -> dict:
    """Returns the truth beside a clip."""
    packed = clip.with_suffix(".truth.json.gz")
    text = gzip.open(packed, "rt").read() if packed.is_file() else clip.with_suffix(".truth.json").read_text()
    return json.loads(text)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", nargs="?", type=Path, default=Path("tests/data/lots"))
    parser.add_argument("--program", type=Path, default=Path("target/release/roadplane"))
    parser.add_argument("--work", type=Path)
    args = parser.parse_args()
    work = args.work or Path(tempfile.mkdtemp(prefix="lenses."))
    work.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(SEED)
    errors: dict[str, list[tuple[float, float]]] = {"straight": [], "bent": []}
    for clip in sorted(args.dataset.rglob("*.mp4")):
        k1 = float(random.uniform(*K1))
        focal_px = truth_of(clip)["camera"]["focal_px"]
        frames = read(clip)
        rate = cv2.VideoCapture(str(clip)).get(cv2.CAP_PROP_FPS)
        shown, magnified_px = distort(frames, focal_px, k1)
        there = work / f"{clip.stem}.bent.mp4"
        write(shown, there, rate)
        line = f"{clip.stem}: k1 {k1:+.3f}"
        for name, path, true_px in (("straight", clip, focal_px), ("bent", there, magnified_px)):
            camera = camera_of(args.program, path, work / name)
            error, sd = math.log(camera["focal_px"] / true_px), camera["focal_sd_px"] / camera["focal_px"]
            errors[name].append((error, error / sd))
            lens = camera["lens"]
            told = f"k1 {lens['k1']:+.3f} ± {lens['k1_sd']:.3f}" if lens else "taken for straight"
            line += f"; {name}: focal {100 * error:+.1f} % ({error / sd:+.1f} sd), {told}"
        print(line, flush=True)
    for name, found in errors.items():
        sizes, in_sds = np.abs([e for e, _ in found]), np.array([s for _, s in found])
        print(
            f"{name}: median focal error {100 * np.median(sizes):.2f} %, rms {100 * np.sqrt(np.mean(sizes**2)):.2f} %, "
            f"normalised error {np.sqrt(np.mean(in_sds**2)):.2f}, {len(found)} clips"
        )


if __name__ == "__main__":
    main()
