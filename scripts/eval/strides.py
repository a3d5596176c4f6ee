#!/usr/bin/env python3
"""Whether activities depend on the frame rate: tracks thinned to every k-th frame against all of them.

    python scripts/eval/strides.py RUN/tracks.csv [--strides 1 2 3 4 5 6] [--within 0.3]

Runs `roadplane activity` on each. A vehicle was seen in a frame that is kept if it was in any of those that the frame stands
for: at a lower rate the run would have looked there. An event agrees when one of the same track and activity begins and ends
within so many seconds of it; the frame rates that the strides come to are told besides.
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
    """The events that are told of rows of tracks."""
    thin, out = folder / "thin.csv", folder / "labelled.csv"
    with thin.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    subprocess.run([program, "activity", thin, "--out", out], check=True, capture_output=True)
    return [json.loads(line) for line in out.with_suffix(".activities.jsonl").read_text().splitlines()]


def thinned(rows: list[dict[str, str]], stride: int) -> list[dict[str, str]]:
    """Every `stride`-th frame's rows; each was seen if the vehicle was in that frame or in those left out around it."""
    seen: dict[tuple[str, int], bool] = {}
    for row in rows:
        nearest = row["track"], round(int(row["frame"]) / stride)
        seen[nearest] = seen.get(nearest, False) or row["observed"] == "true"
    kept = [row for row in rows if int(row["frame"]) % stride == 0]
    told = {True: "true", False: "false"}
    return [{**row, "observed": told[seen[row["track"], int(row["frame"]) // stride]]} for row in kept]


def agreeing(events: list[dict], others: list[dict], within_s: float) -> int:
    """How many events have one of their own among the others."""
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
    parser.add_argument("--within", type=float, default=0.3, help="s")
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
                told = f"{agree} of {len(events)} events agree, {len(others) - agree} are others"
                print(f"{path.parent.name} stride {stride} ({rate / stride:.1f} Hz): {told}")
    print(f"in all {found} of {whole}", file=sys.stderr)


if __name__ == "__main__":
    main()
