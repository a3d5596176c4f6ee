"""A finished run as a Rerun recording (.rrd)."""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
from pathlib import Path

import numpy as np
import rerun as rr


def colour(track: int) -> tuple[int, int, int]:
    """One that neighbours do not share."""
    hue = track * 0.618 % 1 * 2 * math.pi
    return tuple(int(155 + 95 * math.cos(hue - shift)) for shift in (0, 2.1, 4.2))


def log_camera(camera: dict) -> None:
    """The camera as it stood, in a world with z up."""
    normal = np.array(camera["plane_in_camera"]["normal"])
    forward = np.array([0, 0, 1]) - normal * normal[2]
    forward /= np.linalg.norm(forward)
    world_from_camera = np.stack([np.cross(forward, normal), forward, normal])
    rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rr.log("world/camera", rr.Transform3D(translation=[0, 0, camera["height_m"]], mat3x3=world_from_camera), static=True)
    pinhole = rr.Pinhole(focal_length=camera["focal_px"], resolution=camera["image_size_px"],
                         principal_point=np.array(camera["principal_point_px"]) + 0.5)
    rr.log("world/camera/picture", pinhole, static=True)


def log_row(row: dict[str, str]) -> None:
    """A car in a frame; what is filled in between looks is drawn paler."""
    number = {name: float(value) for name, value in row.items() if name.endswith(("_m", "_rad", "_mps", "_px", "_s"))}
    track = int(row["track"])
    rr.set_time("frame", sequence=int(row["frame"]))
    rr.set_time("time", duration=number["time_s"])
    paint = (*colour(track), 255 if row["observed"] == "true" else 110)
    length, width, height = (number[name] for name in ("length_m", "width_m", "height_m"))
    turn = rr.Quaternion(xyzw=[0, 0, math.sin(number["heading_rad"] / 2), math.cos(number["heading_rad"] / 2)])
    rr.log(f"world/cars/{track}", rr.Boxes3D(centers=[[number["x_m"], number["y_m"], height / 2]],
                                           sizes=[[length, width, height]], quaternions=[turn], colors=[paint]))
    corners = [[number["bbox_x0_px"], number["bbox_y0_px"], number["bbox_x1_px"], number["bbox_y1_px"]]]
    rr.log(f"world/camera/picture/{track}", rr.Boxes2D(array=np.array(corners) + 0.5, array_format=rr.Box2DFormat.XYXY,
                                                     colors=[paint]))
    rr.log(f"speed_mps/{track}", rr.Scalars(number["speed_mps"]))


def main() -> None:
    """Writes the recording under its name once it is whole."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("out", type=Path, help="file to write, .rrd")
    args = parser.parse_args()
    unfinished = args.out.with_name(f".{args.out.name}.tmp")
    with rr.RecordingStream("roadplane", recording_id=args.run.name) as recording:
        recording.save(unfinished)
        log_camera(json.loads((args.run / "camera.json").read_text()))
        last: dict[str, int] = {}
        with (args.run / "tracks.csv").open(newline="") as tracks:
            for row in csv.DictReader(tracks):
                log_row(row)
                last[row["track"]] = int(row["frame"])
        for track, frame in last.items():
            rr.set_time("frame", sequence=frame + 1)
            for path in (f"world/cars/{track}", f"world/camera/picture/{track}"):
                rr.log(path, rr.Clear(recursive=False))
    os.replace(unfinished, args.out)


if __name__ == "__main__":
    main()
