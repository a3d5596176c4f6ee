"""Reads pictures to learn from: renderings with truth, real pictures with labels, pictures without vehicles."""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from roadplane_train.detect.model import CLASSES
from roadplane_train.detect.outlines import octagon, visible_outline
from roadplane_train.render.camera import Camera

IGNORED = -1
# Agreement of the teachers from which their box counts as true, and from which it is ignored at least.
TEACHER_TRUE, TEACHER_IGNORED = 0.3, 0.12
SAME_VEHICLE_IOU = 0.5
# Cars that are hidden more than this are ignored.
SMALLEST_VISIBLE_SHARE = 0.25
# Pixel (0, 0) of truth files is the centre of the first pixel.
CORNER_FROM_CENTRE_PX = 0.5
NEAREST_M = 0.5  # depth of a corner that is projected
# None of these may be learnt from.
MEASURED_ONLY = ("eval", "rolled")
CLASS_NUMBERS = {name: number for number, name in enumerate(CLASSES)}
AMBULANCES = CLASSES[:3]  # classes that an ambulance may have
CLASS_NUMBERS["moto"] = CLASS_NUMBERS["motorcycle"]  # the teachers' name


@dataclass(frozen=True)
class Picture:
    """A picture with the outlines of its vehicles."""

    path: Path
    size_px: tuple[int, int]
    outlines: tuple[np.ndarray, ...]
    classes: tuple[int, ...]  # numbers in CLASSES, or IGNORED
    real: bool
    frame: int = 0  # of a video
    mistakes: tuple[np.ndarray, ...] = ()  # boxes [4] that a net took for vehicles, of `detect mistakes`

    def read(self) -> np.ndarray:
        """Returns the RGB pixels."""
        if self.path.suffix == ".mp4":
            video = cv2.VideoCapture(str(self.path))
            video.set(cv2.CAP_PROP_POS_FRAMES, self.frame)
            done, image = video.read()
        else:
            image = cv2.imread(str(self.path))
            done = image is not None
        if not done:
            raise ValueError(f"{self.path} cannot be read")
        return image[..., ::-1]


def rendered_pictures(folder: Path) -> list[Picture]:
    """Returns the stills and the first frames of the clips of a data set of `roadplane-train render`."""
    pictures = []
    for path in sorted(folder.rglob("*.truth.json.gz")) + sorted(folder.rglob("*.truth.json")):
        opened = gzip.open(path, "rt") if path.suffix == ".gz" else path.open()
        with opened as file:
            pictures.append(_rendered(path.parent, json.load(file)))
    return pictures


def _rendered(folder: Path, truth: dict) -> Picture:
    models = {model["id"]: model for model in truth["models"]}
    outlines, classes = [], []
    for car in truth["frames"][0]["cars"]:
        whole, visible = (np.array(car[name]) + CORNER_FROM_CENTRE_PX for name in ("whole_box", "box"))
        points = [point[:2] for point in car["keypoints_px"] or [] if point]
        if len(points) < 8:  # lorries, buses and motorcycles have no keypoints
            points = _corners_px(truth["camera"], np.array(car["world_from_car"]), models[car["id"]]["dims_m"])
        if len(points) >= 8:
            outlines.append(visible_outline(np.array(points) + CORNER_FROM_CENTRE_PX, whole, visible))
        else:
            outlines.append(octagon(visible))
        seen = car["visible_share"] >= SMALLEST_VISIBLE_SHARE
        classes.append(CLASS_NUMBERS.get(models[car["id"]]["class"], IGNORED) if seen else IGNORED)
    size = tuple(truth["camera"]["image_size_px"])
    return Picture(folder / truth["media"], size, tuple(outlines), tuple(classes), real=False)


def _corners_px(camera: dict, world_from_car: np.ndarray, dims_m: list[float]) -> np.ndarray:
    """Returns the corners [8, 2] of a vehicle's cuboid, whose origin is at half its length; none if one is behind."""
    length, width, height = dims_m
    corners = [(x, y, z, 1.0) for x in (-length / 2, length / 2) for y in (-width / 2, width / 2) for z in (0.0, height)]
    pixels, depth = Camera.of(camera).pixel_from_world((np.array(corners) @ world_from_car.T)[:, :3])
    return pixels if depth.min() >= NEAREST_M else np.zeros((0, 2))


def labelled_pictures(path: Path) -> list[Picture]:
    """Returns the real pictures of a `train.jsonl` with labels and boxes of teachers."""
    lines = path.read_text().splitlines()
    return [labelled_picture(path.parent, json.loads(line)) for line in lines if line.strip()]


def labelled_picture(folder: Path, record: dict) -> Picture:
    """Returns one real picture.

    Labels are true boxes. So are teacher boxes from `TEACHER_TRUE` on that overlap no label; less certain ones are
    ignored. A label's class counts; an ambulance has the class of the teacher's box there, else it is a car (a van).
    """
    if set(Path(record["file"]).parts) & set(MEASURED_ONLY):
        raise ValueError(f"{record['file']} is for measuring only")
    boxes, classes = [], []
    teachers = [(np.array(row[:4]), row[4], row[5]) for row in record["teacher"]]
    for *box, name in record["labels"]:
        box = np.array(box)
        if name == "ambulance":
            known = [kind for other, _, kind in teachers if _iou(box, other) >= SAME_VEHICLE_IOU and kind in AMBULANCES]
            name = known[0] if known else "car"
        boxes.append(box)
        classes.append(CLASS_NUMBERS.get(name, IGNORED))
    labelled = list(boxes)
    for box, p, name in teachers:
        if p < TEACHER_IGNORED or any(_iou(box, label) >= SAME_VEHICLE_IOU for label in labelled):
            continue
        boxes.append(box)
        classes.append(CLASS_NUMBERS.get(name, IGNORED) if p > TEACHER_TRUE else IGNORED)
    outlines = tuple(octagon(box) for box in boxes)
    return Picture(folder / record["file"], tuple(record["size_px"]), outlines, tuple(classes), real=True)


def empty_pictures(folder: Path) -> list[Picture]:
    """Returns all pictures of a folder of photographs that show no vehicle."""
    found = []
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() in (".jpg", ".jpeg", ".png")):
        image = cv2.imread(str(path))
        if image is None:
            raise ValueError(f"{path} cannot be read")
        found.append(Picture(path, (image.shape[1], image.shape[0]), (), (), real=True))
    return found


def with_mistakes(pictures: list[Picture], file: Path | None) -> list[Picture]:
    """Returns the pictures with the mistakes that the file lists; it may be missing."""
    if file is None or not file.exists():
        return pictures
    listed = json.loads(file.read_text())
    return [replace(p, mistakes=tuple(map(np.array, listed.get(key_of(p), ())))) for p in pictures]


def key_of(picture: Picture) -> str:
    """Returns the name of a picture in the file."""
    return f"{picture.path.parent.parent.name}/{picture.path.parent.name}/{picture.path.name}"


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    common = float(np.prod(np.maximum(sides, 0)))
    return common / max(float(np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2])) - common, 1e-9)
