"""Writes a finished run as a recording for Rerun's viewer: `python -m roadplane.recording RUN FILE.rrd`.

With `--video CLIP`, the recording also has the frames of the run's video."""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from roadplane.camera import Camera, View

if TYPE_CHECKING:
    from roadplane.run import Run


def record(run: Run, path: Path, video: Path | None) -> None:
    """Writes a recording; see `Run.to_rerun`."""
    frames = None if video is None else _frames_of(video, run)
    unfinished = path.with_name(f".{path.name}.tmp")
    with rr.RecordingStream("roadplane", recording_id=run.folder.name) as recording:
        recording.save(unfinished)
        rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if frames is not None:
            _log_video(*frames)
        rows = run.tracks()
        # Each segment has a world of its own; in the recording it begins with its camera.
        for segment, camera in enumerate(run.cameras):
            here = rows[rows["segment"] == segment].to_dict("records")
            _set_time(here[0]["frame"] if here else 0, camera.span_s[0])
            _log_camera(camera, View(np.eye(3)), is_static=len(run.cameras) == 1 and not run.views)
            last = None
            for row in here:
                _set_time(row["frame"], row["time_s"])
                if run.views and row["frame"] != last:
                    last = row["frame"]
                    _log_camera(camera, run.view(last), is_static=False)
                _log_row(row)
        times = rows.drop_duplicates("frame").set_index("frame")["time_s"].sort_index()
        step_s = float(times.diff().median()) if len(times) > 1 else 0.0
        for track, frame in rows.groupby("track")["frame"].max().items():
            _set_time(frame + 1, float(times[frame]) + step_s)
            for entity in (f"world/cars/{track}", f"world/camera/picture/{track}"):
                rr.log(entity, rr.Clear(recursive=False))
    os.replace(unfinished, path)


def _frames_of(video: Path, run: Run) -> tuple[rr.AssetVideo, np.ndarray]:
    """Reads a video and the times of its frames, ns. The frames must have the times that the run has."""
    asset = rr.AssetVideo(path=video)
    try:
        stamps_ns = np.array(asset.read_frame_timestamps_nanos())
    except RuntimeError as error:
        copied = video.with_suffix(".mp4")
        remedy = f"Rerun needs an MP4 file, e.g. by ffmpeg -i {video} -c copy {copied}"
        raise ValueError(f"Rerun cannot read the frames of {video} ({error}): {remedy}") from error
    times_s = (stamps_ns - stamps_ns[0]) / 1e9
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    for frame, time_s in run.tracks()[["frame", "time_s"]].drop_duplicates().itertuples(index=False):
        if frame >= len(times_s):
            raise ValueError(f"{video} is not the video of this run: it has {len(times_s)} frames, and the run has frame {frame}")
        if abs(times_s[frame] - time_s) > step_s / 2:
            is_at = f"frame {frame} is at {times_s[frame]:.3f} s in the video, and at {time_s:.3f} s in the run"
            raise ValueError(f"{video} is not the video of this run: {is_at}")
    return asset, stamps_ns


def _log_video(asset: rr.AssetVideo, stamps_ns: np.ndarray) -> None:
    """Logs a video once, and a reference to it for each frame."""
    entity = "world/camera/picture/video"
    rr.log(entity, asset, static=True)
    frames = rr.TimeColumn("frame", sequence=np.arange(len(stamps_ns)))
    times = rr.TimeColumn("time", duration=(stamps_ns - stamps_ns[0]) / 1e9)
    rr.send_columns(entity, indexes=[frames, times], columns=rr.VideoFrameReference.columns_nanos(stamps_ns))


def _set_time(frame: int, time_s: float) -> None:
    rr.set_time("frame", sequence=frame)
    rr.set_time("time", duration=time_s)


def _log_camera(camera: Camera, view: View, is_static: bool) -> None:
    growth, rotation = view.turn(camera)
    camera_from_world = camera.camera_from_world()
    camera_from_world[:3] = rotation @ camera_from_world[:3]
    world_from_camera = np.linalg.inv(camera_from_world)
    pose = rr.Transform3D(translation=world_from_camera[:3, 3], mat3x3=world_from_camera[:3, :3])
    pinhole = rr.Pinhole(
        focal_length=growth * camera.focal_px,
        resolution=camera.image_size_px,
        principal_point=np.array(camera.principal_point_px) + 0.5,
    )
    rr.log("world/camera", pose, static=is_static)
    rr.log("world/camera/picture", pinhole, static=is_static)


def _log_row(row: dict[Any, Any]) -> None:
    """Logs a car in a frame; interpolated rows have a paler colour."""
    track = row["track"]
    paint = (*_colour(track), 255 if row["observed"] else 110)
    turn = rr.Quaternion(xyzw=[0, 0, math.sin(row["heading_rad"] / 2), math.cos(row["heading_rad"] / 2)])
    rr.log(
        f"world/cars/{track}",
        rr.Boxes3D(
            centers=[[row["x_m"], row["y_m"], row.get("z_m", 0.0) + row["height_m"] / 2]],
            sizes=[[row["length_m"], row["width_m"], row["height_m"]]],
            quaternions=[turn],
            colors=[paint],
        ),
    )
    corners = [[row[f"bbox_{corner}_px"] for corner in ("x0", "y0", "x1", "y1")]]
    rr.log(
        f"world/camera/picture/{track}",
        rr.Boxes2D(array=np.array(corners) + 0.5, array_format=rr.Box2DFormat.XYXY, colors=[paint]),
    )
    rr.log(f"speed_mps/{track}", rr.Scalars(row["speed_mps"]))


def _colour(track: int) -> tuple[int, int, int]:
    """Returns a colour that differs from those of neighbouring numbers."""
    hue = track * 0.618 % 1 * 2 * math.pi
    red, green, blue = (int(155 + 95 * math.cos(hue - shift)) for shift in (0, 2.1, 4.2))
    return red, green, blue


def main() -> None:
    """Writes the recording."""
    from roadplane.run import load

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("out", type=Path, help="file to write, .rrd")
    parser.add_argument("--video", metavar="CLIP", type=Path, help="video of the run, as MP4; the recording gets its frames")
    args = parser.parse_args()
    try:
        record(load(args.run), args.out, args.video)
    except (FileNotFoundError, ValueError) as error:
        parser.exit(1, f"{error}\n")


if __name__ == "__main__":
    main()
