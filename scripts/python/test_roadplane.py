"""Tests of the Python package, on a finished run of tests/data/lot.mp4 in the folder ROADPLANE_RUN."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

import numpy as np
import pandas as pd
import polars as pl
from polars.testing import assert_frame_equal
from rerun.experimental import RrdReader

import roadplane
from roadplane import Camera, SecondPlane, View

TOP = Path(__file__).parents[2]
FIXTURE = TOP / "tests/data/geometry.json"
SCHEMA = TOP / "docs/schemas/tracks.schema.json"


class Geometry(unittest.TestCase):
    """Tests against the fixture of the Rust code."""

    def test_agrees_with_rust(self) -> None:
        fixture = json.loads(FIXTURE.read_text())
        for case in fixture["cases"]:
            width, height = fixture["image_size_px"]
            middle = ((width - 1) / 2, (height - 1) / 2)
            covariance = np.array(case["covariance"])
            camera = Camera((0, 9), (width, height), middle, np.array(case["params"]), covariance, "estimated", case["bend"])
            np.testing.assert_allclose(camera.ground_from_pixel(case["pixels"]), case["ground_m"], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(camera.ground_from_pixel_sd(case["pixels"]), case["ground_sd_m"], rtol=1e-6, atol=1e-9)
            np.testing.assert_allclose(camera.project(case["points_m"]), case["points_px"], atol=1e-7)
            np.testing.assert_allclose(camera.project(case["ground_m"]), case["pixels"], atol=1e-7)

    def test_sds_are_the_spread_of_cameras(self) -> None:
        case = json.loads(FIXTURE.read_text())["cases"][0]
        params, covariance = np.array(case["params"]), np.array(case["covariance"]) / 100
        camera = Camera((0, 9), (1280, 720), (639.5, 359.5), params, covariance, "estimated")
        random = np.random.default_rng(5)
        others = [
            Camera(camera.span_s, camera.image_size_px, camera.principal_point_px, p, covariance, "estimated")
            for p in random.multivariate_normal(params, covariance, 4000)
        ]
        pixels, points = np.array(case["pixels"]), np.array(case["points_m"])
        clicked = [c.ground_from_pixel(pixels + random.normal(0, 1.5, pixels.shape)) for c in others]
        np.testing.assert_allclose(np.std(clicked, axis=0), camera.ground_from_pixel_sd(pixels, 1.5), rtol=0.08)
        np.testing.assert_allclose(np.std([c.project(points) for c in others], axis=0), camera.project_sd(points), rtol=0.08)

    def test_points_are_on_the_second_plane(self) -> None:
        first = np.array([np.log(1400), 0.25, 0.02, np.log(8)])
        second = SecondPlane(np.array([np.log(1400), 0.32, 0.02, np.log(9.5)]), np.diag([0, 0, 0, 1e-4]), True)
        camera = Camera((0, 9), (1280, 720), (639.5, 359.5), first, np.diag([0, 0, 0, 1e-6]), "estimated")
        folded = dataclasses.replace(camera, second_plane=second)
        ground = np.array([[x, y] for x in (-6.0, 0.0, 5.0) for y in (12.0, 18.0, 60.0, 90.0)])
        pixels = folded.project(ground)
        np.testing.assert_allclose(folded.ground_from_pixel(pixels), ground, atol=1e-6)
        # Near points are on the first plane. Far ones are higher, so that their pixels are higher, too.
        higher = camera.project(ground)[:, 1] - pixels[:, 1] > 1
        self.assertEqual(list(higher), [False, False, True, True] * 3)
        sds = folded.ground_from_pixel_sd(pixels)[:, 1] / ground[:, 1]
        np.testing.assert_allclose(sds, np.where(higher, 1e-2, 1e-3), rtol=0.4)

    def test_points_outside_the_view_are_nan(self) -> None:
        case = json.loads(FIXTURE.read_text())["cases"][0]
        unknown = np.diag([np.inf, 1, 1, 1])
        camera = Camera((0, 9), (1280, 720), (639.5, 359.5), np.array(case["params"]), unknown, "unobservable")
        self.assertTrue(np.isnan(camera.ground_from_pixel([640, -900])).all())
        self.assertTrue(np.isnan(camera.project([0, -30, 0])).all())
        self.assertTrue(np.isinf(camera.ground_from_pixel_sd([[640, 700]])).all())
        self.assertEqual(camera.project([[[1, 20, 0]]]).shape, (1, 1, 2))

    def test_a_view_is_a_turn_and_a_zoom(self) -> None:
        camera = Camera((0, 9), (1280, 720), (639.5, 359.5), np.array([7.0, 0.2, -0.01, 2.0]), np.eye(4), "estimated")

        def rays(focal_px: float) -> np.ndarray:
            return np.array([[focal_px, 0, 639.5], [0, focal_px, 359.5], [0, 0, 1]])

        cos, sin = np.cos(0.1), np.sin(0.1)
        rotation = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
        view = View(rays(1.2 * camera.focal_px) @ rotation @ np.linalg.inv(rays(camera.focal_px)))
        growth, turn = view.turn(camera)
        self.assertAlmostEqual(growth, 1.2)
        np.testing.assert_allclose(turn, rotation, atol=1e-12)
        pixels = np.array([[100.0, 50.0], [1200.0, 700.0]])
        np.testing.assert_allclose(view.world_from_picture_px(view.picture_from_world_px(pixels)), pixels)
        middle = view.picture_from_world_px([639.5, 359.5])
        np.testing.assert_allclose(middle, [639.5 - 1.2 * camera.focal_px * np.tan(0.1), 359.5])

    def test_a_view_keeps_the_lens(self) -> None:
        params = np.array([7.0, 0.2, -0.01, 2.0])
        camera = Camera((0, 9), (1280, 720), (639.5, 359.5), params, np.eye(4), "estimated", bend=-0.1, bend_sd=0.01)
        half = View(np.diag([0.5, 0.5, 1.0]) + np.array([[0, 0, 319.75], [0, 0, 179.75], [0, 0, 0]]), camera)
        pixels = np.array([[100.0, 50.0], [1200.0, 700.0]])
        np.testing.assert_allclose(half.world_from_picture_px(half.picture_from_world_px(pixels)), pixels)
        # Towards the border, the lens shrinks the picture.
        away = half.picture_from_world_px([1200.0, 359.5])[0] - 639.5
        self.assertGreater(away, 0.5 * (1200 - 639.5) + 5)

    def test_repr_is_short(self) -> None:
        camera = Camera((0, 9), (1280, 720), (639.5, 359.5), np.array([7.0, 0.2, -0.01, 2.0]), np.eye(4), "estimated")
        expected = "Camera(1280 × 720 px, 0–9 s, f 1097 px, tilt 11.5°, roll -0.6°, height 7.39 m, estimated)"
        self.assertEqual(repr(camera), expected)


class FinishedRun(unittest.TestCase):
    """Tests of all contents of a run."""

    def setUp(self) -> None:
        self.run_folder = Path(os.environ["ROADPLANE_RUN"])
        self.found = roadplane.load(self.run_folder)

    def test_tracks_are_those_of_the_file(self) -> None:
        tracks = self.found.tracks()
        lines = [json.loads(line) for line in (self.run_folder / "tracks.jsonl").read_text().splitlines()]
        self.assertEqual(len(tracks), len(lines))
        for column in ("frame", "track", "x_m", "heading_rad", "x_sd_m", "observed", "class", "segment"):
            self.assertEqual(tracks[column].tolist(), [line[column] for line in lines], column)
        known = json.loads(SCHEMA.read_text())["properties"]
        self.assertFalse([name for name in tracks if name not in known and not name.startswith("bbox_")])
        polars = self.found.tracks("polars")
        self.assertEqual(polars.columns, list(tracks))
        self.assertEqual(polars["x_m"].to_list(), tracks["x_m"].tolist())

    def test_parquet_and_csv_give_the_same_frames(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            bare = self._without_parquet(Path(folder))
            csv, parquet = roadplane.load(bare), self.found
            pd.testing.assert_frame_equal(parquet.tracks(), pd.read_csv(bare / "tracks.csv"), rtol=1e-12)
            pd.testing.assert_frame_equal(csv.tracks(), parquet.tracks(), rtol=1e-12)
            assert_frame_equal(csv.tracks("polars"), parquet.tracks("polars"), rel_tol=1e-12)

    def test_columns_without_values_have_the_types_of_csv(self) -> None:
        for rows in (0, 3):
            with tempfile.TemporaryDirectory() as folder:
                bare = self._without_parquet(Path(folder))
                table = pl.read_parquet(self.run_folder / "tracks.parquet").head(rows)
                table = table.with_columns(activity=pl.lit(None, pl.String), activity_p=pl.lit(None, pl.Float64))
                table.write_parquet(bare / "tracks.parquet")
                csv = pd.read_csv(bare / "tracks.csv", nrows=rows).assign(activity="", activity_p="")
                csv.to_csv(bare / "tracks.csv", index=False)
                found = roadplane.load(bare)
                expected = pd.read_csv(bare / "tracks.csv").astype({"observed": bool})
                pd.testing.assert_frame_equal(found.tracks(), expected, rtol=1e-12)
                self.assertEqual(list(found.tracks()[found.tracks()["observed"]].columns), list(expected.columns))
                parquet = found.tracks("polars")
                (bare / "tracks.parquet").unlink()
                assert_frame_equal(found.tracks("polars"), parquet, rel_tol=1e-12)
                self.assertEqual(parquet.schema, self.found.tracks("polars").schema)

    def test_views_are_those_of_the_motion(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            moving = self._without_parquet(Path(folder))
            camera = json.loads((moving / "camera.json").read_text())
            shift = [1.0, 0.0, 5.0, 0.0, 1.0, -3.0, 0.0, 0.0]
            camera["motion"] = [{"frame": 7, "time_s": 0.7, "picture_from_world": shift}]
            (moving / "camera.json").write_text(json.dumps(camera))
            found = roadplane.load(moving)
            np.testing.assert_allclose(found.view(7).picture_from_world_px([10, 10]), [15, 7])
            np.testing.assert_allclose(found.view(8).picture_from_world_px([10, 10]), [10, 10])

    def _without_parquet(self, folder: Path) -> Path:
        """Returns a copy of the run that has tracks.csv, but not tracks.parquet."""
        for name in ("summary.json", "camera.json", "tracks.csv"):
            shutil.copy(self.run_folder / name, folder)
        return folder

    def test_poses_are_those_of_the_file(self) -> None:
        poses = self.found.poses()
        lines = [json.loads(line) for line in (self.run_folder / "poses.jsonl").read_text().splitlines()]
        self.assertEqual(len(poses), len(lines))
        for column in ("frame", "car", "class", "used", "shape", "keypoints_px", "world_from_car"):
            self.assertEqual(poses[column].tolist(), [line[column] for line in lines], column)
        self.assertEqual(
            poses["track"].astype(object).where(poses["track"].notna(), None).tolist(), [x.get("track") for x in lines]
        )
        for pose, line in zip(poses.to_dict("records"), lines, strict=True):
            motion = np.array(line["world_from_car"])
            turn = [
                [np.cos(pose["heading_rad"]), -np.sin(pose["heading_rad"])],
                [np.sin(pose["heading_rad"]), np.cos(pose["heading_rad"])],
            ]
            np.testing.assert_allclose(motion[:2, :2], turn, atol=1e-5)
            self.assertEqual([pose["x_m"], pose["y_m"]], motion[:2, 3].tolist())
            self.assertEqual([pose["length_m"], pose["width_m"], pose["height_m"]], line["dims_m"])
            self.assertEqual([pose[f"bbox_{name}_px"] for name in ("x0", "y0", "x1", "y1")], line["bbox_px"])
            sds = [np.inf if sd is None else sd for sd in line["pose_sd"]]
            self.assertEqual([pose["x_sd_m"], pose["y_sd_m"], pose["heading_sd_rad"]], sds)
        self.assertTrue((poses["pose_from_frame"].isna() == [x.get("pose_from") is None for x in lines]).all())

    def test_poses_are_the_same_in_polars(self) -> None:
        ours, theirs = self.found.poses(), self.found.poses("polars")
        self.assertEqual(theirs.columns, list(ours))
        for column in ("frame", "x_m", "keypoints_px", "shape", "used"):
            self.assertEqual(theirs[column].to_list(), ours[column].tolist(), column)

    def test_a_run_without_poses_has_an_empty_frame(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            bare = roadplane.load(self._without_parquet(Path(folder)))
            self.assertEqual(list(bare.poses()), list(self.found.poses()))
            self.assertEqual(len(bare.poses()) + len(bare.poses("polars")), 0)

    def test_repr_is_short(self) -> None:
        self.assertEqual(repr(self.found), f"Run({str(self.run_folder)!r}, 1 camera)")

    def test_camera_is_that_of_the_file(self) -> None:
        camera, file = self.found.camera, json.loads((self.run_folder / "camera.json").read_text())
        for name in ("focal_px", "height_m", "tilt_rad", "roll_rad"):
            self.assertAlmostEqual(getattr(camera, name), file[name], places=5)
            sd = name.replace("_px", "_sd_px").replace("_m", "_sd_m").replace("_rad", "_sd_rad")
            self.assertAlmostEqual(getattr(camera, sd) / file[sd], 1, places=3)
        normal = np.linalg.inv(camera.camera_from_world().T)[:3, 2]
        np.testing.assert_allclose(normal, file["plane_in_camera"]["normal"], atol=1e-5)

    def test_cars_are_at_their_boxes(self) -> None:
        rows = self.found.tracks().query("observed")
        pixels = self.found.camera.project(rows[["x_m", "y_m"]].to_numpy())
        inside = [(pixels[:, i] > rows[f"bbox_{a}0_px"]) & (pixels[:, i] < rows[f"bbox_{a}1_px"]) for i, a in enumerate("xy")]
        self.assertGreater((inside[0] & inside[1]).mean(), 0.95)

    def test_events(self) -> None:
        events, lines = self.found.events(), (self.run_folder / "activities.jsonl").read_text().splitlines()
        self.assertEqual(events.to_dict("records"), [json.loads(line) for line in lines])
        self.assertEqual(self.found.events("polars").rows(), [tuple(json.loads(line).values()) for line in lines])

    def test_birds_eye_has_every_track(self) -> None:
        ax = self.found.plot_birds_eye()
        self.assertEqual({text.get_text() for text in ax.texts}, {str(track) for track in self.found.tracks()["track"].unique()})
        self.assertIs(self.found.plot_birds_eye(ax), ax)

    def test_rerun_takes_the_recording(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = self.found.to_rerun(Path(folder) / "lot.rrd")
            rerun = Path(sys.executable).with_name("rerun")
            subprocess.run([rerun, "rrd", "verify", path], check=True, capture_output=True)
            listed = subprocess.run([rerun, "rrd", "print", path], check=True, capture_output=True, text=True).stdout
            for track in self.found.tracks()["track"].unique():
                self.assertIn(f"/world/cars/{track}", listed)
            self.assertEqual([p.name for p in Path(folder).iterdir()], ["lot.rrd"])
            self._is_read_back(path)

    def _is_read_back(self, path: Path) -> None:
        """Checks every row's position, box and speed with Rerun's own reader."""
        of = {"world/cars": "Boxes3D:centers", "world/camera/picture": "Boxes2D:centers", "speed_mps": "Scalars:scalars"}
        found: dict[str, dict] = {folder: {} for folder in of}
        for chunk in RrdReader(path).stream().to_chunks():
            folder, _, track = chunk.entity_path.lstrip("/").rpartition("/")
            batch = chunk.to_record_batch()
            if of.get(folder) in batch.schema.names:
                values = zip(batch["frame"].to_pylist(), batch[of[folder]].to_pylist(), strict=True)
                found[folder] |= {(int(track), frame): value for frame, value in values if value is not None}
        rows = self.found.tracks().set_index(["track", "frame"])
        for folder, values in found.items():
            self.assertEqual(set(values), set(rows.index), folder)
        for key, row in rows.iterrows():
            np.testing.assert_allclose(found["world/cars"][key], [[row.x_m, row.y_m, row.height_m / 2]], atol=1e-5)
            middle = [(row.bbox_x0_px + row.bbox_x1_px + 1) / 2, (row.bbox_y0_px + row.bbox_y1_px + 1) / 2]
            np.testing.assert_allclose(found["world/camera/picture"][key], [middle], atol=1e-3)
            self.assertAlmostEqual(found["speed_mps"][key][0], row.speed_mps, places=9)

    def test_a_recording_has_the_frames_of_the_video(self) -> None:
        clip = TOP / "tests/data/lot.mp4"
        with tempfile.TemporaryDirectory() as folder:
            path = self.found.to_rerun(Path(folder) / "lot.rrd", video=clip)
            found: dict[int, tuple[float, int]] = {}
            blobs = []
            for chunk in RrdReader(path).stream().to_chunks():
                if chunk.entity_path != "/world/camera/picture/video":
                    continue
                batch = chunk.to_record_batch()
                if "AssetVideo:blob" in batch.schema.names:
                    blobs += [bytes(blob[0]) for blob in batch["AssetVideo:blob"].to_pylist()]
                else:
                    stamps = batch["VideoFrameReference:timestamp"].to_pylist()
                    times = [time.total_seconds() for time in batch["time"].to_pylist()]
                    found |= dict(zip(batch["frame"].to_pylist(), zip(times, stamps, strict=True), strict=True))
            self._is_read_back(path)
        self.assertEqual(blobs, [clip.read_bytes()])
        self.assertEqual(sorted(found), list(range(self.found.summary["counts"]["frames_expected"])))
        for frame, (time_s, stamp_ns) in found.items():
            self.assertAlmostEqual(time_s, stamp_ns[0] / 1e9, places=6)
            self.assertAlmostEqual(time_s, frame / 12, places=6)
        for frame, time_s in self.found.tracks()[["frame", "time_s"]].itertuples(index=False):
            self.assertAlmostEqual(found[frame][0], time_s, places=5)

    def test_a_video_of_another_run_or_kind_is_refused(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            out, notes = Path(folder, "lot.rrd"), Path(folder, "notes.mp4")
            notes.write_text("no video")
            for video, reason in (
                (notes, "Rerun needs an MP4 file"),
                (TOP / "tests/data/lots/scenes/clip_0000.mp4", "is not the video of this run"),
            ):
                with self.assertRaisesRegex(ValueError, reason):
                    self.found.to_rerun(out, video=video)
                self.assertFalse(out.exists())

    def test_a_folder_without_a_run_is_named(self) -> None:
        with self.assertRaisesRegex(FileNotFoundError, "no finished run"):
            roadplane.load(TOP / "tests")


class Packaging(unittest.TestCase):
    """Tests of facts that are written in two files."""

    def test_the_runtime_has_the_version_of_the_setup(self) -> None:
        pinned = tomllib.loads((TOP / "pyproject.toml").read_text())["project"]["dependencies"]
        setup = (TOP / "scripts/setup").read_text()
        version = next(line.partition("=")[2] for line in setup.splitlines() if line.startswith("readonly ORT_VERSION="))
        self.assertIn(f"onnxruntime=={version}", pinned)

    def test_all_models_are_installed(self) -> None:
        installed = Path(roadplane.__file__).parent / "models"
        self.assertNotIn(TOP / "scripts", installed.parents)
        self.assertEqual(sorted(p.name for p in installed.iterdir()), sorted(p.name for p in (TOP / "models").iterdir()))
