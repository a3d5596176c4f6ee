"""Checks of exports for traffic simulation and traffic analysis: SUMO, NGSIM, highD, SSAM and OTVision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import sumolib
from rows import BOX, by_frame, by_track, close, on_the_axis

FOOT_M = 0.3048


def check_sumo(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with sumolib."""
    types = {t.id: t for t in sumolib.xml.parse(str(folder / f"{name}.vtypes.xml"), "vType")}
    rows = []
    for step in sumolib.xml.parse(str(folder / f"{name}.fcd.xml"), "timestep"):
        rows += [
            (float(step.time), int(v.id), float(v.x), float(v.y), float(v.angle), float(v.speed), float(types[v.type].length))
            for v in step.vehicle or []
        ]
    rows, run = np.array(rows), by_frame(run)
    close(rows[:, 0], run.time_s, 1e-6)
    close(rows[:, 1], run.track, 0)
    heading = np.radians(90 - rows[:, 4])
    close(np.angle(np.exp(1j * (heading - run.heading_rad.to_numpy()))), np.zeros(len(run)), 6e-6)
    close(rows[:, 5], run.speed_mps, 1e-4)
    close(rows[:, 6], run.length_m, 1e-4)
    on_the_axis(rows[:, 2:4], run, 4e-4)
    return len(rows)


def check_ngsim(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with pandas."""
    found, run = pd.read_csv(folder / f"{name}.csv"), by_track(run)
    close(found[["Vehicle_ID", "Frame_ID"]], run[["track", "frame"]], 0)
    close(found.v_Vel * FOOT_M, run.speed_mps, 2e-4)
    close(found.v_Length * FOOT_M, run.length_m, 2e-4)
    on_the_axis(found[["Local_X", "Local_Y"]].to_numpy() * FOOT_M, run, 4e-4)
    return len(found)


def check_highd(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with pandas."""
    found, run = pd.read_csv(folder / f"{name}_tracks.csv"), by_track(run)
    close(found[["id", "frame"]], run[["track", "frame"]], 0)
    close(np.hypot(found.xVelocity, found.yVelocity), run.speed_mps.abs(), 2e-4)
    # Their y axis points to the right; x and y are the upper left corner of a box along the axes.
    axis = pd.read_csv(folder / f"{name}_recordingMeta.csv").xAxisHeading[0]
    middle = np.column_stack([found.x + found.width / 2, -(found.y + found.height / 2)])
    turn = np.array([[np.cos(axis), np.sin(axis)], [-np.sin(axis), np.cos(axis)]])
    # The axis has five decimals, so a position is off by up to 5 µm for each metre of distance.
    on_the_axis(middle @ turn, run, 5e-4 + 5e-6 * np.hypot(run.x_m, run.y_m).max())
    meta = pd.read_csv(folder / f"{name}_tracksMeta.csv")
    close(meta.numFrames, run.groupby("track").size(), 0)
    return len(found)


def check_ssam(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with the record layouts of "SSAM File Format v1.04"."""
    data = (folder / f"{name}.trj").read_bytes()
    header = np.dtype([("format", "u1"), ("endian", "S1"), ("version", "<f4"), ("dimensions", "u1"), ("units", "u1")])
    header = np.dtype([*header.descr, ("scale", "<f4"), ("edges", "<i4", 4)])
    vehicle = np.dtype(
        [("record", "u1"), ("id", "<i4"), ("link", "<i4"), ("lane", "u1"), ("front", "<f4", 2), ("rear", "<f4", 2)]
    )
    vehicle = np.dtype([*vehicle.descr, ("size", "<f4", 2), ("speed", "<f4"), ("acceleration", "<f4")])
    start = np.frombuffer(data, header, 1)[0]
    assert (start["format"], start["endian"], start["dimensions"], start["units"], start["scale"]) == (0, b"L", 1, 1, 1)
    close(start["version"], 1.04, 1e-6)
    at, times, vehicles = header.itemsize, [], []
    while at < len(data):
        if data[at] == 2:
            time_s = np.frombuffer(data, "<f4", 1, at + 1)[0]
            at += 5
        else:
            times.append(time_s)
            vehicles.append(np.frombuffer(data, vehicle, 1, at)[0])
            at += vehicle.itemsize
    found, run = np.array(vehicles), by_frame(run)
    assert (found["record"] == 3).all() and not found["link"].any() and not found["lane"].any()
    close(found["id"], run.track, 0)
    close(times, run.time_s, 1e-5 + 1e-7 * run.time_s.max())
    close(found["size"], run[["length_m", "width_m"]], 1e-5)
    close(found["speed"], run.speed_mps, 1e-5)
    on_the_axis(found["front"], run, 4e-4)
    along = np.column_stack([np.cos(run.heading_rad), np.sin(run.heading_rad)]) * run.length_m.to_numpy()[:, None]
    close(found["front"] - found["rear"], along, 2e-4)
    centres = (found["front"] + found["rear"]) / 2
    assert (start["edges"][:2] < centres).all() and (centres < start["edges"][2:]).all()
    return len(found)


def check_ottrk(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with OTVision's reader."""
    from OTVision import dataformat
    from OTVision.helpers.files import get_metadata, read_json
    from OTVision.helpers.formats import _ottrk_detections_to_df

    content = read_json(folder / f"{name}.ottrk", ".ottrk")
    found, run = _ottrk_detections_to_df(content[dataformat.DATA][dataformat.DETECTIONS]), by_frame(run)
    metadata = get_metadata(content)
    assert not metadata[dataformat.DETECTION][dataformat.NORMALIZED_BBOX]
    assert set(run["class"]) <= set(metadata[dataformat.DETECTION][dataformat.MODEL][dataformat.CLASSES].values())
    close(found[[dataformat.FRAME, dataformat.TRACK_ID]], run[["frame", "track"]] + [1, 0], 0)
    assert found[dataformat.CLASS].tolist() == run["class"].tolist()
    corners = run[BOX].to_numpy()
    close(found[[dataformat.X, dataformat.Y]], corners[:, :2], 0)
    close(found[[dataformat.W, dataformat.H]], corners[:, 2:] - corners[:, :2], 1e-9)
    close(found[dataformat.CONFIDENCE], run.score, 0)
    close(found[dataformat.INTERPOLATED_DETECTION], ~run.observed, 0)
    start_s = metadata[dataformat.VIDEO][dataformat.RECORDED_START_DATE]
    close(found[dataformat.OCCURRENCE] - start_s, run.time_s, 1e-6)
    ends = found.groupby(dataformat.TRACK_ID)[[dataformat.FIRST, dataformat.FINISHED]].sum()
    close(ends, np.ones(ends.shape), 0)
    return len(found)
