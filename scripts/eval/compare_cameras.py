"""Compares two evaluations of the same cameras, for example with different settings.

  python3 scripts/eval/compare_cameras.py BEFORE AFTER

Both are folders that `roadplane-lab eval cameras DIR --out FOLDER` wrote. The script prints by how much AFTER explains
the true cameras better: the gain of log likelihood, in nats. The four errors of a camera (focal length, tilt, roll,
height) have a Student-t distribution with 4 degrees of freedom around the estimate, and the claimed sds. The sds of
roll and height hardly differ between two evaluations, so only those of focal length and tilt count as a scale. The
95 % interval comes from resampling sources of cameras, or cameras if all are of one source.
"""

import argparse
import csv
import math
import random
from collections import defaultdict
from pathlib import Path

FREEDOM = 4.0
ROUNDS = 4000
TABLE = "01-each-camera.csv"
DETERMINED = ("Estimated", "FocalFromPrior")


def read(folder: Path) -> dict[str, dict[str, str]]:
    """Returns the rows of the table of single cameras, by the camera's name."""
    with (folder / TABLE).open(newline="", encoding="utf-8") as table:
        return {row["camera"]: row for row in csv.DictReader(table)}


def log_likelihood(row: dict[str, str]) -> float:
    """Returns the log likelihood of a camera's errors, up to a constant."""
    errors = (float(row[f"{name}, sds"]) for name in ("focal", "tilt", "roll", "height"))
    misfit = sum((FREEDOM + 1) / 2 * math.log(1 + error**2 / FREEDOM) for error in errors)
    return -misfit - math.log(float(row["sd, %"])) - math.log(float(row["sd, °"]))


def main() -> None:
    """Prints the gain with its interval."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    args = parser.parse_args()
    before, after = read(args.before), read(args.after)
    both = [name for name in before if name in after]
    cameras = [name for name in both if all(rows[name]["status"] in DETERMINED for rows in (before, after))]
    groups: dict[str, float] = defaultdict(float)
    several = len({name.split("/")[0] for name in cameras}) > 1
    for name in cameras:
        key = name.split("/")[0] if several else name
        groups[key] += log_likelihood(after[name]) - log_likelihood(before[name])
    if not groups:
        parser.error("no camera is estimated in both evaluations")
    gains = list(groups.values())
    rng = random.Random(1)
    sums = sorted(sum(rng.choices(gains, k=len(gains))) for _ in range(ROUNDS))
    low, high = sums[int(0.025 * ROUNDS)], sums[int(0.975 * ROUNDS)]
    print(f"{len(cameras)} cameras: gain {sum(gains):.1f} nats, 95 % interval {low:.1f} to {high:.1f}")
    for key, gain in sorted(groups.items()) if several else ():
        print(f"  {key}: {gain:+.1f}")


if __name__ == "__main__":
    main()
