"""A result folder of `roadplane run`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
import pandas as pd

from roadplane import tables
from roadplane.camera import Camera, View
from roadplane.extras import extra

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

CAMERA_SCHEMA = "roadplane.camera/1"


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A finished run.

    Attributes:
        folder: the result folder.
        cameras: one camera per time interval, in order; more than one if the camera was moved. A row's `segment` is an
            index into it.
        summary: contents of `summary.json`: versions, configuration, counts, warnings.
        views: the view of each frame whose picture is displaced, by frame; empty if the camera was at rest.
    """

    folder: Path
    cameras: tuple[Camera, ...]
    summary: dict[str, Any]
    views: dict[int, View] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Returns the folder and the number of cameras."""
        count = len(self.cameras)
        return f"Run({str(self.folder)!r}, {count} camera{'s' if count != 1 else ''})"

    @property
    def camera(self) -> Camera:
        """Returns the camera of the longest interval."""
        return max(self.cameras, key=lambda camera: camera.span_s[1] - camera.span_s[0])

    def view(self, frame: int) -> View:
        """Returns the view of a frame: how its picture lies on the picture that `cameras` describe."""
        return self.views.get(frame) or View(np.eye(3))

    @overload
    def tracks(self, library: Literal["pandas"] = ...) -> pd.DataFrame: ...
    @overload
    def tracks(self, library: Literal["polars"]) -> pl.DataFrame: ...
    def tracks(self, library: Literal["pandas", "polars"] = "pandas") -> pd.DataFrame | pl.DataFrame:
        """Reads the tracks: a row per vehicle and frame, sorted by frame, then track.

        Units are SI, angles are in radians. `roadplane schemas tracks` describes every column:

        - `frame`, `time_s`, `track`, `segment`, `class`, `score`.
        - On the ground: `x_m`, `y_m`, `heading_rad` (0 along +x, counter-clockwise), `speed_mps` (negative in reverse).
        - `ground`, `z_m`: number of the plane of the ground, and the height above the first plane; 0 if there is one.
        - Their standard deviations: `x_sd_m`, `y_sd_m`, `heading_sd_rad`, `speed_sd_mps`. `x_own_sd_m` and
          `y_own_sd_m` are the part that this track does not share with others.
        - `length_m`, `width_m`, `height_m`, and the box `bbox_x0_px`, `bbox_y0_px`, `bbox_x1_px`, `bbox_y1_px`.
        - `observed`: False if the vehicle was not detected in this frame and the row was interpolated.
        - `activity`, `activity_p`.
        - `exists_p`: probability that the track is a vehicle.
        - `same_vehicle_p`: where a track was joined over a gap, the probability that both sides show the same vehicle.

        It reads `tracks.parquet` if the file exists, else `tracks.csv`. Columns and types are the same.

        Args:
            library: library of the data frame. Polars is an extra: `pip install 'roadplane[polars]'`.
        """
        return tables.tracks_pandas(self.folder) if library == "pandas" else tables.tracks_polars(self.folder)

    @overload
    def poses(self, library: Literal["pandas"] = ...) -> pd.DataFrame: ...
    @overload
    def poses(self, library: Literal["polars"]) -> pl.DataFrame: ...
    def poses(self, library: Literal["pandas", "polars"] = "pandas") -> pd.DataFrame | pl.DataFrame:
        """Reads `poses.jsonl`: a row per vehicle and frame with keypoints.

        Units are SI, angles are in radians. Tracks smooth these poses over time.

        - `frame`, `time_s`, `car` (index of the vehicle in its frame), `track` (missing for a vehicle without a track).
        - `class`, `score`, and the box `bbox_x0_px`, `bbox_y0_px`, `bbox_x1_px`, `bbox_y1_px`.
        - In the world: `x_m`, `y_m`, `heading_rad`, and their standard deviations `x_sd_m`, `y_sd_m`, `heading_sd_rad`
          (infinite if unknown).
        - `length_m`, `width_m`, `height_m`, and `shape`: 6 coefficients, each in units of its standard deviation.
        - `reprojection_rms_px`: root mean square of the residuals of the keypoints.
        - `used`: whether the pose is good enough for tracking.
        - `pose_from_frame`, `pose_from_car`: set if the pose was carried over from a vehicle of an earlier frame.
        - `world_from_car`, `camera_from_car`: [4, 4] rigid motions, as lists of rows.
        - `keypoints_px`: a list of `[x, y, score, sd]` or None, one per keypoint.

        Args:
            library: library of the data frame.
        """
        return tables.poses_pandas(self.folder) if library == "pandas" else tables.poses_polars(self.folder)

    @overload
    def events(self, library: Literal["pandas"] = ...) -> pd.DataFrame: ...
    @overload
    def events(self, library: Literal["polars"]) -> pl.DataFrame: ...
    def events(self, library: Literal["pandas", "polars"] = "pandas") -> pd.DataFrame | pl.DataFrame:
        """Reads the activities of the vehicles: a row per event, empty if the run did not label activities.

        Columns: `track`, `activity`, `from_s`, `to_s`, `confidence`.

        Args:
            library: library of the data frame.
        """
        return tables.events_pandas(self.folder) if library == "pandas" else tables.events_polars(self.folder)

    def plot_birds_eye(self, ax: Axes | None = None, segment: int = 0) -> Axes:
        """Draws all trajectories from above, in metres, with each vehicle's last footprint, the camera and its view.

        It needs matplotlib: `pip install 'roadplane[plot]'`.

        Args:
            ax: axes to draw into; by default those of a new figure.
            segment: index of the camera; each has a world of its own.
        """
        extra("matplotlib", "plot")
        draw: Callable[..., Axes] = import_module("roadplane.birds_eye").draw
        return draw(self, ax, segment)

    def to_rerun(self, path: str | PathLike[str], video: str | PathLike[str] | None = None) -> Path:
        """Writes a recording for Rerun's viewer: boxes in 3D and in the picture, the camera, speeds over time.

        It needs Rerun: `pip install 'roadplane[rerun]'`.

        Args:
            path: file to write, `.rrd`. The file appears when it is complete.
            video: video of the run, an MP4 file. The recording then also has the frames of the video.

        Returns:
            The same path.

        Raises:
            ValueError: `video` is not an MP4 file, or its frames do not have the times of the run.
        """
        extra("rerun")
        record: Callable[[Run, Path, Path | None], None] = import_module("roadplane.recording").record
        record(self, Path(path), None if video is None else Path(video))
        return Path(path)


def load(folder: str | PathLike[str]) -> Run:
    """Reads a result folder: `DIR/<stem>` of `roadplane run … --out DIR`.

    Raises:
        FileNotFoundError: the folder is not that of a finished run.
        ValueError: its `camera.json` has another version.
    """
    folder = Path(folder)
    summary = folder / "summary.json"
    if not summary.is_file():
        raise FileNotFoundError(f"{folder} is no finished run: it has no summary.json")
    camera = json.loads((folder / "camera.json").read_text(encoding="utf-8"))
    if camera["schema"] != CAMERA_SCHEMA:
        raise ValueError(f"schema is {camera['schema']!r}, expected {CAMERA_SCHEMA!r}: {folder / 'camera.json'}")
    # In older versions, a file with one interval has its camera at the top level only.
    segments = camera.get("segments") or [camera]
    cameras = tuple(Camera.from_json(segment) for segment in segments)
    views = {row["frame"]: _view(row, cameras) for row in camera.get("motion", [])}
    return Run(folder, cameras, json.loads(summary.read_text(encoding="utf-8")), views)


def _view(row: Mapping[str, Any], cameras: tuple[Camera, ...]) -> View:
    """Reads an entry of `motion` of `camera.json`."""
    begun = [camera for camera in cameras if camera.span_s[0] <= row["time_s"]]
    return View(np.append(row["picture_from_world"], 1.0).reshape(3, 3), (begun or list(cameras))[-1])
