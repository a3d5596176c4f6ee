"""Compares a long input in one run with the same input in pieces that are joined: results, time and memory.

  scripts/nightly/pieces.py CLIP… --out FOLDER [--minutes 60] [--pieces 12] [--settings watch.look_s=0.4 …]

The long input is made of the clips, each looped for ten minutes at most, in turn; `--input FILE` takes an existing
file. A row is the same if the joined result has one of the same frame with every number within 1e-6. A track is kept
across a seam if its last row before and its first row after belong to one track of the joined result.

The exit code is 1 if not all rows away from seams are the same, or if fewer than 98 of 100 tracks are kept. It needs
the packages of the group `nightly` in pyproject.toml and, to make the input, ffmpeg.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import duckdb

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = {
    "ORT_DYLIB_PATH": str(ROOT / ".runtime/libonnxruntime.so"),
    "ROADPLANE_MODELS": str(ROOT / "models"),
} | os.environ
# Duration of a clip's loop before the next clip.
TURN_S = 600
# Overlap of pieces, by the memory of the stages.
SEAM_S = 60
SAME = 1e-6
LEAST_TRACKS_KEPT = 0.98
# Largest difference between rows of the same vehicle.
NEAR_M = 1


# Processor time, s; wall time, s; peak memory, MiB.
Taken = tuple[float, float, float]


def film(clips: list[Path], path: Path, seconds: float) -> None:
    """Makes one file of the clips, of a given duration, 640 × 360 at 25 frames/s."""
    turn_s = min(TURN_S, seconds / len(clips))
    parts = [path.with_name(f"{path.stem}.{i}.mp4") for i in range(len(clips))]
    for clip, part in zip(clips, parts, strict=True):
        looped: list[str | Path] = ["-stream_loop", "-1", "-i", clip, "-t", str(turn_s), "-vf", "scale=640:360,fps=25", "-an"]
        ffmpeg(*looped, "-c:v", "libx264", "-preset", "ultrafast", "-crf", "22", "-g", "100", part)
    names = path.with_suffix(".txt")
    turns = round(seconds / turn_s)
    names.write_text("".join(f"file {parts[i % len(parts)].name}\n" for i in range(turns)))
    ffmpeg("-f", "concat", "-safe", "0", "-i", names, "-c", "copy", path)
    for made in (*parts, names):
        made.unlink()


def ffmpeg(*arguments: str | Path) -> None:
    """Runs ffmpeg; exits if it fails."""
    subprocess.run(["ffmpeg", "-loglevel", "error", "-y", *map(str, arguments)], check=True)


def run(*words: str | int | Path) -> tuple[str, Taken]:
    """Returns a command's output, its processor time (s), wall time (s) and peak memory (MiB)."""
    line = [str(word) for word in words]
    begun = time.monotonic()
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as log:
        child = subprocess.Popen(line, env=ENVIRONMENT, stdout=said, stderr=log)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        log.seek(0)
        if child.returncode != 0:
            sys.exit(f"{' '.join(line)}: exit {child.returncode}: {log.read().decode(errors='replace')[-1000:]}")
        taken = (used.ru_utime + used.ru_stime, time.monotonic() - begun, used.ru_maxrss / 1024)
        return said.read().decode(), taken


def tables(whole: Path, joined: Path) -> duckdb.DuckDBPyConnection:
    """Returns a database of the rows of both results."""
    database = duckdb.connect()
    database.execute("SET memory_limit = '3GB'")
    for name, folder in (("whole", whole), ("joined", joined)):
        database.execute(f"CREATE VIEW {name} AS SELECT * FROM read_parquet('{folder / 'tracks.parquet'}')")
    return database


def rows_kept(database: duckdb.DuckDBPyConnection, where: str) -> tuple[int, int]:
    """Returns the number of rows of the larger result, and how many rows both have."""
    types = {name: kind for name, kind, *_ in database.execute("DESCRIBE whole").fetchall()}

    def alike(name: str) -> str:
        same = f"a.{name} IS NOT DISTINCT FROM b.{name}"
        return f"({same} OR abs(a.{name} - b.{name}) <= {SAME})" if types[name] in ("DOUBLE", "FLOAT") else same

    conditions = " AND ".join(["a.frame = b.frame", *(alike(name) for name in types if name not in ("frame", "track"))])
    whole, joined = (f"(SELECT * FROM {name} WHERE {where})" for name in ("whole", "joined"))
    most = max(count(database, rows) for rows in (whole, joined))
    return most, count(database, f"{whole} a SEMI JOIN {joined} b ON {conditions}")


def count(database: duckdb.DuckDBPyConnection, rows: str) -> int:
    """Returns the number."""
    [(number,)] = database.execute(f"SELECT count(*) FROM {rows}").fetchall()
    return int(number)


def tracks_kept(database: duckdb.DuckDBPyConnection, seam_s: int) -> tuple[int, int]:
    """Counts the tracks with rows on both sides of a seam, and those that are one track in the joined result, too."""
    apart = "sqrt((b.x_m - a.x_m) ** 2 + (b.y_m - a.y_m) ** 2)"
    pairs = database.execute(
        f"""
        WITH ends AS (
            SELECT track, max(frame) FILTER (time_s < {seam_s}) AS before, min(frame) FILTER (time_s >= {seam_s}) AS after
            FROM whole WHERE abs(time_s - {seam_s}) < {SEAM_S}
            GROUP BY track HAVING before IS NOT NULL AND after IS NOT NULL
        ),
        theirs AS (
            SELECT a.track, a.frame < e.after AS is_before, arg_min(b.track, {apart}) AS number
            FROM ends e JOIN whole a ON a.track = e.track AND a.frame IN (e.before, e.after)
            LEFT JOIN joined b ON b.frame = a.frame AND {apart} < {NEAR_M}
            GROUP BY a.track, is_before
        )
        SELECT max(number) FILTER (is_before), max(number) FILTER (NOT is_before) FROM theirs GROUP BY track
        """
    ).fetchall()
    return len(pairs), sum(before is not None and before == after for before, after in pairs)


def compare(whole: Path, joined: Path, seams_s: list[int]) -> bool:
    """Prints the agreement of two results; returns whether it suffices."""
    database = tables(whole, joined)
    rows, same = rows_kept(database, "true")
    away, away_same = rows_kept(database, " AND ".join(f"abs(time_s - {seam_s}) > {SEAM_S}" for seam_s in seams_s))
    tracks, kept = (sum(counts) for counts in zip(*(tracks_kept(database, seam_s) for seam_s in seams_s), strict=True))
    print(f"rows the same to {SAME:g}: {same} of {rows}; more than {SEAM_S} s from a seam {away_same} of {away}")
    print(f"tracks kept across {len(seams_s)} seams: {kept} of {tracks}")
    for name in ("tracks.csv", "poses.jsonl"):
        same_bytes = (whole / name).read_bytes() == (joined / name).read_bytes()
        print(f"{name}: {'the same bytes' if same_bytes else 'other bytes'}")
    return bool(0 < away == away_same and 0 < LEAST_TRACKS_KEPT * tracks <= kept)


def main() -> None:
    """Makes the input, runs, joins, compares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=Path, nargs="*")
    parser.add_argument("--input", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--pieces", type=int, default=12)
    parser.add_argument("--settings", nargs="*", default=[])
    parser.add_argument("--roadplane", type=Path, default=ROOT / "target/release/roadplane")
    arguments = parser.parse_args()
    if bool(arguments.clips) == bool(arguments.input):
        parser.error("clips or --input are required")
    out, source = arguments.out, arguments.input
    out.mkdir(parents=True, exist_ok=True)
    if source is None:
        source = out / "long.mp4"
        film(arguments.clips, source, 60 * arguments.minutes)
    settings = [word for setting in arguments.settings for word in ("--set", setting)]

    def roadplane(*words: str | int | Path) -> tuple[str, Taken]:
        return run(arguments.roadplane, *words, *settings)

    planned, _ = roadplane("plan", source, "--piece-s", round(60 * arguments.minutes / arguments.pieces))
    pieces = [json.loads(line) for line in planned.splitlines()]
    print("| | processor time, s | time, s | memory, MiB |\n|---|---|---|---|")
    _, taken = roadplane("run", source, "--out", out / "one", "--overwrite")
    print("| in one piece | {:.0f} | {:.0f} | {:.0f} |".format(*taken), flush=True)
    each = [roadplane("run", source, "--piece", p["piece"], "--out", out / "pieces", "--overwrite")[1] for p in pieces]
    cpu_s, time_s, memory_mib = zip(*each, strict=True)
    print(f"| {len(pieces)} pieces | {sum(cpu_s):.0f} | {sum(time_s):.0f} | {max(memory_mib):.0f} |", flush=True)
    folders = [out / "pieces" / piece["folder"] for piece in pieces]
    _, taken = roadplane("join", *folders, "--out", out / "joined", "--overwrite")
    print("| joining them | {:.0f} | {:.0f} | {:.0f} |\n".format(*taken), flush=True)
    seams_s = [int(piece["piece"].split("-")[0]) for piece in pieces[1:]]
    stem = pieces[0]["stem"]
    sys.exit(0 if compare(out / "one" / stem, out / "joined" / stem, seams_s) else 1)


if __name__ == "__main__":
    main()
