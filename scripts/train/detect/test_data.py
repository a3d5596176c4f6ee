"""Tests of the pictures to learn from and their views; they need PyTorch."""

# ruff: noqa: E402

from __future__ import annotations

import base64
import math
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")

from roadplane_train.batches import prepared
from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.augment import PADDING, View, degrade, letterbox, random_view
from roadplane_train.detect.data import Sampler, batch_of, whole_pictures
from roadplane_train.detect.frames import stills_of
from roadplane_train.detect.outlines import bounds, octagon, visible_outline
from roadplane_train.detect.panoramas import exposed, write_panoramas
from roadplane_train.detect.pictures import IGNORED, Picture, _corners_px, empty_pictures, labelled_picture, rendered_pictures
from roadplane_train.render.camera import world_from_car

LOTS = REPOSITORY / "tests/data/lots/scenes"


@pytest.fixture(scope="module")
def lots() -> list[Picture]:
    """Returns the renderings of the repository."""
    return rendered_pictures(LOTS)


@pytest.fixture
def marked(tmp_path: Path) -> Picture:
    """Returns a picture of 600 × 400 px with one bright vehicle, 200…300 and 150…190 px, on dark ground."""
    image = np.full((400, 600, 3), 30, np.uint8)
    image[150:190, 200:300] = (60, 120, 240)  # BGR
    cv2.imwrite(str(tmp_path / "marked.png"), image)
    corners = np.array([[200.0, 150], [300, 150], [300, 190], [200, 190]])
    return Picture(tmp_path / "marked.png", (600, 400), (corners,), (0,), real=False)


def bright(pixels: np.ndarray) -> np.ndarray:
    """Returns the box around the vehicle's pixels."""
    rows, columns = np.nonzero(pixels[..., 0] > 135)
    return np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])


@pytest.mark.parametrize("roll_deg", [0, 20, -35])
@pytest.mark.parametrize("scale", [0.5, 1.0, 1.4])
@pytest.mark.parametrize("mirrored", [False, True])
def test_boxes_follow_the_pixels(marked: Picture, roll_deg: float, scale: float, mirrored: bool) -> None:
    view = View((260.0, 190.0), scale, math.radians(roll_deg), mirrored)
    pixels = view.pixels(marked.read())
    boxes, classes = view.boxes(marked)
    assert pixels.shape == (416, 416, 3) and classes.tolist() == [0]
    np.testing.assert_allclose(bright(pixels), boxes[0], atol=1.6)
    y, x = int(boxes[0, 1::2].mean()), int(boxes[0, ::2].mean())
    np.testing.assert_allclose(pixels[y, x], [240, 120, 60], atol=3, err_msg="RGB")


def test_a_letterbox_shows_the_whole_picture(marked: Picture) -> None:
    pixels = letterbox(marked.size_px).pixels(marked.read())
    assert (pixels[:69] == PADDING).all() and (pixels[-69:] == PADDING).all()
    np.testing.assert_allclose(letterbox((600, 400)).boxes(marked)[0][0], np.array([200, 250, 300, 290]) * 416 / 600, atol=0.01)


def test_vehicles_at_the_border_are_cut_or_ignored(marked: Picture) -> None:
    boxes, classes = View((300.0 + 208 - 60, 170.0), 1.0).boxes(marked)
    assert boxes[0].tolist() == [0, 188, 60, 228] and classes.tolist() == [0]
    assert View((300.0 + 208 - 20, 170.0), 1.0).boxes(marked)[1].tolist() == [IGNORED]
    assert len(View((300.0 + 208 + 1, 170.0), 1.0).boxes(marked)[0]) == 0
    assert View((250.0, 170.0), 0.09).boxes(marked)[1].tolist() == [IGNORED], "too small"


def test_renderings_have_their_visible_boxes(lots: list[Picture]) -> None:
    assert len(lots) == 62 and {p.real for p in lots} == {False}
    still = next(p for p in lots if p.path.name == "still_0000.jpg")
    assert still.size_px == (1280, 720) and still.read().shape == (720, 1280, 3)
    box = bounds(still.outlines[0])  # of the first car, cut by the picture's lower border
    np.testing.assert_allclose(box, np.array([70.05, 632.08, 236.39, 719.5]) + 0.5, atol=0.02)
    clip = next(p for p in lots if p.path.suffix == ".mp4")
    assert clip.read().shape[:2] == clip.size_px[::-1]


def test_a_hidden_part_is_no_part_of_the_outline() -> None:
    diamond = np.array([[10.0, 0], [20, 10], [10, 20], [0, 10]])
    whole, visible = np.array([0.0, 0, 20, 20]), np.array([0.0, 0, 10, 20])
    outline = visible_outline(diamond, whole, visible)
    np.testing.assert_allclose(bounds(outline), visible, atol=1e-6)
    assert not ((outline[:, 0] < 1) & (outline[:, 1] < 5)).any(), "the left corners stay cut"
    everywhere = visible_outline(diamond, whole, whole)
    assert sorted(map(tuple, everywhere.round(6).tolist())) == sorted(map(tuple, diamond.tolist()))


def test_rolled_boxes_of_photographs_are_as_large_as_those_of_cars(lots: list[Picture]) -> None:
    """Real pictures have boxes alone: a rolled octagon stands for the car. Checked on rendered cars."""
    ratios = []
    for degrees in (-30, -20, -10, 10, 20, 30):
        matrix = View((0, 0), 1.0, math.radians(degrees)).matrix()[:, :2]
        for picture in lots:
            for outline in (o for o, kind in zip(picture.outlines, picture.classes, strict=True) if kind != IGNORED):
                true, found = bounds(outline @ matrix.T), bounds(octagon(bounds(outline)) @ matrix.T)
                ratios.append((found[2:] - found[:2]) / (true[2:] - true[:2]))
    np.testing.assert_allclose(np.mean(ratios, 0), 1, atol=0.02)


def record(labels: list, teacher: list, file: str = "train/a.jpg") -> Picture:
    """Returns the picture of a line of train.jsonl."""
    return labelled_picture(Path("."), {"file": file, "size_px": [416, 416], "labels": labels, "teacher": teacher})


def test_labels_and_teachers_are_joined_by_the_rules() -> None:
    picture = record(
        [
            [0, 0, 100, 100, "bus"],
            [200, 0, 300, 100, "ambulance"],
            [0, 200, 100, 300, "motorcycle"],
            [310, 200, 400, 290, "ambulance"],
        ],
        [
            [0, 0, 100, 95, 0.9, "truck"],  # the label's class counts
            [200, 0, 300, 90, 0.8, "truck"],  # the ambulance's class
            [200, 200, 300, 300, 0.31, "car"],
            [320, 320, 400, 400, 0.2, "car"],
            [120, 0, 180, 60, 0.11, "car"],  # too uncertain
            [120, 320, 180, 380, 0.9, "moto"],
        ],
    )
    found = {tuple(bounds(o).astype(int).tolist()): kind for o, kind in zip(picture.outlines, picture.classes, strict=True)}
    assert found == {
        (0, 0, 100, 100): 2,
        (200, 0, 300, 100): 1,
        (0, 200, 100, 300): 3,
        (310, 200, 400, 290): 0,
        (200, 200, 300, 300): 0,
        (320, 320, 400, 400): IGNORED,
        (120, 320, 180, 380): 3,
    }
    assert picture.real


def test_pictures_to_measure_on_are_refused() -> None:
    with pytest.raises(ValueError, match="for measuring only"):
        record([], [], "eval/v25.jpg")


def test_batches_depend_on_the_seed_and_the_step_alone(lots: list[Picture], marked: Picture) -> None:
    def sampler() -> Sampler:
        return Sampler([lots[:5], [], [marked]], [0.7, 0.2, 0.3], 4, 9, 224)

    first = sampler()[3]
    for jobs in (0, 2):
        _, again, after = prepared(sampler(), range(2, 5), jobs)
        assert torch.equal(first.image, again.image)
        assert torch.equal(first.targets.boxes, again.targets.boxes)
        assert torch.equal(first.targets.positive, again.targets.positive)
        assert not torch.equal(first.image, after.image)
    assert first.image.shape == (4, 3, 224, 224) and float(first.input(torch.device("cpu")).max()) <= 1
    assert first.image.is_contiguous(memory_format=torch.channels_last)
    with pytest.raises(ValueError, match="no pictures"):
        Sampler([[], []], [0.5, 0.5], 4, 9)


def test_views_show_vehicles_of_all_sizes_and_little_padding(lots: list[Picture]) -> None:
    rng = np.random.default_rng(1)
    sizes, empty, padding = [], 0, []
    for k in range(300):
        picture = lots[k % len(lots)]
        view = random_view(rng, picture)
        boxes, classes = view.boxes(picture)
        boxes = boxes[classes != IGNORED]
        sizes += np.sqrt((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])).tolist()
        empty += not len(boxes)
        if k < 20:
            grey = np.full((picture.size_px[1], picture.size_px[0], 3), 10, np.uint8)
            padding.append((view.pixels(grey) == PADDING).mean())
    small, middle, large = (np.mean([low <= s < high for s in sizes]) for low, high in ((0, 28), (28, 90), (90, 500)))
    assert min(small, middle, large) > 0.05 and empty < 60 and np.mean(padding) < 0.35


def test_a_worse_camera_keeps_the_picture() -> None:
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, 32:] = (200, 160, 120)
    darker = 0
    for seed in range(60):
        found = degrade(np.random.default_rng(seed), image)
        assert found.shape == image.shape and found.dtype == np.uint8
        assert found[:, 40:].mean() > found[:, :24].mean() + 5
        darker += found.mean() < 0.5 * image.mean()
    assert 2 <= darker <= 25


def test_photographs_without_vehicles_have_no_boxes(tmp_path: Path, marked: Picture) -> None:
    (picture,) = empty_pictures(tmp_path)
    assert picture.size_px == (600, 400) and picture.real and not picture.outlines
    (batch,) = whole_pictures([picture])
    assert batch.image.shape == (1, 3, 416, 416) and len(batch.boxes[0]) == 0
    boxes, classes = np.array([[1, 2, 30, 40], [5, 5, 9, 9]], np.float32), np.array([0, IGNORED])
    joined = batch_of([(np.zeros((416, 416, 3), np.uint8), boxes, classes, True)])
    assert joined.boxes[0].tolist() == [[1, 2, 30, 40]] and joined.ignored[0].tolist() == [[5, 5, 9, 9]]


def test_frames_of_a_clip_become_stills(tmp_path: Path) -> None:
    clip = LOTS / "clip_0001.truth.json.gz"
    count = stills_of(clip, tmp_path, 4.0)
    stills = rendered_pictures(tmp_path)
    assert len(stills) == count == 3
    assert stills_of(clip, tmp_path, 4.0) == 3 and len(list(tmp_path.iterdir())) == 6
    first, whole = stills[0], next(p for p in rendered_pictures(LOTS) if p.path.name == "clip_0001.mp4")
    assert first.classes == whole.classes and first.read().shape == whole.read().shape
    assert all(np.array_equal(a, b) for a, b in zip(first.outlines, whole.outlines, strict=True))
    assert np.abs(first.read().astype(float) - whole.read()).mean() < 3


def test_panoramas_become_photographs(tmp_path: Path) -> None:
    radiance = np.full((8, 16, 3), 0.5, np.float32)
    radiance[2:4] = 40.0  # the sun
    done, data = cv2.imencode(".exr", radiance)
    assert done
    with tarfile.open(tmp_path / "package.tgz", "w:gz") as archive:
        for name in ("city", "park", "sky"):
            (tmp_path / "text").write_text(f"export default 'data:;base64,{base64.b64encode(data.tobytes()).decode()}'")
            archive.add(tmp_path / "text", f"package/hdri/{name}.exr.js")
    assert write_panoramas(tmp_path / "package.tgz", tmp_path / "out") == 2
    (learn,) = empty_pictures(tmp_path / "out/learn")
    assert learn.path.name == "park.png" and learn.size_px == (16, 8)
    assert (tmp_path / "out/measure/sky.png").exists()
    pixels = exposed(radiance)
    assert pixels.dtype == np.uint8 and pixels[3, 0, 0] > pixels[0, 0, 0] > 0


def test_lorries_have_the_corners_of_their_cuboid() -> None:
    camera = {"image_size_px": [1280, 720], "focal_px": 1000.0, "height_m": 2.0, "tilt_rad": 0.0, "roll_rad": 0.0}
    # The lorry is seen from the side: 20 m ahead, and its nearest side at 18.75 m.
    corners = _corners_px(camera, world_from_car(0.0, 20.0, 0.0), [8.0, 2.5, 3.0])
    assert corners.shape == (8, 2)
    np.testing.assert_allclose(corners.max(0) - corners.min(0), [8000 / 18.75, 3000 / 18.75], rtol=0.02)
    assert not len(_corners_px(camera, world_from_car(0.0, 1.0, 0.0), [8.0, 2.5, 3.0]))
