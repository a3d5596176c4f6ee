"""Compares our metrics with those of TrackEval and pycocotools, on the same random files."""

import contextlib
import csv
import io
import json
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval
from trackeval.metrics import CLEAR, HOTA, Identity

PROGRAM = Path(__file__).resolve().parents[2] / "target/release/roadplane-lab"
PLACES = 6
SEEDS = range(10)


def ours(what: str, truth: Path, found: Path) -> list[dict[str, str]]:
    """Returns the rows of the first table that `roadplane-lab eval` writes."""
    out = truth.parent / "out"
    command = [PROGRAM, "eval", what, found, "--truth", truth, "--out", out]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with next(out.glob("01-*.csv")).open() as table:
        return list(csv.DictReader(table))


def random_tracks(rng: np.random.Generator) -> tuple[dict, dict]:
    """Returns boxes by frame and id: true ones, and estimated ones with jitter, gaps, switched and false tracks."""
    truth, found = {}, {}
    names = rng.permutation(100)
    for car in range(8):
        x, y = rng.uniform(0, 600, 2)
        size = rng.uniform(30, 120, 2)
        start, end = sorted(rng.integers(1, 60, 2))
        for frame in range(start, end + 1):
            x, y = (x, y) + rng.normal(0, 6, 2)
            if rng.random() < 0.95:
                truth.setdefault(frame, {})[car + 1] = (x, y, *size)
            if rng.random() < 0.03:
                names[car] = names[20 + rng.integers(30)]
            if rng.random() < 0.85:
                box = np.array([x, y, *size]) + rng.normal(0, 8, 4)
                found.setdefault(frame, {})[int(names[car]) + 1] = (*box[:2], *np.maximum(box[2:], 5))
    for _ in range(40):
        frame = int(rng.integers(1, 64))
        found.setdefault(frame, {})[200 + int(rng.integers(4))] = (*rng.uniform(0, 600, 2), *rng.uniform(30, 120, 2))
    return truth, found


def iou(truth: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Returns the overlap of each pair of boxes (left, top, width, height)."""
    low = np.maximum(truth[:, None, :2], found[None, :, :2])
    high = np.minimum((truth[:, :2] + truth[:, 2:])[:, None], (found[:, :2] + found[:, 2:])[None])
    common = np.prod(np.maximum(high - low, 0), axis=2)
    area = np.prod(truth[:, 2:], axis=1)[:, None] + np.prod(found[:, 2:], axis=1)[None]
    return common / (area - common)


def track_eval(truth: dict, found: dict) -> dict[str, float]:
    """Returns TrackEval's results, in our units."""
    index = [{name: i for i, name in enumerate(sorted({n for f in side.values() for n in f}))} for side in (truth, found)]
    data = {"gt_ids": [], "tracker_ids": [], "similarity_scores": []}
    for frame in sorted(truth.keys() | found.keys()):
        boxes = [side.get(frame, {}) for side in (truth, found)]
        for key, side, names in zip(("gt_ids", "tracker_ids"), boxes, index, strict=True):
            data[key].append(np.array([names[n] for n in side], dtype=int))
        arrays = [np.array(list(side.values()), dtype=float).reshape(-1, 4) for side in boxes]
        data["similarity_scores"].append(iou(*arrays))
    data["num_timesteps"] = len(data["gt_ids"])
    data["num_gt_ids"], data["num_tracker_ids"] = len(index[0]), len(index[1])
    data["num_gt_dets"] = sum(map(len, data["gt_ids"]))
    data["num_tracker_dets"] = sum(map(len, data["tracker_ids"]))
    quiet = {"PRINT_CONFIG": False}
    hota = HOTA().eval_sequence(data)
    clear = CLEAR(quiet).eval_sequence(data)
    identity = Identity(quiet).eval_sequence(data)
    return {f"{name}, %": 100 * np.mean(hota[name]) for name in ("HOTA", "DetA", "AssA", "LocA")} | {
        "MOTA, %": 100 * clear["MOTA"],
        "MOTP, %": 100 * clear["MOTP"],
        "switches": clear["IDSW"],
        "IDF1, %": 100 * identity["IDF1"],
        "IDP, %": 100 * identity["IDP"],
        "IDR, %": 100 * identity["IDR"],
    }


def write_mot(path: Path, frames: dict) -> None:
    lines = [
        f"{frame},{name},{','.join(repr(float(v)) for v in box)},1,-1,-1,-1\n"
        for frame, boxes in sorted(frames.items())
        for name, box in boxes.items()
    ]
    path.write_text("".join(lines))


def random_boxes(rng: np.random.Generator) -> tuple[dict, list]:
    """Returns COCO annotations and results of two categories with crowds, false boxes and duplicates."""
    categories = [{"id": 3, "name": "car"}, {"id": 8, "name": "truck"}]
    images = [{"id": int(i)} for i in rng.permutation(30)]
    annotations, results = [], []
    for image in images:
        for _ in range(rng.integers(0, 9)):
            side = np.exp(rng.uniform(np.log(8), np.log(250), 2))
            box = np.concatenate([rng.uniform(0, 900, 2), side])
            category = int(rng.choice([3, 3, 8]))
            crowd = int(rng.random() < 0.1)
            area = float(np.prod(side) * rng.uniform(0.6, 1.0))
            annotation = {"id": len(annotations) + 1, "image_id": image["id"], "category_id": category, "area": area}
            annotations.append(annotation | {"bbox": box.tolist(), "iscrowd": crowd})
            for _ in range(rng.integers(0, 3) + 3 * crowd):
                near = box + rng.normal(0, 0.08, 4) * np.tile(side, 2)
                results.append((image["id"], category, np.maximum(near, 1.0), rng.random()))
        for _ in range(rng.integers(0, 4)):
            wrong = np.concatenate([rng.uniform(0, 900, 2), rng.uniform(8, 250, 2)])
            results.append((image["id"], int(rng.choice([3, 8])), wrong, rng.random() * 0.7))
    # More than the hundred that count per picture.
    for _ in range(130):
        results.append((images[0]["id"], 3, np.concatenate([rng.uniform(0, 900, 2), rng.uniform(8, 250, 2)]), rng.random()))
    found = [{"image_id": i, "category_id": c, "bbox": box.tolist(), "score": float(s)} for i, c, box, s in results]
    return {"images": images, "annotations": annotations, "categories": categories}, found


def coco_eval(truth: Path, found: Path, category: int) -> dict[str, float]:
    """Returns pycocotools' results, in our units; -1 if there is nothing to find."""
    with contextlib.redirect_stdout(io.StringIO()):
        annotations = COCO(str(truth))
        evaluation = COCOeval(annotations, annotations.loadRes(str(found)), "bbox")
        evaluation.params.catIds = [category]
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    names = {0: "AP, %", 1: "AP50, %", 3: "AP small, %", 4: "AP medium, %", 5: "AP large, %"}
    return {name: 100 * evaluation.stats[i] for i, name in names.items()}


class Peers(unittest.TestCase):
    """Tests that equal files give equal numbers."""

    def compare(self, mine: dict[str, str], theirs: dict[str, float]) -> None:
        for name, value in theirs.items():
            self.assertAlmostEqual(float(mine[name]) / 100, value / 100, PLACES, name)

    def test_tracks(self) -> None:
        for seed in SEEDS:
            with self.subTest(seed=seed), tempfile.TemporaryDirectory() as folder:
                truth, found = Path(folder, "gt.txt"), Path(folder, "tracks.txt")
                frames = random_tracks(np.random.default_rng(seed))
                write_mot(truth, frames[0])
                write_mot(found, frames[1])
                theirs = track_eval(*frames)
                self.assertTrue(0.2 < theirs["HOTA, %"] / 100 < 0.9 and theirs["switches"] > 0, theirs)
                self.compare(ours("tracks", truth, found)[0], theirs)

    def test_boxes(self) -> None:
        for seed in SEEDS:
            with self.subTest(seed=seed), tempfile.TemporaryDirectory() as folder:
                truth, found = Path(folder, "gt.json"), Path(folder, "found.json")
                annotations, results = random_boxes(np.random.default_rng(seed))
                truth.write_text(json.dumps(annotations))
                found.write_text(json.dumps(results))
                rows = {row["system"]: row for row in ours("boxes", truth, found)}
                for category in annotations["categories"]:
                    theirs = coco_eval(truth, found, category["id"])
                    self.assertTrue(all(0.002 < value / 100 < 0.98 for value in theirs.values()), theirs)
                    self.compare(rows[category["name"]], theirs)
