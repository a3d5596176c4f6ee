"""Prints the speed of each vehicle that crosses a line on the ground.

    python speeds_at_line.py RUN X0 Y0 X1 Y1

The line goes from (X0, Y0) to (X1, Y1), world coordinates in metres.
"""

import sys

import numpy as np

import roadplane


def main() -> None:
    """Reads a run and prints one line for each crossing."""
    run = roadplane.load(sys.argv[1])
    start, end = np.array(sys.argv[2:6], dtype=float).reshape(2, 2)
    along = (end - start) / np.linalg.norm(end - start)
    across = np.array([-along[1], along[0]])
    for track, rows in run.tracks().groupby("track"):
        positions = rows[["x_m", "y_m"]].to_numpy() - start
        # A vehicle crosses between two rows if its distance from the line changes its sign …
        side = positions @ across > 0
        crossings = np.flatnonzero(side[1:] != side[:-1])
        for index in crossings:
            # … and if it is between the ends of the line.
            if 0 <= positions[index] @ along <= np.linalg.norm(end - start):
                row = rows.iloc[index]
                speed, sd = 3.6 * row["speed_mps"], 3.6 * row["speed_sd_mps"]
                print(f"track {track} at {row['time_s']:.2f} s: {speed:.1f} ± {sd:.1f} km/h")


if __name__ == "__main__":
    main()
