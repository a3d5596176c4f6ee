"""What a night on Snakemake costs beside the runs themselves: processor time, and time in which no run is at work.

    scripts/nightly/overhead.py INPUTS --out FOLDER [--cores 2] [--roadplane BINARY] [--config KEY=VALUE …]

INPUTS is what the Snakefile takes as `inputs`, KEY=VALUE more of its configuration; FOLDER must not be there yet. Runs are what
`step.py` calls, by the files that it leaves in `log`; everything else is Snakemake, its jobs, the dataset and the page. Ends with
1 where that takes more than 3 % of the runs' processor time. Needs scripts/nightly/requirements.txt.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

from step import Json, read_json

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = {
    "ORT_DYLIB_PATH": str(ROOT / ".runtime/libonnxruntime.so"),
    "ROADPLANE_MODELS": str(ROOT / "models"),
} | os.environ
MOST = 0.03


def at_work_s(runs: list[Json]) -> float:
    """Time in which at least one of the runs is at work."""
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
        parser.error(f"there is a night already, of which nothing would be done again: {arguments.out}")
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
    print(f"{len(runs)} runs: {runs_cpu_s:.1f} s of processor time; beside them {beside_s:.1f} s ({100 * share:.1f} %)")
    print(f"{took_s:.1f} s, in {took_s - at_work_s(runs):.1f} s of which no run was at work")
    sys.exit(0 if share <= MOST else 1)


if __name__ == "__main__":
    main()
