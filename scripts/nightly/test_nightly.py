"""Tests of the steps of a night with roadplane's exit codes, and of the data in clips' names."""

import contextlib
import datetime
import io
import json
import os
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import step
from clips import Json, binary, camera_of, clips_in, is_failed, is_of_older_version, recorded
from overhead import at_work_s

# Replaces the binary: the clip's name decides the exit code, and whether a piece is written.
FAKE_BINARY = """#!/usr/bin/env python3
import os, pathlib, signal, sys
out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1])
name = pathlib.Path(sys.argv[2]).stem
if name != "lost":
    (out / f"{name}.piece-000000").mkdir(parents=True, exist_ok=True)
print("said", file=sys.stderr)
if name == "killed":
    os.kill(os.getpid(), signal.SIGKILL)
sys.exit({"good": 0, "damaged": 3, "lost": 3, "full": 1}[name])
"""


class Steps(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(folder.name)
        Path("binary").write_text(FAKE_BINARY)
        Path("binary").chmod(0o755)

    def piece(self, name: str, attempt: int) -> tuple[object, Json]:
        status = f"steps/piece/{name}/000000.json"
        line = ["step.py", "--roadplane", "./binary", "piece", "--attempt", str(attempt), "--piece", "0-", status, f"{name}.mp4"]
        code: object = 0
        with mock.patch.object(sys, "argv", line), contextlib.redirect_stderr(io.StringIO()):
            try:
                step.main()
            except SystemExit as ended:
                code = ended.code
        return code, json.loads(Path(status).read_text()) if Path(status).exists() else {}

    def test_an_input_at_fault_is_finished_work(self) -> None:
        for name, outcome in (("good", "done"), ("damaged", "damaged"), ("lost", "lost")):
            code, status = self.piece(name, 1)
            self.assertEqual((code, status["outcome"], status["said"]), (0, outcome, ["said"]))

    def test_a_machines_fault_is_tried_again_and_then_written_down(self) -> None:
        for name, exit_code in (("full", 1), ("killed", 137)):
            self.assertEqual(self.piece(name, 1), (exit_code, {}))
            code, status = self.piece(name, step.LAST_ATTEMPT)
            self.assertEqual((code, status["outcome"], status["exit"]), (0, "failed", exit_code))
            self.assertTrue(is_failed(Path(f"steps/piece/{name}/000000.json")))
            attempts = [json.loads(path.read_text()) for path in Path("log").glob(f"piece.{name}.*")]
            self.assertEqual([attempt["exit"] for attempt in attempts], [exit_code] * 2)

    def test_a_clip_with_a_lost_piece_is_lost(self) -> None:
        for name in ("good", "lost"):
            self.piece(name, 1)
        pieces = [f"steps/piece/{name}/000000.json" for name in ("good", "lost")]
        with mock.patch.object(sys, "argv", ["step.py", "result", "steps/result/clip.json", *pieces]):
            step.main()
        self.assertEqual(json.loads(Path("steps/result/clip.json").read_text())["outcome"], "lost")

    def test_traffic_of_all_results_with_their_cameras(self) -> None:
        for name, made in (("a", {"made": "results/a"}), ("b", {"outcome": "lost"}), ("c", {"made": "results/c"})):
            step.write_json(f"steps/result/{name}.json", made)
        calls: list[list[str]] = []

        def call(_: str, arguments: list[str], __: str) -> tuple[Json, str]:
            calls.append(arguments)
            return {"exit": 0, "said": []}, ""

        options = ["--camera-id", "{}_*", "--every", "5min", "--time-zone", "Europe/Berlin"]
        line = ["step.py", "traffic", *options, "steps/traffic.json", *(f"steps/result/{name}.json" for name in "abc")]
        with mock.patch.object(sys, "argv", line), mock.patch.object(step, "call", call):
            step.main()
        [arguments] = calls
        self.assertEqual(arguments[:3], ["traffic", "results/a", "results/c"])
        self.assertEqual([arguments[arguments.index(name) + 1] for name in options[::2]], options[1::2])
        self.assertEqual(json.loads(Path("steps/traffic.json").read_text())["clips"], 2)

    def test_the_status_of_a_joined_run_is_its_outcome(self) -> None:
        self.piece("good", 1)
        line = ["step.py", "result", "steps/result/good.json", "steps/piece/good/000000.json"]
        states: dict[str | None, str] = {
            "complete": "done",
            "partly_followed": "partly followed",
            "input_damaged": "damaged",
            "points_not_used": "done",
        }
        states[None] = "lost"
        for state, outcome in states.items():

            def join(*_: object, state: str | None = state) -> tuple[Json, str]:
                result = Path("work/result/good/good")
                if state:
                    step.write_json(result / "summary.json", {"status": state})
                return {"exit": 0 if state == "complete" else 3, "said": []}, ""

            with mock.patch.object(sys, "argv", line), mock.patch.object(step, "call", join):
                step.main()
            self.assertEqual(json.loads(Path("steps/result/good.json").read_text())["outcome"], outcome)

    def test_clips_are_those_of_a_folder_or_a_list(self) -> None:
        Path("in").mkdir()
        for name in ("b.mp4", "a.mkv", ".hidden.mp4", "notes.txt"):
            Path("in", name).touch()
        self.assertEqual(list(clips_in("in")), ["a", "b"])
        Path("list.txt").write_text("# two\nin/b.mp4\n\nin/a.mkv\n")
        self.assertEqual(clips_in("list.txt"), {"b": Path("in/b.mp4"), "a": Path("in/a.mkv")})
        for bad in ("in/b.mp4\nin/b.mov\n", "in/b'c.mp4\n"):
            Path("list.txt").write_text(bad)
            self.assertRaises(SystemExit, clips_in, "list.txt")
        self.assertRaises(SystemExit, clips_in, "absent")


class Names(unittest.TestCase):
    def test_cameras(self) -> None:
        self.assertEqual(camera_of("gate-3_20260131_2200", "{}_*"), "gate-3")
        self.assertEqual(camera_of("VIRAT_S_0401_02", "VIRAT_S_{}_*"), "0401")
        self.assertEqual([camera_of("plain", given) for given in ("{}_*", "", "gate")], ["unknown", "unknown", "gate"])

    def test_times(self) -> None:
        planned = {"stem": "gate-3", "recorded": "2026-01-31T22:00:00", "recorded_from": "name"}
        self.assertEqual(recorded(planned), (datetime.datetime(2026, 1, 31, 22), "name"))
        self.assertIsNone(recorded({"stem": "gate-3", "outcome": "lost"}))

    def test_plans_without_times_are_made_again(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            plan = Path(folder) / "plan.jsonl"
            lines = {"": False, '{"outcome": "lost"}': False, '{"piece": "0-"}': True, '{"piece": "0-", "recorded": ""}': False}
            for line, is_old in lines.items():
                plan.write_text(line)
                self.assertEqual(is_of_older_version(plan), is_old, line)
        self.assertFalse(is_of_older_version(plan))


class Program(unittest.TestCase):
    def test_the_program_is_given_or_of_the_checkout_or_on_the_path(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder).resolve()
            with mock.patch.dict(os.environ, {"PATH": str(root / "bin")}):
                with self.assertRaisesRegex(SystemExit, "--config roadplane="):
                    binary("", root, root)
                for given in ("target/release/roadplane", "roadplane"):
                    self.assertRaisesRegex(SystemExit, given, binary, given, root, root)
                for place in ("bin", "target/release"):
                    program = root / place / "roadplane"
                    program.parent.mkdir(parents=True)
                    program.touch(0o755)
                    self.assertEqual(binary("", root, root), str(program))
                self.assertEqual(binary("roadplane", root, root), str(root / "bin/roadplane"))
                self.assertEqual(binary("bin/roadplane", root, root), str(root / "bin/roadplane"))


class Overhead(unittest.TestCase):
    def test_runs_at_the_same_time_count_once(self) -> None:
        spans = [(100.0, 10.0), (102.0, 3.0), (108.0, 4.0), (120.0, 1.0)]
        self.assertEqual(at_work_s([{"begun": begun, "seconds": seconds} for begun, seconds in spans]), 13.0)
        self.assertEqual(at_work_s([]), 0.0)
