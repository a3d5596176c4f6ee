"""Measures the cost of Snakemake in a night: its processor time, and the time in which no run is active.

  scripts/nightly/overhead.py INPUTS --out FOLDER [--cores 2] [--roadplane BINARY] [--config KEY=VALUE …]

INPUTS is the Snakefile's `inputs`, KEY=VALUE is further configuration of it; FOLDER must not exist yet. The runs are
the calls of `step.py`, according to its files in `log`. Everything else is overhead: Snakemake, its jobs, the dataset
and the page. The exit code is 1 if the overhead exceeds 3 % of the runs' processor time. It needs the packages of the
group `nightly` in pyproject.toml.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

from clips import Json
from step import read_json

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = {
    "ORT_DYLIB_PATH": str(ROOT / ".runtime/libonnxruntime.so"),
    "ROADPLANE_MODELS": str(ROOT / "models"),
} | os.environ
MOST = 0.03


def at_work_s(runs: list[Json]) -> float:
    """Returns the time in which at least one of the runs is active."""
    total_s, until = 0.0, 0.0
    for begun, ended in sorted((run["begun"], run["begun"] + run["seconds"]) for run in runs):
        total_s += max(0.0, ended - max(begun, until))
        until = max(until, ended)
    return total_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--roadplane", type=Path, default=ROOT / "target/release/roadplane")
    parser.add_argument("--config", nargs="*", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    if arguments.out.exists():
        parser.error(f"this night exists already, so nothing would run: {arguments.out}")
    config = [f"inputs={arguments.inputs}", f"out={arguments.out}", f"roadplane={arguments.roadplane}", *arguments.config]
    line = [Path(sys.executable).with_name("snakemake"), "-s", ROOT / "scripts/nightly/Snakefile", "-c", arguments.cores]
    begun = time.monotonic()
    subprocess.run([*map(str, line), "--config", *config], env=ENVIRONMENT, check=True)
    took_s = time.monotonic() - begun
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    runs = [read_json(path) for path in (arguments.out / "log").glob("*.json")]
    runs_cpu_s = sum(run["cpu_s"] for run in runs)
    beside_s = used.ru_utime + used.ru_stime - runs_cpu_s
    share = beside_s / runs_cpu_s
    print(f"{len(runs)} runs: {runs_cpu_s:.1f} s of processor time; overhead {beside_s:.1f} s ({100 * share:.1f} %)")
    print(f"{took_s:.1f} s, in {took_s - at_work_s(runs):.1f} s of which no run was active")
    sys.exit(0 if share <= MOST else 1)


if __name__ == "__main__":
    main()
