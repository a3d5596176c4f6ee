"""Runs one step of a night: calls roadplane, and writes the outcome to a status file.

- `step.py plan … plan.jsonl CLIP…`: the pieces of all clips.
- `step.py piece … STATUS CLIP`: one piece.
- `step.py first … STATUS PIECE_STATUS…`: joins pieces to estimate the clip's camera.
- `step.py cameras … STATUS FIRST_STATUS…`: adds the cameras of all clips to the camera database.
- `step.py result … STATUS PIECE_STATUS…`: joins pieces with the stored camera.
- `step.py traffic … STATUS RESULT_STATUS…`: tables of traffic by camera and period, and their page, in traffic/.
- `step.py verdict night.json`: exits with 1 if a machine failed for good.

The exit code of roadplane decides. 0 and 3 (the input is damaged, lost or partly followed) count as finished. With any
other code, the step ends with that code, so that the engine tries it again. At the last attempt the status file records
the failure, so that the night continues without it. Each attempt leaves a file in log/ with its beginning and its end;
an attempt without an end was killed.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from clips import Json, is_failed

LAST_ATTEMPT = 3
INPUT_AT_FAULT = 3
SAID_LINES = 20
# Outcome of a clip by the `status` of its summary.json.
OUTCOME_OF_RUN = {
    "complete": "done",
    "partly_followed": "partly followed",
    "input_damaged": "damaged",
    "points_not_used": "done",
}
# Fields of camera.json that describe a camera.
CAMERA = ("status", "focal_px", "focal_sd_px", "height_m", "height_sd_m", "tilt_rad", "tilt_sd_rad")


def write_json(path: str | Path, value: Json) -> None:
    """Writes a file, whole or not at all."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temp = path.with_name(f".{path.name}.{os.getpid()}")
    temp.write_text(json.dumps(value, indent=1) + "\n")
    os.replace(temp, path)


def read_json(path: str | Path) -> Json:
    value: Json = json.loads(Path(path).read_text())
    return value


def call(roadplane: str, arguments: Sequence[object], log: str) -> tuple[Json, str]:
    """Runs roadplane; returns exit code, wall time, processor time and the end of its log. `log` names the attempt."""
    # Durations use a clock of their own, as the system clock may be set.
    begun, since = time.time(), time.monotonic()
    attempt = Path("log") / f"{log}.{int(begun * 1000)}.json"
    told = {"step": log, "begun": begun, "host": os.uname().nodename}
    write_json(attempt, told)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [roadplane, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    code = done.returncode if done.returncode >= 0 else 128 - done.returncode
    said = done.stderr.splitlines()[-SAID_LINES:]
    ended = {"exit": code, "seconds": round(time.monotonic() - since, 3), "cpu_s": round(cpu_s, 3), "said": said}
    write_json(attempt, told | ended)
    return ended, done.stdout


def give_up(args: argparse.Namespace, status: Json) -> None:
    """Exits with roadplane's exit code, so that the step is tried again, or records the failure."""
    if args.attempt < LAST_ATTEMPT:
        sys.stderr.write("\n".join(status["said"]) + "\n")
        sys.exit(status["exit"])
    write_json(args.status, status | {"outcome": "failed"})


def settings(args: argparse.Namespace) -> list[str]:
    return [word for setting in args.settings.split() for word in ("--set", setting)]


def plan(args: argparse.Namespace) -> None:
    lines = []
    for clip in args.of:
        ended, lines_of_clip = call(args.roadplane, ["plan", "--piece-s", args.piece_s, *settings(args), clip], "plan")
        if ended["exit"] not in (0, INPUT_AT_FAULT):
            sys.stderr.write("\n".join(ended["said"]) + "\n")
            sys.exit(ended["exit"])
        lines += [json.loads(line) for line in lines_of_clip.splitlines()]
        if ended["exit"] == INPUT_AT_FAULT:
            lines.append({"input": clip, "stem": Path(clip).stem, "outcome": "lost", "said": ended["said"]})
    temp = Path(args.status).with_suffix(".tmp")
    temp.write_text("".join(json.dumps(line) + "\n" for line in lines))
    os.replace(temp, args.status)


def piece(args: argparse.Namespace) -> None:
    [clip] = args.of
    start = Path(args.status).stem
    stem = Path(args.status).parent.name
    # Each piece has a folder of its own, as locks belong to folders.
    out = Path("pieces") / stem / start
    command = ["run", clip, "--piece", args.piece, "--out", out, "--resume", *settings(args)]
    ended, _ = call(args.roadplane, command, f"piece.{stem}.{start}")
    made = sorted(str(p) for p in out.glob("*.piece-*"))
    status = {"stem": stem, "input": clip, "piece": args.piece, "made": made, **ended}
    if ended["exit"] not in (0, INPUT_AT_FAULT):
        return give_up(args, status)
    write_json(args.status, status | {"outcome": outcome(ended["exit"], made)})


def outcome(code: int, made: list[str]) -> str:
    if code == 0:
        return "done"
    return "damaged" if made else "lost"


def join(args: argparse.Namespace) -> None:
    """Runs `first` and `result`: joins the pieces of a clip, without a camera database or with it."""
    stem = Path(args.status).stem
    pieces = [read_json(path) for path in args.of]
    status = {"stem": stem, "input": pieces[0]["input"]}
    for worst in ("failed", "lost"):
        words = [line for p in pieces if p["outcome"] == worst for line in p["said"]]
        if any(p["outcome"] == worst for p in pieces):
            return write_json(args.status, status | {"outcome": worst, "said": words[-SAID_LINES:]})
    work = Path("work") / args.step / stem
    memory = args.cameras
    if args.step == "first":
        memory = Path("said") / stem
        shutil.rmtree(memory, ignore_errors=True)
    command = ["join", *(made for p in pieces for made in p["made"]), "--out", work, "--overwrite", *settings(args)]
    if memory:
        command += ["--cameras", memory, "--camera-id", args.camera_id]
    ended, _ = call(args.roadplane, command, f"{args.step}.{stem}")
    status |= ended
    if ended["exit"] not in (0, INPUT_AT_FAULT):
        return give_up(args, status)
    summary = work / stem / "summary.json"
    if not summary.is_file():
        return write_json(args.status, status | {"outcome": "lost"})
    status["outcome"] = OUTCOME_OF_RUN[read_json(summary)["status"]]
    if args.step == "result":
        result = Path("results") / stem
        result.parent.mkdir(exist_ok=True)
        shutil.rmtree(result, ignore_errors=True)
        os.replace(work / stem, result)
        status["made"] = str(result)
    else:
        # The clip's own estimate shows how a camera drifts.
        camera = read_json(work / stem / "camera.json")
        status["alone"] = {key: camera[key] for key in CAMERA}
    shutil.rmtree(work, ignore_errors=True)
    write_json(args.status, status)


def cameras(args: argparse.Namespace) -> None:
    said = [Path("said") / Path(path).stem for path in args.of]
    said = [folder for folder in said if folder.is_dir()]
    Path(args.cameras).mkdir(parents=True, exist_ok=True)
    status = {"outcome": "done", "clips": len(said)}
    if said:
        ended, _ = call(args.roadplane, ["cameras", "merge", *said, "--out", args.cameras], "cameras")
        status |= ended
        if ended["exit"] != 0:
            return give_up(args, status)
    write_json(args.status, status)


def traffic(args: argparse.Namespace) -> None:
    made = [status["made"] for status in map(read_json, args.of) if "made" in status]
    status: Json = {"outcome": "done", "clips": len(made)}
    if made:
        command = ["traffic", *made, "--every", args.every, "--time-zone", args.time_zone, "--out", "traffic", "--overwrite"]
        command += ["--camera-id", args.camera_id] if args.camera_id else []
        ended, _ = call(args.roadplane, command, "traffic")
        status |= ended
        if ended["exit"] != 0:
            return give_up(args, status)
    write_json(args.status, status)


def verdict(args: argparse.Namespace) -> None:
    failed = [clip["stem"] for clip in read_json(args.status)["clips"] if clip["outcome"] == "failed"]
    failed += [status.stem for status in sorted(Path("steps").glob("*.json")) if is_failed(status)]
    if failed:
        sys.exit(f"failed; the next call tries again: {', '.join(failed)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--roadplane", default="roadplane")
    steps = {"plan": plan, "piece": piece, "first": join, "cameras": cameras, "result": join, "traffic": traffic}
    steps["verdict"] = verdict
    parser.add_argument("step", choices=steps)
    parser.add_argument("--settings", default="")
    parser.add_argument("--attempt", type=int, default=1)
    parser.add_argument("--piece-s", type=int, default=3600)
    parser.add_argument("--piece")
    parser.add_argument("--camera-id", default="")
    parser.add_argument("--cameras")
    parser.add_argument("--every", default="1h")
    parser.add_argument("--time-zone", default="UTC")
    parser.add_argument("status")
    parser.add_argument("of", nargs="*")
    args = parser.parse_args()
    steps[args.step](args)


if __name__ == "__main__":
    main()
