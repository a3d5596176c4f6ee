#!/usr/bin/env python3
"""Compares the counts of `roadplane traffic` with counts by eye, at two lines of each of seven real clips.

    scripts/traffic/check_counts.py RESULTS [--binary FILE] [--list]

RESULTS is the folder of finished runs of the clips in ../shared/data/clips: `roadplane run CLIPS --out RESULTS`. The
vehicles were counted from slit-scan pictures and frames, without the program's results. The lists in `counts.json` are
the times of the crossings, s. Motorcycles do not count, because they were left out.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import tempfile
from pathlib import Path

from pixel_gates import write_gates

ROOT = Path(__file__).resolve().parents[2]
COUNTS = Path(__file__).with_name("counts.json")
DIRECTIONS = ("forward", "backward")
NEAR_VEHICLES, NEAR_SHARE = 1, 0.03  # a count that deviates by no more is right


def counted(run: Path, clip: dict, binary: Path) -> dict[tuple[str, str], tuple[int, int, int]]:
    """Returns the count and its interval by line and direction."""
    found: dict[tuple[str, str], tuple[int, int, int]] = {}
    with tempfile.TemporaryDirectory() as name:
        gates, out = Path(name) / "gates.geojson", Path(name) / "out"
        lines = {line: drawn["line_px"] for line, drawn in clip["lines"].items()}
        write_gates(gates, clip["image_size_px"], lines, {})
        subprocess.run([binary, "traffic", run, "--gates", gates, "--out", out], check=True, capture_output=True)
        rows = list(csv.DictReader((out / "counts.csv").open())) if (out / "counts.csv").exists() else []
    of_class = {(row["place"], row["direction"], row["class"]): row for row in rows}
    for (place, direction, kind), row in of_class.items():
        if kind == "all":
            motorcycles = int(of_class.get((place, direction, "motorcycle"), {"vehicles": 0})["vehicles"])
            figures = (int(row[key]) - motorcycles for key in ("vehicles", "vehicles_low", "vehicles_high"))
            found[place, direction] = tuple(figures)
    return found


def main() -> None:
    """Prints one line per line and direction, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/roadplane")
    parser.add_argument("--list", action="store_true", help="print each line")
    options = parser.parse_args()
    rows = []
    for name, clip in json.loads(COUNTS.read_text()).items():
        found = counted(options.results / name, clip, options.binary)
        for line, times in clip["lines"].items():
            for direction in DIRECTIONS:
                number, low, high = found.get((line, direction), (0, 0, 0))
                by_eye = len(times[direction])
                if number or by_eye:
                    rows.append((by_eye, number, low, high))
                    if options.list:
                        print(f"{name:14} {line} {direction:8}  by eye {by_eye:3}  counted {number:3} [{low}, {high}]")
    right = sum(abs(n - eye) <= max(NEAR_VEHICLES, NEAR_SHARE * eye) for eye, n, _, _ in rows)
    within = sum(low <= eye <= high for eye, _, low, high in rows)
    print(f"{len(rows)} lines and directions: {right} within {NEAR_VEHICLES} vehicle or {NEAR_SHARE:.0%}")
    print(f"{within} intervals hold the count by eye")
    print(f"{sum(r[0] for r in rows)} vehicles by eye, {sum(r[1] for r in rows)} counted")


if __name__ == "__main__":
    main()
