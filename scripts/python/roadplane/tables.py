"""Files of a result folder as data frames: `tracks.parquet` or `tracks.csv`, `poses.jsonl`, `activities.jsonl`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from roadplane.extras import extra

if TYPE_CHECKING:
    import polars as pl

EVENT_COLUMNS = ["track", "activity", "from_s", "to_s", "confidence"]
BOX_COLUMNS = ["bbox_x0_px", "bbox_y0_px", "bbox_x1_px", "bbox_y1_px"]
# Integer columns of poses that may be missing.
POSE_INTEGERS = ["track", "pose_from_frame", "pose_from_car"]
POSE_COLUMNS = [
    *("frame", "time_s", "car", "track", "class", "score", *BOX_COLUMNS),
    *("x_m", "y_m", "heading_rad", "x_sd_m", "y_sd_m", "heading_sd_rad", "length_m", "width_m", "height_m"),
    *("reprojection_rms_px", "used", "pose_from_frame", "pose_from_car"),
    *("shape", "world_from_car", "camera_from_car", "keypoints_px"),
]


def tracks_pandas(folder: Path) -> pd.DataFrame:
    """Reads the tracks into pandas. Both files give the same columns and types."""
    path = folder / "tracks.parquet"
    if not path.is_file():
        return pd.read_csv(folder / "tracks.csv").astype({"observed": bool})
    table = pd.read_parquet(path)
    corners = np.vstack([np.empty((0, 4)), *table["bbox_px"]])
    at = list(table.columns).index("bbox_px")
    for i, name in enumerate(BOX_COLUMNS):
        table.insert(at + i, name, corners[:, i])
    table = table.drop(columns="bbox_px")
    # As read_csv types them: a missing text is NaN, a column without values holds numbers, an empty table has no types.
    for name in table.columns:
        if table.empty:
            table[name] = table[name].astype(object)
        elif table[name].isna().all():
            table[name] = np.nan
        elif table[name].dtype == object:
            table[name] = table[name].where(table[name].notna(), np.nan)
    # A mask without rows keeps the columns only if it is boolean.
    return table.astype({"observed": bool})


def tracks_polars(folder: Path) -> pl.DataFrame:
    """Reads the tracks into polars. Both files give the same columns and types."""
    polars = extra("polars")
    path = folder / "tracks.parquet"
    if not path.is_file():
        names = polars.read_csv(folder / "tracks.csv", n_rows=0).columns
        types = dict.fromkeys(names, polars.Float64) | dict.fromkeys(("class", "activity", "utm_zone"), polars.String)
        types |= dict.fromkeys(("frame", "track", "segment", "ground"), polars.Int64) | {"observed": polars.Boolean}
        csv: pl.DataFrame = polars.read_csv(folder / "tracks.csv", schema_overrides={name: types[name] for name in names})
        return csv
    table: pl.DataFrame = polars.read_parquet(path)
    corners = [polars.col("bbox_px").list.get(i).alias(name) for i, name in enumerate(BOX_COLUMNS)]
    at = table.columns.index("bbox_px")
    return table.select([*table.columns[:at], *corners, *table.columns[at + 1 :]])


def poses_pandas(folder: Path) -> pd.DataFrame:
    """Reads `poses.jsonl` into pandas; integers that may be missing have the type Int64."""
    table = pd.DataFrame(_poses(folder), columns=POSE_COLUMNS)
    return table.astype(dict.fromkeys(POSE_INTEGERS, "Int64"))


def poses_polars(folder: Path) -> pl.DataFrame:
    """Reads `poses.jsonl` into polars."""
    polars = extra("polars")
    integers = dict.fromkeys([*POSE_INTEGERS, "frame", "car"], polars.Int64)
    matrix = polars.List(polars.List(polars.Float64))
    lists = {"shape": polars.List(polars.Float64)}
    lists |= dict.fromkeys(("world_from_car", "camera_from_car", "keypoints_px"), matrix)
    others = {"class": polars.String, "used": polars.Boolean}
    schema = {name: (integers | lists | others).get(name, polars.Float64) for name in POSE_COLUMNS}
    table: pl.DataFrame = polars.DataFrame(_poses(folder), schema=schema)
    return table


def events_pandas(folder: Path) -> pd.DataFrame:
    """Reads `activities.jsonl` into pandas."""
    return pd.DataFrame(_lines(folder / "activities.jsonl"), columns=EVENT_COLUMNS)


def events_polars(folder: Path) -> pl.DataFrame:
    """Reads `activities.jsonl` into polars."""
    table: pl.DataFrame = extra("polars").DataFrame(events_pandas(folder).to_dict("list"))
    return table


def _lines(path: Path) -> list[dict[str, Any]]:
    """Returns the records of a file of JSON lines, none if there is no such file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def _poses(folder: Path) -> list[dict[str, Any]]:
    return [_pose(record) for record in _lines(folder / "poses.jsonl")]


def _pose(record: dict[str, Any]) -> dict[str, Any]:
    """Returns a line of `poses.jsonl` with its short lists as columns."""
    row = {name: value for name, value in record.items() if name in POSE_COLUMNS}
    row |= zip(BOX_COLUMNS, record["bbox_px"], strict=True)
    motion = record["world_from_car"]
    row |= {"x_m": motion[0][3], "y_m": motion[1][3], "heading_rad": math.atan2(motion[1][0], motion[0][0])}
    sds = (math.inf if sd is None else sd for sd in record["pose_sd"])
    row |= zip(("x_sd_m", "y_sd_m", "heading_sd_rad"), sds, strict=True)
    row |= zip(("length_m", "width_m", "height_m"), record["dims_m"], strict=True)
    row |= zip(("pose_from_frame", "pose_from_car"), record.get("pose_from") or (None, None), strict=True)
    return row
