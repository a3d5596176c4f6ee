"""Tests of the truth files in `tests/data`: they are consistent. They need NumPy only."""

from __future__ import annotations

import tempfile
import unittest
from pathlib import Path

import numpy as np

from roadplane_train.json_files import read_json, write_json
from roadplane_train.render.camera import Camera

DATA = Path(__file__).resolve().parents[3] / "tests" / "data"


def truth_files() -> list[Path]:
    """Returns the truth files of the demo clip and of the committed split."""
    index = DATA / "lots" / "dataset.json"
    items = [index.parent / item for item in read_json(index)["items"]]
    return [DATA / "lot.truth.json", *items]


class JsonFilesTest(unittest.TestCase):
    """Tests that files are read as written, and that the same record gives the same bytes."""

    def test_plain_and_gzipped(self) -> None:
        record = {"a": [1.5, None, "ü"], "b": {}}
        with tempfile.TemporaryDirectory() as folder:
            for name in ("x.json", "x.json.gz"):
                path = Path(folder) / name
                write_json(path, record)
                first = path.read_bytes()
                write_json(path, record)
                self.assertEqual(path.read_bytes(), first)
                self.assertEqual(read_json(path), record)
                self.assertEqual([p.name for p in Path(folder).glob("*.part")], [])


class TruthTest(unittest.TestCase):
    """Tests on all items."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.items = {path.name: read_json(path) for path in truth_files()}

    def test_media_and_schema(self) -> None:
        for path in truth_files():
            item = self.items[path.name]
            self.assertEqual(item["schema"], "roadplane.truth/1")
            self.assertTrue((path.parent / item["media"]).exists(), path.name)
            self.assertEqual(item["kind"] == "still", item["fps"] is None)

    def test_keypoints_are_the_projected_model(self) -> None:
        for name, item in self.items.items():
            record = item["camera"]
            camera = Camera(
                tuple(record["image_size_px"]), record["focal_px"], record["height_m"], record["tilt_rad"], record["roll_rad"]
            )
            np.testing.assert_allclose(camera.camera_from_world, record["camera_from_world"], atol=1e-9)
            normal, offset = camera.plane_in_camera
            np.testing.assert_allclose(
                [*normal, offset], [*record["plane_in_camera"]["normal"], record["plane_in_camera"]["offset_m"]], atol=1e-9
            )
            models = {m["id"]: points(m["keypoints_in_car"]) for m in item["models"]}
            for car in (car for frame in item["frames"] for car in frame["cars"]):
                pose = np.array(car["world_from_car"])
                pixels, _ = camera.pixel_from_world(models[car["id"]] @ pose[:3, :3].T + pose[:3, 3])
                np.testing.assert_allclose(pixels, points(car["keypoints_px"])[:, :2], atol=0.01, err_msg=name)

    def test_cars_are_on_the_ground_inside_their_boxes(self) -> None:
        visible, outside = 0, 0
        for name, item in self.items.items():
            width, height = item["camera"]["image_size_px"]
            for car in (car for frame in item["frames"] for car in frame["cars"]):
                pose = np.array(car["world_from_car"])
                np.testing.assert_allclose(pose[2], (0, 0, 1, 0), atol=1e-6)
                self.assertTrue(0.15 <= car["visible_share"] <= 1, name)
                x0, y0, x1, y1 = car["box"]
                self.assertTrue(-0.51 <= x0 < x1 <= width - 0.49 and -0.51 <= y0 < y1 <= height - 0.49, (name, car["box"]))
                keypoints = points(car["keypoints_px"])
                seen = keypoints[keypoints[:, 2] == 1]
                margin = 2 + 0.02 * max(x1 - x0, y1 - y0)
                inside = ((seen[:, :2] >= [x0 - margin, y0 - margin]) & (seen[:, :2] <= [x1 + margin, y1 + margin])).all(1)
                visible, outside = visible + len(seen), outside + int((~inside).sum())
        self.assertLess(outside, 1e-3 * visible)  # few: keypoints seen through leaves, where no cell shows the car itself

    def test_speed_is_the_change_of_place_and_names_fit(self) -> None:
        activities = set()
        for name, item in self.items.items():
            if item["kind"] == "still":
                continue
            tracks: dict[int, list] = {}
            for frame in item["frames"]:
                for car in frame["cars"]:
                    tracks.setdefault(car["id"], []).append((frame["time_s"], np.array(car["world_from_car"]), car))
            for track in tracks.values():
                for before, now, after in zip(track, track[1:], track[2:], strict=False):
                    span = after[0] - before[0]
                    activity, speed = now[2]["activity"], now[2]["speed_mps"]
                    activities.add(activity)
                    self.assertEqual(activity == "parked", speed == 0, name)
                    if activity == "reversing":
                        self.assertLess(speed, 0)
                    elif activity != "parking":
                        self.assertGreaterEqual(speed, 0)
                    if span > 2.5 / item["fps"]:
                        continue  # invisible in between
                    moved = np.linalg.norm(after[1][:2, 3] - before[1][:2, 3]) / span
                    self.assertLess(abs(moved - abs(speed)), 0.12, (name, now[2]["id"], now[0]))
                    turned = (after[1][:2, :2] @ before[1][:2, :2].T)[1, 0]
                    if activity == "turning_left":
                        self.assertGreater(turned, -1e-5)
                    if activity == "turning_right":
                        self.assertLess(turned, 1e-5)
        self.assertLessEqual(
            {"parked", "moving", "turning_left", "turning_right", "u_turn", "stopping", "starting", "reversing", "parking"},
            activities,
        )

    def test_every_still_has_five_large_cars(self) -> None:
        for name, item in self.items.items():
            for frame in item["frames"] if item["kind"] == "still" else []:
                sides = [max(c["box"][2] - c["box"][0], c["box"][3] - c["box"][1]) for c in frame["cars"]]
                self.assertGreaterEqual(sum(side >= 40 for side in sides), 5, name)
                self.assertLessEqual(len(sides), 40, name)


def points(rows: list) -> np.ndarray:
    """Returns rows of three, (36, 3), with NaN for null."""
    return np.array([[np.nan] * 3 if row is None else row for row in rows], float)
