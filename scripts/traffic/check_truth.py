#!/usr/bin/env python3
"""Compares the figures of `roadplane traffic` with the truth of rendered clips.

    scripts/traffic/check_truth.py RUN_FOLDER TRUTH [RUN_FOLDER TRUTH]... [--binary FILE] [--list]

It needs the environment of scripts/train: .runtime/train/bin/python.

A run is a finished run of the clip. The script lays gates across the traffic of the truth, and a zone between two of
them, and gives both to the program in pixels. It computes the true figures from the true paths on its own.

- counts: vehicles per gate and direction. A vehicle counts if at least 30 % of it is visible at the line, on 24 px, as
  in `roadplane-lab eval run`. Others neither need to be counted nor are wrong.
- errors: rms of the normalised error, and the share of errors within 1.96 sds, for each continuous figure
- conflicts: pairs of the true tracks, pairs that are listed, and listed pairs that are true. No vehicle crashes.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pixel_gates import write_gates
from truth_paths import Crossing, VehiclePath, border_s, crossings_of, inside, true_paths

from roadplane_train.detect.metrics import overlaps
from roadplane_train.json_files import read_json
from roadplane_train.render.camera import Camera

ROOT = Path(__file__).resolve().parents[2]
MOVING_MPS = 2.0
NEAREST_M = 1.0  # depth of a point of a gate
# A counted vehicle is a true one if their times and places at the line differ by less.
SAME_S, SAME_M = 1.5, 2.0
GATE_SHARES = (0.25, 0.5, 0.75)  # places of the gates along the traffic, as quantiles of the vehicles' positions
LEAST_IOU = 0.5
KMH = 3.6


@dataclass
class Tally:
    """Normalised errors by figure, and lines about counts."""

    errors: dict[str, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))
    counts: list[tuple[str, int, int, int, int, int, int]] = field(default_factory=list)
    v85: list[tuple[float, float]] = field(default_factory=list)
    conflicts: list[tuple[int, int, int]] = field(default_factory=list)
    stays: list[tuple[int, int, int]] = field(default_factory=list)

    def add(self, figure: str, error: float, sd: float) -> None:
        """Adds an error with its sd."""
        self.errors[figure].append((error, sd))


def pixels(points: np.ndarray, camera: Camera) -> np.ndarray:
    """Returns the pixels [n, 2] of ground points [n, 2]; NaN outside of the picture and near the camera."""
    found, depth = camera.pixel_from_world(np.column_stack([points, np.zeros(len(points))]))
    seen = (depth >= NEAREST_M) & (found > 0).all(1) & (found < camera.image_size_px).all(1)
    return np.where(seen[:, None], found, np.nan)


def gates_of(paths: list[VehiclePath], camera: Camera) -> list[tuple[str, np.ndarray]]:
    """Returns gates [2, 2] across the traffic: of each axis of the site, if enough vehicles drive along it."""
    moving = [
        (p.centres[i], p.headings[i])
        for p in paths
        for i in range(0, len(p.times), 5)
        if abs(p.speeds[i]) > MOVING_MPS and p.clear[i]
    ]
    places, headings = np.array([m[0] for m in moving]), np.array([m[1] for m in moving])
    main = np.angle(np.exp(2j * headings).mean()) / 2
    gates = []
    for name, axis in (("along", main), ("across", main + np.pi / 2)):
        ahead = np.array([np.cos(axis), np.sin(axis)])
        left = np.array([-ahead[1], ahead[0]])
        mine = np.abs(np.cos(headings - axis)) > 0.9
        if mine.sum() < 60:
            continue
        e, n = places[mine] @ ahead, places[mine] @ left
        for share in GATE_SHARES:
            at = np.quantile(e, share)
            near = np.abs(e - at) < 8.0
            low, high = np.quantile(n[near], [0.01, 0.99]) + [-1.8, 1.8]
            line = np.array([ahead * at + left * low, ahead * at + left * high])
            if np.isfinite(pixels(line, camera)).all():
                gates.append((f"{name} {share}", line))
    return gates


def zone_between(gates: list[tuple[str, np.ndarray]]) -> np.ndarray | None:
    """Returns the area [4, 2] between the first two gates."""
    if len(gates) < 2:
        return None
    (a, b), (c, d) = gates[0][1], gates[1][1]
    return np.array([a, b, d, c])


def compare(run: Path, truth_file: Path, binary: Path, folder: Path, tally: Tally) -> None:
    """Compares one run with its truth."""
    truth = read_json(truth_file)
    by_id, camera = true_paths(truth), Camera.of(truth["camera"])
    paths = list(by_id.values())
    gates = gates_of(paths, camera)
    zone = zone_between(gates)
    lines = {name: pixels(line, camera).tolist() for name, line in gates}
    zones = {} if zone is None else {"zone": pixels(zone, camera).tolist()}
    write_gates(folder / "gates.geojson", list(camera.image_size_px), lines, zones)
    out = folder / run.name
    subprocess.run([binary, "traffic", run, "--gates", folder / "gates.geojson", "--out", out], check=True, capture_output=True)
    found: dict[tuple[str, str], list[dict]] = defaultdict(list)
    for row in csv.DictReader((out / "crossings.csv").open()):
        found[row["gate"], row["direction"]].append(row)
    counted = {
        (row["place"], row["direction"]): row for row in csv.DictReader((out / "counts.csv").open()) if row["class"] == "all"
    }
    speeds = {
        (row["place"], row["direction"]): row for row in csv.DictReader((out / "speeds.csv").open()) if row["class"] == "all"
    }
    for name, line in gates:
        true = [crossing for path in paths for crossing in crossings_of(path, line)]
        for direction in ("forward", "backward"):
            mine = sorted((c for c in true if c.direction == direction), key=lambda c: c.front_s)
            theirs = sorted(found[name, direction], key=lambda row: float(row["time_s"]))
            if not mine and not theirs:
                continue
            pairs = matched(mine, theirs)
            needed = sum(c.clear for c in mine)
            wrong = needed - sum(mine[i].clear for i in pairs) + len(theirs) - len(pairs)
            row = counted.get((name, direction), {})
            low, high = (int(row.get(key) or 0) for key in ("vehicles_low", "vehicles_high"))
            tally.counts.append((f"{run.name} {name} {direction}", len(mine), needed, len(theirs), low, high, wrong))
            measure(mine, theirs, pairs, tally)
            if len(pairs) >= 5 and (name, direction) in speeds:
                true_v85 = np.quantile([mine[i].speed for i in pairs], 0.85) * KMH
                listed = speeds[name, direction]
                tally.add("V85", float(listed["v85_kmh"]) - true_v85, float(listed["v85_sd_kmh"]))
                tally.v85.append((float(listed["v85_kmh"]), true_v85))
    if zone is not None:
        compare_stays(out, paths, zone, tally)
    compare_conflicts(run, truth, by_id, out, binary, tally)


def vehicles_of(run: Path, truth: dict) -> dict[int, int]:
    """Returns the true vehicle of each track: the one that most of its observed boxes show."""
    boxes = {frame["frame"]: frame["cars"] for frame in truth["frames"]}
    votes: dict[int, Counter[int]] = defaultdict(Counter)
    for row in csv.DictReader((run / "tracks.csv").open()):
        cars = boxes.get(int(row["frame"]), [])
        if row["observed"] != "true" or not cars:
            continue
        box = np.array([float(row[f"bbox_{side}_px"]) for side in ("x0", "y0", "x1", "y1")])
        shared = overlaps(box[None], np.array([car["box"] for car in cars]))[0][0]
        if shared.max() > LEAST_IOU:
            votes[int(row["track"])][cars[int(shared.argmax())]["id"]] += 1
    return {track: of_track.most_common(1)[0][0] for track, of_track in votes.items()}


def compare_conflicts(run: Path, truth: dict, paths: dict[int, VehiclePath], out: Path, binary: Path, tally: Tally) -> None:
    """Compares the listed conflicts with those of the true tracks, which the program gets as a table."""
    lines = ["time_s,track,x_m,y_m,heading_rad,speed_mps,length_m,width_m,class"]
    sizes = {model["id"]: model["dims_m"][:2] for model in truth["models"]}
    for number, path in paths.items():
        for i, time_s in enumerate(path.times):
            place = ",".join(f"{value:.4f}" for value in (*path.centres[i], path.headings[i], path.speeds[i], *sizes[number]))
            # A truck's position is the centre of its body, as these positions are.
            lines.append(f"{time_s:.3f},{number},{place},truck")
    table = out.with_name(f"{run.name}-truth.csv")
    table.write_text("\n".join(lines) + "\n")
    expected = table.with_suffix("")
    subprocess.run([binary, "traffic", table, "--out", expected], check=True, capture_output=True)
    of_track = vehicles_of(run, truth)
    true = {(int(row["first"]), int(row["second"])): row for row in csv.DictReader((expected / "conflicts.csv").open())}
    listed = list(csv.DictReader((out / "conflicts.csv").open()))
    right = set()
    for row in listed:
        pair = of_track.get(int(row["first"])), of_track.get(int(row["second"]))
        if pair in true:
            right.add(pair)
            if row["pet_s"] and true[pair]["pet_s"] and float(row["pet_sd_s"]) > 0:
                tally.add("PET", float(row["pet_s"]) - float(true[pair]["pet_s"]), float(row["pet_sd_s"]))
    tally.conflicts.append((len(true), len(listed), len(right)))


def matched(mine: list[Crossing], theirs: list[dict]) -> dict[int, int]:
    """Returns the counted vehicle of each true one that has one; near in time and place, nearest first."""
    time = np.array([[abs(float(row["time_s"]) - c.time_s) for row in theirs] for c in mine]).reshape(len(mine), len(theirs))
    place = np.array([[abs(float(row["along_m"]) - c.along_m) for row in theirs] for c in mine]).reshape(time.shape)
    cost = np.where((time < SAME_S) & (place < SAME_M), time / SAME_S + place / SAME_M, np.inf)
    pairs: dict[int, int] = {}
    while np.isfinite(cost).any():
        i, k = np.unravel_index(cost.argmin(), cost.shape)
        pairs[int(i)] = int(k)
        cost[i], cost[:, k] = np.inf, np.inf
    return pairs


def measure(mine: list[Crossing], theirs: list[dict], pairs: dict[int, int], tally: Tally) -> None:
    """Adds the errors of times, speeds and headways of matched vehicles."""
    for i, k in pairs.items():
        row, crossing = theirs[k], mine[i]
        tally.add("time", float(row["time_s"]) - crossing.time_s, float(row["time_sd_s"]))
        tally.add("speed", float(row["speed_kmh"]) - crossing.speed * KMH, float(row["speed_sd_kmh"]))
        # The leader must be the true one.
        if row["headway_s"] and i > 0 and k > 0 and pairs.get(i - 1) == k - 1:
            headway_s = crossing.front_s - mine[i - 1].front_s
            if np.isfinite(headway_s):
                tally.add("headway", float(row["headway_s"]) - headway_s, float(row["headway_sd_s"]))


def compare_stays(out: Path, paths: list[VehiclePath], zone: np.ndarray, tally: Tally) -> None:
    """Adds the errors of times in the zone, of vehicles that are seen to enter and to leave."""
    true = []
    for path in paths:
        within = inside(path.centres, zone)
        for begin in np.nonzero(~within[:-1] & within[1:])[0]:
            ends = np.nonzero(within[begin + 1 : -1] & ~within[begin + 2 :])[0]
            if len(ends):
                end = begin + 1 + ends[0]
                true.append((border_s(path, zone, begin), border_s(path, zone, end), path.clear[begin : end + 1].mean() > 0.5))
    rows = [row for row in csv.DictReader((out / "stays.csv").open()) if row["enters_s"] and row["leaves_s"]]
    for enters_s, leaves_s, _ in true:
        apart = [max(abs(float(row["enters_s"]) - enters_s), abs(float(row["leaves_s"]) - leaves_s)) for row in rows]
        if apart and min(apart) < SAME_S:
            row = rows[int(np.argmin(apart))]
            tally.add("stay", float(row["stay_s"]) - (leaves_s - enters_s), float(row["stay_sd_s"]))
    tally.stays += [(len(true), sum(clear for *_, clear in true), len(rows))]


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", nargs="+", type=Path, metavar="RUN_FOLDER TRUTH")
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/roadplane")
    parser.add_argument("--list", action="store_true", help="print each gate")
    options = parser.parse_args()
    if len(options.pairs) % 2:
        parser.error("each run needs its truth")
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        for run, truth in zip(options.pairs[::2], options.pairs[1::2], strict=True):
            compare(run, truth, options.binary, Path(folder), tally)
    report(tally, options.list)


def report(tally: Tally, every: bool) -> None:
    """Prints the tables."""
    if every:
        for name, number, needed, counted, low, high, wrong in tally.counts:
            print(f"{name:40} true {number:3} ({needed:3} clear)  counted {counted:3} [{low}, {high}]  wrong {wrong}")
    number, needed, counted, low, high, wrong = np.array([row[1:] for row in tally.counts]).T
    right = ((low <= number) & (number <= high)) | ((low <= needed) & (needed <= high))
    print(f"counts: {len(number)} gates and directions, {number.sum()} vehicles, {needed.sum()} of them clear to see")
    print(f"        {counted.sum()} counted, {wrong.sum()} missed or wrong; {right.sum()} intervals hold the number")
    print("whole stays: true, clear, found:", *np.sum(tally.stays, axis=0))
    print("conflicts: true, listed, of them true:", *np.sum(tally.conflicts, axis=0))
    for figure, pairs in tally.errors.items():
        error, sd = np.array(pairs).T
        rms, normalised = (np.sqrt((values**2).mean()) for values in (error, error / sd))
        covered = 100 * (np.abs(error) < 1.96 * sd).mean()
        print(f"{figure:8} {len(error):4}  rms {rms:.3f}  normalised {normalised:.2f}  within 1.96 sd {covered:.1f} %")
    if tally.v85:
        found, true = np.array(tally.v85).T
        ratio = found / true
        largest = [100 * np.abs(values - 1).max() for values in (ratio, ratio / np.median(ratio))]
        print("V85: largest deviation {:.1f} %, after the scale {:.1f} %".format(*largest))


if __name__ == "__main__":
    sys.exit(main())
