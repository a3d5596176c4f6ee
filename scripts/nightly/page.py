"""Writes one page over all cameras and nights: runs, failures, losses, drift of the cameras, vehicles by hour.

page.py [--roadplane BINARY] [--cameras FOLDER] [--camera-id ID] index.html night.json
"""

import argparse
import json
import os
import subprocess
from pathlib import Path

import duckdb
import jinja2
from clips import Json, camera_of, recorded
from step import CAMERA, read_json, write_json

FINISHED = (0, 3)
OUTCOMES = ("done", "partly followed", "damaged", "lost", "failed", "not done")


def clip_of(planned: Json, camera_id: str) -> Json:
    """Returns the outcome of a clip, for a line of the table."""
    stem = planned["stem"]
    time, origin = recorded(planned) or ("", "")
    clip: Json = {
        "stem": stem,
        "input": planned["input"],
        "recorded": str(time),
        "recorded_from": origin,
        "camera": camera_of(stem, camera_id),
        "outcome": planned.get("outcome", "not done"),
        "said": planned.get("said", []),
    }
    status = Path(f"steps/result/{stem}.json")
    if status.is_file():
        clip |= {key: value for key, value in read_json(status).items() if key in ("outcome", "said", "made")}
    if "made" not in clip:
        return clip
    result = Path(clip["made"])
    summary, camera = read_json(result / "summary.json"), read_json(result / "camera.json")
    counts = summary["counts"]
    clip |= {
        "frames": counts["frames_read"],
        "frames_lost": counts["frames_lost"],
        "frames_not_followed": counts.get("frames_not_followed", 0),
        "tracks": counts["tracks"],
        "warnings": summary["warnings"],
        "moves": len(summary["watch"]["moves"]),
    }
    return clip | {"known": {key: camera[key] for key in CAMERA}, "alone": read_alone(stem)}


def read_alone(stem: str) -> Json | None:
    """Returns the camera estimated from one clip alone; None without a camera database."""
    first = Path(f"steps/first/{stem}.json")
    return read_json(first).get("alone") if first.is_file() else None


def attempts() -> list[Json]:
    """Returns the attempts that the machine failed; one without an end was killed."""
    told = [read_json(path) for path in sorted(Path("log").glob("*.json"))]
    return [attempt for attempt in told if attempt.get("exit", "killed") not in FINISHED]


def work() -> dict[str, float]:
    """Returns the wall time and the processor time of all attempts that were not killed, s."""
    told = [read_json(path) for path in Path("log").glob("*.json")]
    return {key: round(sum(attempt.get(key, 0) for attempt in told), 1) for key in ("seconds", "cpu_s")}


def vehicles_by_hour() -> list[Json]:
    """Counts the tracks within each hour, by camera and day."""
    if not any(Path("dataset").glob("camera=*/day=*/*.parquet")):
        return []
    rows = duckdb.sql("""
        SELECT camera, CAST(moment::DATE AS VARCHAR) AS day, hour(moment) AS hour, count(DISTINCT (clip, track)) AS vehicles,
               count(DISTINCT CASE WHEN abs(speed_mps) > 1 THEN (clip, track) END) AS driving
        FROM read_parquet('dataset/*/*/*.parquet', hive_partitioning = true) GROUP BY ALL ORDER BY ALL""").fetchall()
    return [dict(zip(("camera", "day", "hour", "vehicles", "driving"), row, strict=True)) for row in rows]


def epochs(roadplane: str, folder: str | Path) -> list[Json]:
    """Returns the epochs of each stored camera."""
    folder = Path(folder)
    cameras = sorted(p.name for p in folder.iterdir() if p.is_dir()) if folder.is_dir() else []
    lines: list[Json] = []
    for camera in cameras:
        command = [roadplane, "cameras", "show", str(folder), camera, "--json"]
        shown = subprocess.run(command, capture_output=True, text=True, check=True)
        lines += [json.loads(line) for line in shown.stdout.splitlines()]
    return lines


def drift(clips: list[Json], key: str, sd_key: str) -> Json:
    """Returns a camera's estimates by clip as points of a drawing 100 high: value, ± 2 sd, and the range."""
    told: list[tuple[str, float, float]] = [(clip["stem"], clip["alone"][key], clip["alone"][sd_key]) for clip in clips]
    low = min(value - 2 * sd for _, value, sd in told)
    high = max(value + 2 * sd for _, value, sd in told)

    def y(value: float) -> float:
        return 100 - 100 * (value - low) / max(high - low, 1e-9)

    points = [
        {"y": y(value), "top": y(value + 2 * sd), "bottom": y(value - 2 * sd), "name": f"{stem}: {value:.4g} ± {sd:.2g}"}
        for stem, value, sd in told
    ]
    return {"low": low, "high": high, "points": points}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--roadplane", default="roadplane")
    parser.add_argument("--cameras", default="cameras")
    parser.add_argument("--camera-id", default="")
    parser.add_argument("page")
    parser.add_argument("night")
    args = parser.parse_args()
    planned: dict[str, Json] = {}
    for line in Path("steps/plan.jsonl").read_text().splitlines():
        piece = json.loads(line)
        planned.setdefault(piece["stem"], piece)
    clips = [clip_of(piece, args.camera_id) for piece in planned.values()]
    clips.sort(key=lambda clip: (clip["camera"], clip["recorded"], clip["stem"]))
    outcomes = {o: sum(clip["outcome"] == o for clip in clips) for o in OUTCOMES}
    by_file = [clip["stem"] for clip in clips if clip["recorded_from"] == "file"]
    if by_file:
        names = ", ".join(by_file)
        print(f"{len(by_file)} clips are dated by file time, as neither name nor container has a time: {names}")
    unknown = [clip["stem"] for clip in clips if args.camera_id and clip["camera"] == "unknown"]
    if unknown:
        print(f"{len(unknown)} clips have no camera according to {args.camera_id}: {', '.join(unknown)}")
    night: Json = {
        "clips": clips,
        "dated_by_file": by_file,
        "without_camera": unknown,
        "camera_id": args.camera_id,
        "outcomes": outcomes,
        "attempts": attempts(),
        "work": work(),
        "hours": vehicles_by_hour(),
        "traffic": "traffic/traffic.html" if Path("traffic/traffic.html").is_file() else "",
        "cameras": epochs(args.roadplane, args.cameras),
    }
    drifts: dict[str, list[tuple[str, Json]]] = {}
    for name in sorted({clip["camera"] for clip in clips if clip.get("alone")}):
        own = [clip for clip in clips if clip["camera"] == name and clip.get("alone")]
        own = [clip for clip in own if clip["alone"]["status"] != "unobservable"]
        if own:
            drifts[name] = [
                ("focal length, px", drift(own, "focal_px", "focal_sd_px")),
                ("height, m", drift(own, "height_m", "height_sd_m")),
                ("tilt, rad", drift(own, "tilt_rad", "tilt_sd_rad")),
            ]
    template = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(
        (Path(__file__).parent / "page.html").read_text()
    )
    page = template.render(night=night, drifts=drifts, most=max([h["vehicles"] for h in night["hours"]], default=1))
    temp = Path(args.page).with_suffix(".tmp")
    temp.write_text(page)
    os.replace(temp, args.page)
    write_json(args.night, night)


if __name__ == "__main__":
    main()
