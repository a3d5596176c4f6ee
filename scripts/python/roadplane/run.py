"""A result folder of `roadplane run`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import pandas as pd

from roadplane.camera import Camera

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

CAMERA_SCHEMA = "roadplane.camera/1"
EVENT_COLUMNS = ["track", "activity", "from_s", "to_s", "confidence"]


@dataclass(frozen=True, eq=False)
class Run:
    """What a run found.

    Attributes:
        folder: the result folder.
        cameras: one a stretch of time, in order; more than one where the camera was moved. A row's `segment` is its index.
        summary: `summary.json`: versions, configuration, counts, warnings.
    """

    folder: Path
    cameras: tuple[Camera, ...]
    summary: dict[str, Any]

    @property
    def camera(self) -> Camera:
        """The camera of the longest stretch of time."""
        return max(self.cameras, key=lambda camera: camera.span_s[1] - camera.span_s[0])

    @overload
    def tracks(self, library: Literal["pandas"] = ...) -> pd.DataFrame: ...
    @overload
    def tracks(self, library: Literal["polars"]) -> pl.DataFrame: ...
    def tracks(self, library: Literal["pandas", "polars"] = "pandas") -> pd.DataFrame | pl.DataFrame:
        """A row per car and frame, by frame, then track.

        Columns, SI units (all of them: `roadplane schemas tracks`): `frame`, `time_s`, `track`; `x_m`, `y_m`, `heading_rad` (0
        along +x, counter-clockwise) and `speed_mps` (negative when reversing) on the ground, their sds `x_sd_m`, `y_sd_m`,
        `heading_sd_rad`, `speed_sd_mps`, and of these the track's own part, `x_own_sd_m`, `y_own_sd_m`; `length_m`,
        `width_m`, `height_m`; `bbox_x0_px` … `bbox_y1_px`; `score`, `observed` (False: filled in between looks), `class`,
        `segment`, `activity`, `activity_p`.

        Args:
            library: whose data frame; polars is an extra, `pip install 'roadplane[polars]'`.
        """
        path = self.folder / "tracks.csv"
        if library == "pandas":
            return pd.read_csv(path)
        table: pl.DataFrame = _extra("polars").read_csv(path, infer_schema_length=None)
        return table

    @overload
    def events(self, library: Literal["pandas"] = ...) -> pd.DataFrame: ...
    @overload
    def events(self, library: Literal["polars"]) -> pl.DataFrame: ...
    def events(self, library: Literal["pandas", "polars"] = "pandas") -> pd.DataFrame | pl.DataFrame:
        """What cars did, an event a row: `track`, `activity`, `from_s`, `to_s`, `confidence`. Empty where the run did not look.

        Args:
            library: whose data frame.
        """
        path = self.folder / "activities.jsonl"
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        table = pd.DataFrame([json.loads(line) for line in lines], columns=EVENT_COLUMNS)
        if library == "pandas":
            return table
        columns: pl.DataFrame = _extra("polars").DataFrame(table.to_dict("list"))
        return columns

    def plot_birds_eye(self, ax: Axes | None = None, segment: int = 0) -> Axes:
        """Ways of all tracks from above, the last place of each as a footprint, the camera and what it sees; metres.

        Needs matplotlib: `pip install 'roadplane[plot]'`.

        Args:
            ax: where to draw; a new figure's if it is left out.
            segment: index of the stretch of time; each has a world of its own.
        """
        _extra("matplotlib", "plot")
        draw: Callable[..., Axes] = import_module("roadplane.birds_eye").draw
        return draw(self, ax, segment)

    def to_rerun(self, path: str | PathLike[str]) -> Path:
        """Writes a recording for Rerun's viewer: cars as boxes in 3D and in the picture, the camera, speeds over time.

        Needs Rerun: `pip install 'roadplane[rerun]'`.

        Args:
            path: file to write, `.rrd`; it appears once it is whole.

        Returns:
            The same path.
        """
        _extra("rerun")
        record: Callable[[Run, Path], None] = import_module("roadplane.recording").record
        record(self, Path(path))
        return Path(path)


def load(folder: str | PathLike[str]) -> Run:
    """Reads a result folder, `DIR/<stem>` of `roadplane run … --out DIR`.

    Raises:
        FileNotFoundError: it is no finished run.
        ValueError: its `camera.json` is of another version.
    """
    folder = Path(folder)
    summary = folder / "summary.json"
    if not summary.is_file():
        raise FileNotFoundError(f"{folder} is no finished run: it has no summary.json")
    camera = json.loads((folder / "camera.json").read_text(encoding="utf-8"))
    if camera["schema"] != CAMERA_SCHEMA:
        raise ValueError(f"schema is {camera['schema']!r}, expected {CAMERA_SCHEMA!r}: {folder / 'camera.json'}")
    # Files of older versions with one stretch of time have it on top only.
    segments = camera.get("segments") or [camera]
    cameras = tuple(Camera.from_json(segment) for segment in segments)
    return Run(folder, cameras, json.loads(summary.read_text(encoding="utf-8")))


def _extra(module: str, extra: str | None = None) -> Any:
    try:
        return import_module(module)
    except ImportError as missing:
        raise ImportError(f"{module} is not installed: pip install 'roadplane[{extra or module}]'") from missing
