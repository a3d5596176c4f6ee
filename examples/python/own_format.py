"""Writes the tracks of a run in a made-up format: a JSON file with one entry for each vehicle.

    python own_format.py RUN FILE.json

An entry holds the vehicle's number, class and size, and its path as [time s, x m, y m, heading rad] per row.
"""

import json
import sys
from pathlib import Path

import roadplane


def main() -> None:
    """Reads a run and writes the file."""
    run = roadplane.load(sys.argv[1])
    vehicles = []
    for track, rows in run.tracks().groupby("track"):
        first = rows.iloc[0]  # class and size are the same in all rows of a track
        vehicles.append(
            {
                "id": int(track),
                "class": first["class"],
                "size_m": [float(first[column]) for column in ("length_m", "width_m", "height_m")],
                "path": rows[["time_s", "x_m", "y_m", "heading_rad"]].to_numpy().tolist(),
            }
        )
    camera = {"focal_px": run.camera.focal_px, "height_m": run.camera.height_m}
    Path(sys.argv[2]).write_text(json.dumps({"camera": camera, "vehicles": vehicles}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
