"""Compares a run on a filmed copy with the filmed scene.

  roadplane-train render copy-loop SCENE RUN --camera side

Estimated trajectories are fitted to the true ones by one similarity (rotation, translation, scale) for the whole clip,
as an uncalibrated camera leaves these free.
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np

from .copy import View, fitted_keypoints, view_of

NEAR_M = 3.0  # distance from a true vehicle for a match
LEAST_PX, LEAST_SHARE = 30.0, 0.9  # vehicles that must be found: larger side, and its share inside the picture
LEAST_S = 1.0  # duration of that
Rows = dict[int, np.ndarray]  # by vehicle: time, x, y, heading [n, 4]


def truth(scene: dict, view: View, times: np.ndarray) -> tuple[Rows, Rows]:
    """Returns all vehicles in the filming camera's world at given times, and those that are well visible."""
    everything, seen = {}, {}
    for vehicle in scene["vehicles"]:
        trajectory = np.array([[v["time_s"], v["x_m"], v["y_m"], v["heading_rad"]] for v in vehicle["trajectory"]])
        there = times[(times >= vehicle["span_s"][0]) & (times <= vehicle["span_s"][1])]
        poses = [view.place(*(float(np.interp(t, trajectory[:, 0], trajectory[:, i])) for i in (1, 2, 3))) for t in there]
        rows = np.array([[t, *p[:2, 3], np.arctan2(p[1, 0], p[0, 0])] for t, p in zip(there, poses, strict=True)]).reshape(-1, 4)
        everything[vehicle["track"]] = rows
        points = fitted_keypoints(vehicle["shape"])
        well = [_well_seen(view, pose, points) for pose in poses]
        if sum(well) and len(times) > 1 and sum(well) * (times[1] - times[0]) >= LEAST_S:
            seen[vehicle["track"]] = rows[np.array(well)]
    return everything, seen


def _well_seen(view: View, pose: np.ndarray, points: np.ndarray) -> bool:
    pixels, depth = view.camera.pixel_from_world(points @ pose[:3, :3].T + pose[:3, 3])
    if depth.min() < 1:
        return False
    inside = ((pixels > 0) & (pixels < view.camera.image_size_px)).all(1).mean()
    return inside >= LEAST_SHARE and np.ptp(pixels, axis=0).max() >= LEAST_PX


def found(run: Path, span_s: tuple[float, float]) -> Rows:
    """Returns the observed rows of a run by track, within the time of one camera."""
    tracks: dict[int, list] = {}
    with (run / "tracks.csv").open(newline="") as table:
        for row in csv.DictReader(table):
            if row["observed"] == "true" and span_s[0] <= float(row["time_s"]) <= span_s[1]:
                tracks.setdefault(int(row["track"]), []).append(
                    [float(row[name]) for name in ("time_s", "x_m", "y_m", "heading_rad")]
                )
    return {track: np.array(rows) for track, rows in tracks.items()}


def pairs(true: Rows, ours: Rows, scale: float, step_s: float) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Yields vehicle, true rows and ours at the same times, for each track that stays near one vehicle."""
    matched = []
    for rows in ours.values():
        best = None
        for vehicle, trajectory in true.items():
            index = np.abs(trajectory[:, None, 0] - rows[None, :, 0]).argmin(0) if len(trajectory) else []
            if len(trajectory) == 0:
                continue
            same = trajectory[index]
            together = np.abs(same[:, 0] - rows[:, 0]) < step_s / 2
            apart = np.linalg.norm(same[together, 1:3] - scale * rows[together, 1:3], axis=1)
            if together.sum() >= 3 and (best is None or np.median(apart) < best[0]):
                best = np.median(apart), vehicle, same[together], rows[together]
        if best is not None and best[0] < NEAR_M:
            matched.append(best[1:])
    return matched


def fitted(true: np.ndarray, ours: np.ndarray) -> tuple[complex, complex]:
    """Returns rotation and scale, and translation, in the complex plane (Umeyama 1991)."""
    z, w = ours @ [1, 1j], true @ [1, 1j]
    turn = np.vdot(z - z.mean(), w - w.mean()) / np.vdot(z - z.mean(), z - z.mean())
    return turn, w.mean() - turn * z.mean()


def report(name: str, matched: list[tuple[int, np.ndarray, np.ndarray]]) -> None:
    """Prints the deviation of rows from the truth after the fit."""
    if not matched:
        return
    true, ours = (np.concatenate([pair[i] for pair in matched]) for i in (1, 2))
    turn, shift = fitted(true[:, 1:3], ours[:, 1:3])
    error = np.abs(turn * (ours[:, 1:3] @ [1, 1j]) + shift - true[:, 1:3] @ [1, 1j])
    heading = np.degrees(np.abs(np.angle(np.exp(1j * (ours[:, 3] + np.angle(turn) - true[:, 3])))))
    right = heading[heading < 90]
    print(
        f"{name}: position rms {np.sqrt(np.mean(error**2)):.3f} m, median {np.median(error):.3f} m over {len(error)} rows; "
        f"scale {abs(turn):.4f}; heading rms {np.sqrt(np.mean(right**2)):.2f}° without {len(heading) - len(right)} rows that "
        f"have the opposite direction"
    )


def main() -> None:
    """Prints one line per measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder that roadplane copy wrote")
    parser.add_argument("run", type=Path, help="folder of the run on the filmed clip")
    parser.add_argument("--camera", default="same", help="camera of the filmed clip")
    args = parser.parse_args()
    scene = json.loads((args.scene / "scene.json").read_text())
    view = view_of(args.camera, scene)
    camera = json.loads((args.run / "camera.json").read_text())
    # If the run found that the camera moved, each segment has its own world: the longest is measured.
    ours = found(args.run, camera["span_s"])
    times = np.unique(np.concatenate([rows[:, 0] for rows in ours.values()]))
    true, seen = truth(scene, view, times)
    step_s = float(np.median(np.diff(times)))
    matched = pairs(true, ours, view.camera.height_m / camera["height_m"], step_s)
    if not matched:
        raise SystemExit("no track of the run is near a vehicle of the scene")
    vehicles = {pair[0] for pair in matched}
    print(
        f"found: {len(vehicles & seen.keys())} of {len(seen)} well visible vehicles; {len(ours)} tracks, "
        f"{len(matched)} of them near a vehicle; "
        f"{camera['span_s'][0]:.1f}–{camera['span_s'][1]:.1f} s of {times[-1]:.1f}"
    )
    report("all rows", matched)
    report("vehicles that are seen well", [pair for pair in matched if pair[0] in seen])
    print(f"focal length {camera['focal_px']:.0f} ± {camera['focal_sd_px'] or np.inf:.0f} px, true {view.camera.focal_px:.0f}")


if __name__ == "__main__":
    main()
