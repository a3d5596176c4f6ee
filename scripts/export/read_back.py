"""Reads exports of a run with other people's tools, and compares them with the run, row by row.

With a clone of NIST's ActEV_Scorer, that tool also scores its export against itself.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import trackeval
import yaml
from cameras import check_rope3d, check_ucmctrack
from maps import check_geojson, check_geoparquet, check_kml
from rows import BOX, by_frame, close
from traffic import check_highd, check_ngsim, check_ottrk, check_ssam, check_sumo

PROGRAM = Path(__file__).resolve().parents[2] / "target/release/roadplane"


def trackeval_rows(dataset: type, options: dict, folder: Path, name: str, frames: int) -> np.ndarray:
    """Returns frame, id and box (left, top, width or right, height or bottom) of each row, by TrackEval's loader."""
    with tempfile.TemporaryDirectory() as temporary:
        data = Path(temporary, "trackers/ours/data")
        data.mkdir(parents=True)
        (data / f"{name}.txt").write_bytes((folder / f"{name}.txt").read_bytes())
        loader = dataset.__new__(dataset)
        loader.tracker_fol, loader.tracker_sub_fol, loader.gt_fol = str(data.parents[1]), "data", ""
        loader.data_is_zipped, loader.seq_lengths, loader.benchmark = False, {name: frames}, "ours"
        loader.__dict__.update(options)
        raw = loader._load_raw_file("ours", name, is_gt=False)
    rows = [
        np.column_stack([np.full(len(ids), frame), ids, boxes])
        for frame, (ids, boxes) in enumerate(zip(raw["tracker_ids"], raw["tracker_dets"], strict=True))
        if len(ids)
    ]
    return np.concatenate(rows)


def check_mot(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with TrackEval's loader of MOT Challenge; its frames count from 0."""
    frames = int(
        next(line for line in (folder / "seqinfo.ini").read_text().splitlines() if line.startswith("seqLength=")).split("=")[1]
    )
    options = {"valid_class_numbers": [1], "class_name_to_class_id": {"pedestrian": 1}}
    rows = trackeval_rows(trackeval.datasets.MotChallenge2DBox, options, folder, name, frames)
    run = by_frame(run)
    close(rows[:, :2], run[["frame", "track"]], 0)
    box = run[BOX].to_numpy()
    close(rows[:, 2:4], box[:, :2] + 1, 0.006)
    close(rows[:, 4:6], box[:, 2:] - box[:, :2], 0.011)
    return len(rows)


def check_kitti(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with TrackEval's loader of KITTI tracking; columns in 3D by the development kit's readme."""
    frames = int(run.frame.max()) + 1
    classes = {
        "car": 1,
        "van": 2,
        "truck": 3,
        "pedestrian": 4,
        "person": 5,
        "cyclist": 6,
        "tram": 7,
        "misc": 8,
        "dontcare": 9,
        "car_2": 1,
    }
    options = {"class_name_to_class_id": classes, "class_list": ["car", "truck", "misc"]}
    rows = trackeval_rows(trackeval.datasets.Kitti2DBox, options, folder / "label_02", name, frames)
    run = by_frame(run)
    close(rows[:, :2], run[["frame", "track"]], 0)
    close(rows[:, 2:6], run[BOX], 0.006)
    labels = pd.read_csv(folder / "label_02" / f"{name}.txt", sep=" ", header=None)
    close(labels[[10, 11, 12]], run[["height_m", "width_m", "length_m"]], 1e-4)
    if run.attrs["has_lens"]:  # KITTI has no lens distortion, so the boxes are elsewhere
        return len(rows)
    # The centre of the underside projects into the box, for boxes inside the picture.
    projection = np.array((folder / "calib" / f"{name}.txt").read_text().splitlines()[2].split()[1:], float).reshape(3, 4)
    pixel = np.column_stack([labels[[13, 14, 15]], np.ones(len(labels))]) @ projection.T
    pixel = pixel[:, :2] / pixel[:, 2:]
    inside = (labels[6] > 4) & (labels[7] > 4) & run.observed
    hits = (pixel[:, 0] > labels[6]) & (pixel[:, 0] < labels[8]) & (pixel[:, 1] > labels[7]) & (pixel[:, 1] < labels[9] + 5)
    assert hits[inside].mean() > 0.9, hits[inside].mean()
    return len(rows)


def check_kpf(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with PyYAML, as the scripts of VIRAT and MEVA read it."""
    packets = {
        kind: yaml.load((folder / f"{name}.{kind}.yml").read_text(), yaml.CSafeLoader) for kind in ("geom", "types", "activities")
    }
    boxes, run = [packet["geom"] for packet in packets["geom"] if "geom" in packet], by_frame(run)
    close([[box["ts0"], box["id1"]] for box in boxes], run[["frame", "track"]], 0)
    close([box["ts1"] for box in boxes], run.time_s, 1e-6)
    close([[float(v) for v in box["g0"].split()] for box in boxes], run[BOX], 0.006)
    close([box["conf0"] for box in boxes], run.score, 1e-4)
    kinds = {packet["types"]["id1"] for packet in packets["types"] if "types" in packet}
    assert kinds == set(run.track), kinds
    acts = [packet["act"] for packet in packets["activities"] if "act" in packet]
    for act in acts:
        first, last = act["timespan"][0]["tsr0"]
        assert 0 <= first <= last <= run.frame.max(), act
        assert act["actors"][0]["id1"] in kinds, act
    return len(boxes)


def check_actev(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Compares the boxes with the run; NIST's scorer is called apart."""
    boxes = run.set_index(["track", "frame"])[BOX].round()
    count = 0
    for instance in json.loads((folder / f"{name}.json").read_text())["activities"]:
        for thing in instance["objects"]:
            for frame, there in next(iter(thing["localization"].values())).items():
                if there:
                    x, y, w, h = (there["boundingBox"][key] for key in "xywh")
                    close([x, y, x + w, y + h], boxes.loc[(thing["objectID"], int(frame) - 1)], 1)
                    count += 1
    return count


def score_actev(scorer: Path, folder: Path, name: str) -> None:
    """Checks that NIST's scorer accepts the file, and finds every instance when it scores the file against itself."""
    output = folder / f"{name}.json"
    count = len(json.loads(output.read_text())["activities"])
    with tempfile.TemporaryDirectory() as out:
        command = [
            sys.executable,
            scorer / "ActEV_Scorer.py",
            "ActEV_SDL_V2",
            "-d",
            "-s",
            output,
            "-r",
            output,
            "-a",
            folder / "activity-index.json",
            "-f",
            folder / "file-index.json",
            "-o",
            out,
        ]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        aligned = pd.read_csv(Path(out, "alignment.csv"), sep="|")
    assert len(aligned) == count and (aligned.alignment == "CD").all(), aligned
    print(f"actev: {count} instances, by NIST's scorer")


def check_csv(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with pandas."""
    found = pd.read_csv(folder / f"{name}.csv")
    pd.testing.assert_frame_equal(found, run)
    return len(found)


CHECKS: dict[str, Callable[[Path, str, pd.DataFrame], int]] = {
    "mot": check_mot,
    "kitti": check_kitti,
    "kpf": check_kpf,
    "actev": check_actev,
    "geojson": check_geojson,
    "geoparquet": check_geoparquet,
    "kml": check_kml,
    "sumo-fcd": check_sumo,
    "ngsim": check_ngsim,
    "highd": check_highd,
    "ssam": check_ssam,
    "ottrk": check_ottrk,
    "ucmctrack": check_ucmctrack,
    "rope3d": check_rope3d,
    "csv": check_csv,
}


def main() -> None:
    """Exports, reads the files, prints a line per format."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a finished run of a camera that was not moved")
    parser.add_argument("scorer", type=Path, nargs="?", help="a clone of NIST's ActEV_Scorer")
    args = parser.parse_args()
    folder = args.run
    run = pd.read_csv(folder / "tracks.csv")
    run.attrs["has_lens"] = json.loads((folder / "camera.json").read_text())["lens"] is not None
    with tempfile.TemporaryDirectory() as out:
        subprocess.run([PROGRAM, "export", folder, "--format", "all", "--out", out], check=True, stderr=subprocess.DEVNULL)
        written = {path.name for path in Path(out).iterdir() if path.is_dir()}
        assert written <= set(CHECKS), f"without a check: {written - set(CHECKS)}"
        for name, check in CHECKS.items():
            if name in written:
                print(f"{name}: {check(Path(out, name), folder.name, run)} rows, as in the run")
            else:
                print(f"{name}: not exported, because the run lacks the data")
        if args.scorer:
            score_actev(args.scorer.resolve(), Path(out, "actev"), folder.name)


if __name__ == "__main__":
    main()
