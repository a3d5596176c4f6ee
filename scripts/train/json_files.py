"""JSON files, written whole or not at all, gzipped if the name ends in .gz."""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path


def write_json(path: Path, record: dict, indent: int | None = None) -> None:
    """Writes compact or indented JSON; the same record gives the same bytes."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    separators = (",", ":") if indent is None else (",", ": ")
    data = (json.dumps(record, separators=separators, indent=indent, allow_nan=False) + "\n").encode()
    part.write_bytes(gzip.compress(data, 9, mtime=0) if path.suffix == ".gz" else data)
    part.rename(path)


def read_json(path: Path) -> dict:
    """Reads a file of `write_json`."""
    data = path.read_bytes()
    return json.loads(gzip.decompress(data) if path.suffix == ".gz" else data)
