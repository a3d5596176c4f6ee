"""Writes the tracks of all clips as one dataset, which DuckDB and pandas read as one table.

  dataset.py [--camera-id ID] STATUS RESULT_STATUS…

The files are dataset/camera=…/day=…/CLIP.parquet. The columns are those of tracks.parquet, `clip`, and `moment`: the
date and time of a row (UTC, or as in the clip's name). A clip is filed under the day on which it begins. The plan of
the night has the beginning of each clip.
"""

import argparse
import datetime
import json
import os
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from clips import camera_of, recorded
from step import read_json, write_json

ROOT = Path("dataset")
# Time of a clip that the plan does not have.
UNKNOWN = datetime.datetime(1970, 1, 1)


def add(tracks: Path, stem: str, begun: datetime.datetime, to: Path) -> int:
    """Writes a clip's rows in chunks; returns their number."""
    to.parent.mkdir(parents=True, exist_ok=True)
    temp = to.with_name(f".{to.name}")
    rows = 0
    with pq.ParquetFile(tracks) as file:
        schema = file.schema_arrow.append(pa.field("clip", pa.string())).append(pa.field("moment", pa.timestamp("us")))
        with pq.ParquetWriter(temp, schema, compression="zstd") as writer:
            for batch in file.iter_batches():
                micros = pc.cast(pc.round(pc.multiply(batch.column("time_s"), 1e6)), pa.int64())
                moment = pc.add(pa.scalar(begun, pa.timestamp("us")), pc.cast(micros, pa.duration("us")))
                clip = pa.array([stem] * len(batch), pa.string())
                writer.write_batch(pa.RecordBatch.from_arrays([*batch.columns, clip, moment], schema=schema))
                rows += len(batch)
    os.replace(temp, to)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--camera-id", default="")
    parser.add_argument("status")
    parser.add_argument("results", nargs="*")
    args = parser.parse_args()
    wanted: set[Path] = set()
    rows: dict[str, int] = {}
    planned = {line["stem"]: line for line in map(json.loads, Path("steps/plan.jsonl").read_text().splitlines())}
    for path in args.results:
        result = read_json(path)
        if "made" not in result:
            continue
        stem = result["stem"]
        begun, _ = recorded(planned[stem]) or (UNKNOWN, "")
        to = ROOT / f"camera={camera_of(stem, args.camera_id)}" / f"day={begun.date()}" / f"{stem}.parquet"
        tracks = Path(result["made"]) / "tracks.parquet"
        wanted.add(to)
        if to.is_file() and to.stat().st_mtime >= tracks.stat().st_mtime:
            rows[stem] = pq.read_metadata(to).num_rows
        else:
            rows[stem] = add(tracks, stem, begun, to)
    # A clip may have another camera or day than before, or be lost now.
    for path in ROOT.glob("camera=*/day=*/*.parquet"):
        if path not in wanted:
            path.unlink()
    made = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    write_json(args.status, {"outcome": "done", "made": made, "clips": len(rows), "rows": sum(rows.values())})


if __name__ == "__main__":
    main()
