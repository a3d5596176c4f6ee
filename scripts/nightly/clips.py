"""The clips of a night: their files, their cameras, and their recording times."""

import datetime
import json
import re
from pathlib import Path

# Every file of the folder is a clip unless its name marks it as a companion. The page lists files that are no video.
BESIDE = {".txt", ".json", ".csv", ".md", ".xml", ".srt", ".sha256", ".part", ".tmp"}
TIME = re.compile(r"(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.T ]?(\d\d)[-_.:]?(\d\d)[-_.:]?(\d\d)")


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


def recorded(stem: str, path: str | Path) -> datetime.datetime:
    """Returns the beginning of a clip: the time in its name, else the time of the file's last change (UTC)."""
    found = TIME.search(stem)
    if found:
        try:
            year, month, day, hour, minute, second = map(int, found.groups())
            return datetime.datetime(year, month, day, hour, minute, second)
        except ValueError:
            pass
    try:
        return datetime.datetime.fromtimestamp(Path(path).stat().st_mtime, datetime.UTC).replace(tzinfo=None, microsecond=0)
    except OSError:
        return datetime.datetime(1970, 1, 1)
