"""The clips of a night: their files, their cameras and their recording times; and the program."""

import datetime
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

# An object of a JSON file.
Json = dict[str, Any]

# Every file of the folder is a clip unless its name marks it as a companion. The page lists files that are no video.
BESIDE = {".txt", ".json", ".csv", ".md", ".xml", ".srt", ".sha256", ".part", ".tmp"}


def clips_in(inputs: str | Path) -> dict[str, Path]:
    """Maps the name of each clip's result to the clip's path.

    `inputs` is a folder, or a text file with a path per line.
    """
    inputs = Path(inputs)
    if inputs.is_dir():
        paths = sorted(p for p in inputs.iterdir() if not p.name.startswith(".") and p.suffix.lower() not in BESIDE)
    elif inputs.is_file():
        lines = [line.strip() for line in inputs.read_text().splitlines()]
        paths = [inputs.parent / line for line in lines if line and not line.startswith("#")]
    else:
        raise SystemExit(f"inputs={inputs}: neither a folder nor a file with a path a line")
    clips: dict[str, Path] = {}
    for path in paths:
        stem = path.name if path.is_dir() else path.stem
        if stem in clips:
            raise SystemExit(f"two clips have the same name {stem}: {clips[stem]}, {path}")
        if not re.fullmatch(r"[\w.+@ -]+", stem) or "'" in stem:
            raise SystemExit(f"a clip's name may have letters, digits, and - _ . + @ only: {path}")
        clips[stem] = path
    return clips


def is_failed(status: Path) -> bool:
    """Returns whether a step's status says that the machine failed at it."""
    try:
        return bool(json.loads(status.read_text())["outcome"] == "failed")
    except (OSError, ValueError, KeyError, TypeError):
        return True


def camera_of(stem: str, camera_id: str) -> str:
    """Returns the camera of a clip, as `roadplane run --camera-id` finds it; "unknown" if it finds none."""
    if "{}" not in camera_id:
        return camera_id or "unknown"
    form = re.escape(camera_id).replace(r"\{\}", "(.+?)").replace(r"\*", ".*?")
    found = re.fullmatch(form, stem)
    return found.group(1) if found else "unknown"


def recorded(planned: Json) -> tuple[datetime.datetime, str] | None:
    """Returns the beginning of a clip and the origin of this time: "name", "container" or "file".

    `planned` is a line of the plan. The time is UTC, or as in the clip's name. None for a clip that cannot be read.
    """
    if "recorded" not in planned:
        return None
    return datetime.datetime.fromisoformat(planned["recorded"]), planned["recorded_from"]


def is_of_older_version(plan: Path) -> bool:
    """Returns whether a plan lacks the times at which the clips were recorded."""
    lines = [json.loads(line) for line in plan.read_text().splitlines()] if plan.is_file() else []
    return any("piece" in line and "recorded" not in line for line in lines)


def binary(given: str, called_from: Path, root: Path) -> str:
    """Returns the path of the program: the given one, else that of the checkout `root`, else the one on PATH."""
    if given:
        path = called_from / given if "/" in given else shutil.which(given)
        if path is None or not os.access(path, os.X_OK):
            raise SystemExit(f"roadplane={given}: there is no such program")
        return str(Path(path).resolve())
    built = root / "target/release/roadplane"
    found = str(built) if os.access(built, os.X_OK) else shutil.which("roadplane")
    if found is None:
        raise SystemExit(
            f"the program was not found: neither {built} nor roadplane on PATH; build it with "
            "`cargo build --release`, or name it: --config roadplane=/path/to/roadplane"
        )
    return found
