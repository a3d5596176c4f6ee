"""Functions that compare numbers of an export with the rows of the run."""

from __future__ import annotations

import numpy as np
import pandas as pd

BOX = ["bbox_x0_px", "bbox_y0_px", "bbox_x1_px", "bbox_y1_px"]


def close(found: np.ndarray, ours: np.ndarray, tolerance: float) -> None:
    """Checks that there are as many numbers, each within the format's digits."""
    found, ours = np.asarray(found, float), np.asarray(ours, float)
    assert found.shape == ours.shape, f"{found.shape} against {ours.shape}"
    worst = np.abs(found - ours).max(initial=0)
    assert worst <= tolerance, f"off by {worst}, allowed {tolerance}"


def by_frame(run: pd.DataFrame) -> pd.DataFrame:
    """Returns rows by frame, then track."""
    return run.sort_values(["frame", "track"], ignore_index=True)


def by_track(run: pd.DataFrame) -> pd.DataFrame:
    """Returns rows by track, then frame."""
    return run.sort_values(["track", "frame"], ignore_index=True)


def on_the_axis(places: np.ndarray, run: pd.DataFrame, tolerance: float) -> None:
    """Checks that fronts and centres of bodies are ahead of the run's position, at one distance per car."""
    apart = places - run[["x_m", "y_m"]].to_numpy()
    cos, sin = np.cos(run.heading_rad.to_numpy()), np.sin(run.heading_rad.to_numpy())
    close(apart[:, 1] * cos - apart[:, 0] * sin, np.zeros(len(run)), tolerance)
    ahead = pd.Series(apart[:, 0] * cos + apart[:, 1] * sin).groupby(run.track).agg(np.ptp)
    close(ahead, np.zeros(len(ahead)), tolerance)
