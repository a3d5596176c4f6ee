"""Measures runs on clips that are made to move, against the same clips at rest.

  .runtime/train/bin/python scripts/eval/motion.py CLIP:FOCAL[:START_S:SECONDS] … --work DIR

Each clip is filmed by a camera that turns or zooms about its centre. The film shows the middle 68 % of the picture.
Every frame is warped by K R K⁻¹ with the focal length FOCAL, px. The script needs ffmpeg. Columns of the table:

  tracks: number of tracks.

  observed: share of the observed rows at rest that are also observed with motion. Rows out of its view do not count.

  place: rms distance of the matched rows on the ground. Within 60 m it is in m, beyond 60 m a multiple of their sds.

  focal: difference of the focal lengths, as a multiple of the sd at rest.

  CPU: CPU time per frame, as a multiple of that at rest with detection on the whole of each frame.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np

SHARE = 0.68  # of the picture's width that is filmed
MIN_IOU = 0.3
NEAR_M = 60.0
IN_VIEW = 0.95  # least share of a box inside the picture


def angles(motion: str, t: float, seconds: float, px: float, mirrored: bool) -> tuple[float, float, float, float]:
    """Returns pan, tilt, roll (rad) and growth at a time. `px` is the angle of a pixel."""
    direction = -1.0 if mirrored else 1.0
    phase = 1.0 if mirrored else 0.0
    wave = lambda period: math.sin(2 * math.pi * t / period + phase)  # noqa: E731
    return {
        "rest": (0.0, 0.0, 0.0, 1.0),
        "sway3": (3 * px * wave(1.5), 2 * px * wave(1.1), 0.0, 1.0),
        "sway12": (12 * px * wave(3.7), 5 * px * wave(2.3), 0.004 * wave(3.1), 1.0),
        "shake": (2 * px * wave(0.125), 1.5 * px * wave(0.14), 0.0, 1.0),
        "drift": (direction * 3 * px * (t - seconds / 2), 1.5 * px * (t - seconds / 2), 0.0, 1.0),
        "pan": (direction * 8.5 * px * (t - seconds / 2), 0.0, 0.0, 1.0),
        "zoom": (0.0, 0.0, 0.0, 1 + 0.25 * (1 - t / seconds if mirrored else t / seconds)),
    }[motion]


MOTIONS = ["sway3", "sway12", "shake", "drift", "pan", "zoom"]


def picture_from_clip(turn: tuple[float, float, float, float], focal: float, size: tuple[int, int]) -> np.ndarray:
    """Returns the homography from pixels of the clip to pixels of the filmed picture."""
    pan, tilt, roll, growth = turn
    ca, sa, cb, sb, cr, sr = (
        *(f(pan) for f in (math.cos, math.sin)),
        *(f(tilt) for f in (math.cos, math.sin)),
        *(f(roll) for f in (math.cos, math.sin)),
    )
    rotation = (
        np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
        @ np.array([[1, 0, 0], [0, cb, -sb], [0, sb, cb]])
        @ np.array([[ca, 0, sa], [0, 1, 0], [-sa, 0, ca]])
    )
    middle = [(length - 1) / 2 for length in size]
    k0 = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1.0]])
    filmed = focal / SHARE * growth
    k1 = np.array([[filmed, 0, middle[0]], [0, filmed, middle[1]], [0, 0, 1.0]])
    return k1 @ rotation @ np.linalg.inv(k0)


class Clip:
    """A clip, and the part of it that is filmed."""

    def __init__(self, text: str, mirrored: bool) -> None:
        path, focal, *span = text.split(":")
        self.path, self.focal, self.mirrored = Path(path), float(focal), mirrored
        self.start_s, self.seconds = (float(v) for v in span) if span else (0.0, 12.0)
        clip = cv2.VideoCapture(path)
        self.fps = clip.get(cv2.CAP_PROP_FPS)
        self.size = int(clip.get(cv2.CAP_PROP_FRAME_WIDTH)), int(clip.get(cv2.CAP_PROP_FRAME_HEIGHT))

    def homography(self, motion: str, frame: int) -> np.ndarray:
        """Returns the homography from the clip to a frame."""
        turn = angles(motion, frame / self.fps, self.seconds, SHARE / self.focal, self.mirrored)
        return picture_from_clip(turn, self.focal, self.size)

    def film(self, motion: str, out: Path) -> None:
        """Writes the clip as the moving camera films it."""
        clip = cv2.VideoCapture(str(self.path))
        clip.set(cv2.CAP_PROP_POS_MSEC, 1000 * self.start_s)
        size = f"{self.size[0]}x{self.size[1]}"
        raw = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", size, "-r", str(self.fps), "-i", "-"]
        coded = ["-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p", str(out)]
        ffmpeg = subprocess.Popen(["ffmpeg", "-loglevel", "error", "-y", *raw, *coded], stdin=subprocess.PIPE)
        for frame in range(int(self.seconds * self.fps)):
            is_read, picture = clip.read()
            if not is_read:
                break
            if self.mirrored:
                picture = picture[:, ::-1]
            warped = cv2.warpPerspective(picture, self.homography(motion, frame), self.size, flags=cv2.INTER_CUBIC)
            ffmpeg.stdin.write(warped.tobytes())
        ffmpeg.stdin.close()
        ffmpeg.wait()


def iou(a: np.ndarray, b: np.ndarray) -> float:
    """Returns the intersection over union of two boxes."""
    width, height = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    common = max(width, 0.0) * max(height, 0.0)
    return common / (np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - common)


def mapped(box: np.ndarray, homography: np.ndarray) -> np.ndarray:
    """Returns the box around the middles of a box's edges in another picture."""
    x0, y0, x1, y1 = box
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    points = homography @ np.array([[x0, y, 1], [x1, y, 1], [x, y0, 1], [x, y1, 1]]).T
    points = points[:2] / points[2]
    return np.array([points[0].min(), points[1].min(), points[0].max(), points[1].max()])


def rows_of(run: Path) -> dict[int, list[dict]]:
    """Returns the rows of a run by frame."""
    rows = defaultdict(list)
    for line in (run / "tracks.jsonl").open():
        row = json.loads(line)
        rows[row["frame"]].append(row)
    return rows


def compare(clip: Clip, motion: str, rest: Path, moved: Path) -> dict[str, float]:
    """Compares the run on the moving clip with that at rest."""
    at_rest, moving = rows_of(rest), rows_of(moved)
    width, height = clip.size
    in_view = found = 0
    pairs = []
    for frame, rows in at_rest.items():
        change = clip.homography(motion, frame) @ np.linalg.inv(clip.homography("rest", frame))
        for row in rows:
            box = mapped(np.array(row["bbox_px"]), change)
            inside = np.clip(box, 0, [width - 1, height - 1] * 2)
            if not row["observed"] or np.prod(inside[2:] - inside[:2]) < IN_VIEW * np.prod(box[2:] - box[:2]):
                continue
            best = max(moving[frame], key=lambda other: iou(box, np.array(other["bbox_px"])), default=None)
            in_view += 1
            if best and iou(box, np.array(best["bbox_px"])) >= MIN_IOU:
                found += best["observed"] or any(r["observed"] for r in near(moving, best))
                pairs.append((row, best))
    place = lambda row: np.array([row["x_m"], row["y_m"]])  # noqa: E731
    here, there = (np.array([place(pair[i]) for pair in pairs]) for i in (0, 1))
    # The axes of the moving camera are those of its first picture: turned about the camera.
    turn = np.angle(np.sum((here[:, 0] + 1j * here[:, 1]) * np.conj(there[:, 0] + 1j * there[:, 1])))
    turned = there @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    away = np.linalg.norm(turned - here, axis=1)
    is_near = np.linalg.norm(here, axis=1) <= NEAR_M
    sds = np.array([math.hypot(a["x_sd_m"], a["y_sd_m"]) for a, _ in pairs])
    rms = lambda values: float(np.sqrt(np.mean(values**2))) if len(values) else math.nan  # noqa: E731
    cameras = [json.loads((run / "camera.json").read_text()) for run in (rest, moved)]
    first = angles(motion, 0.0, clip.seconds, SHARE / clip.focal, clip.mirrored)[3]
    return {
        "observed": found / max(in_view, 1),
        "place_m": rms(away[is_near]),
        "place_sds": rms((away / sds)[~is_near]),
        "focal_sds": (cameras[1]["focal_px"] / first - cameras[0]["focal_px"]) / cameras[0]["focal_sd_px"],
    }


def near(rows: dict[int, list[dict]], row: dict) -> list[dict]:
    """Returns the rows of a track within two frames of one of its rows; the keypoint net runs on every third frame."""
    frames = range(row["frame"] - 2, row["frame"] + 3)
    return [other for frame in frames for other in rows.get(frame, []) if other["track"] == row["track"]]


def main() -> None:
    """Films, runs and compares each clip."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="+")
    parser.add_argument("--work", type=Path, required=True, help="folder for the clips and the results")
    parser.add_argument("--program", default="target/release/roadplane")
    parser.add_argument("--motions", nargs="*", default=MOTIONS, choices=MOTIONS)
    parser.add_argument("--mirrored", action="store_true", help="mirror the clips, with other phases and directions")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    print("| clip | motion | tracks | observed | place < 60 m | beyond, sds | focal, sds | not followed | CPU |")
    print("|---|---|---|---|---|---|---|---|---|")
    for clip in (Clip(text, options.mirrored) for text in options.clips):
        name = clip.path.stem + ("_mirrored" if options.mirrored else "")
        base = None
        for motion in ["rest", *options.motions]:
            film = options.work / f"{name}_{motion}.mp4"
            clip.film(motion, film)
            runs = [("runs", [])] + ([("full", ["--set", "watch.attention=false"])] if motion == "rest" else [])
            for folder, extra in runs:
                command = [options.program, "run", film, "--out", options.work / folder, "--overwrite", *extra]
                subprocess.run(command, check=False, capture_output=True)
            run, rest = (options.work / "runs" / f"{name}_{m}" for m in (motion, "rest"))
            summary = json.loads((run / "summary.json").read_text())
            cpu = summary["speed"]["cpu_ms_per_frame"]["total"]
            if motion == "rest":
                full = json.loads((options.work / "full" / run.name / "summary.json").read_text())
                base = full["speed"]["cpu_ms_per_frame"]["total"]
            result = compare(clip, motion, rest, run)
            print(
                f"| {name} | {motion} | {summary['counts']['tracks']} | {100 * result['observed']:.1f} % "
                f"| {result['place_m']:.2f} m | {result['place_sds']:.2f} | {result['focal_sds']:+.2f} "
                f"| {summary['counts']['frames_not_followed']} | {cpu / base:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
