#!/usr/bin/env python3
"""Measures whether activities depend on the frame rate: tracks thinned to every k-th frame against all of them.

  python3 scripts/eval/strides.py RUN/tracks.csv [--strides 1 2 3 4 5 6] [--within 0.3]

The script runs `roadplane stage activity` on each.
A kept frame also counts as observed if the vehicle was observed in a
dropped frame around it. At a lower rate, the run would have observed it there. Two events agree if they have the same
track and activity, and their beginnings and ends are within this many seconds. The output also gives the frame rates of
the strides.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path


def events_of(rows: list[dict[str, str]], program: str, folder: Path) -> list[dict]:
    """Returns the events of rows of tracks."""
    thin, out = folder / "thin.csv", folder / "labelled.csv"
    with thin.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    subprocess.run([program, "stage", "activity", thin, "--out", out], check=True, capture_output=True)
    return [json.loads(line) for line in out.with_suffix(".activities.jsonl").read_text().splitlines()]


def thinned(rows: list[dict[str, str]], stride: int) -> list[dict[str, str]]:
    """Returns the rows of every `stride`-th frame, observed if the vehicle was in any frame that it replaces."""
    seen: dict[tuple[str, int], bool] = {}
    for row in rows:
        nearest = row["track"], round(int(row["frame"]) / stride)
        seen[nearest] = seen.get(nearest, False) or row["observed"] == "true"
    kept = [row for row in rows if int(row["frame"]) % stride == 0]
    words = {True: "true", False: "false"}
    return [{**row, "observed": words[seen[row["track"], int(row["frame"]) // stride]]} for row in kept]


def agreeing(events: list[dict], others: list[dict], within_s: float) -> int:
    """Returns how many events agree with one of the others."""
    left, count = list(others), 0
    for event in events:
        for other in left:
            same = (event["track"], event["activity"]) == (other["track"], other["activity"])
            if same and all(abs(event[end] - other[end]) <= within_s for end in ("from_s", "to_s")):
                left.remove(other)
                count += 1
                break
    return count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracks", type=Path, nargs="+", help="tracks.csv of runs")
    parser.add_argument("--strides", type=int, nargs="+", default=[1, 2, 3, 4, 5, 6])
    parser.add_argument("--within", type=float, default=0.3, help="tolerance of beginnings and ends, s")
    parser.add_argument("--program", default="roadplane")
    options = parser.parse_args()
    found, whole = 0, 0
    for path in options.tracks:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        if not rows:
            print(f"{path}: no tracks")
            continue
        times = sorted({float(row["time_s"]) for row in rows})
        rate = (len(times) - 1) / max(times[-1] - times[0], 1e-9)
        with tempfile.TemporaryDirectory() as folder:
            events = events_of(rows, options.program, Path(folder))
            for stride in options.strides:
                others = events_of(thinned(rows, stride), options.program, Path(folder))
                agree = agreeing(events, others, options.within)
                found, whole = found + agree, whole + max(len(events), len(others))
                result = f"{agree} of {len(events)} events agree, {len(others) - agree} others do not"
                print(f"{path.parent.name} stride {stride} ({rate / stride:.1f} Hz): {result}")
    print(f"total: {found} of {whole}", file=sys.stderr)


if __name__ == "__main__":
    main()
