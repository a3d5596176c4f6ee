#!/usr/bin/env python3
"""Compares arms, flows, lanes and stop lines that are found from tracks with those of known streets.

    scripts/traffic/check_scene.py [--seeds N ...] [--rendered N] [--turning N] [--binary FILE] [--list]

It makes streets of each seed (`streets.py`) and variants of them (`variants.py`), and runs the example `scene` of the
crate `traffic`. The table has one line per variant:

- flows: true flows with three or more vehicles that were seen on their whole path; found, missed, invented
- lanes: true lanes with three or more such vehicles; found, missed, invented
- middle: median and 95 % of the error of the lanes' middles, m, over their points; rms of the normalised error
- stops: places where the first vehicles of three or more queues stop; found, missed, invented
- error: median and largest error of these places, m
"""

from __future__ import annotations

import argparse
import json
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import variants
from streets import Movement, Street, Track, rendered, turning

ROOT = Path(__file__).resolve().parents[2]
HEADER = "track,time_s,x_m,y_m,heading_rad,speed_mps,x_own_sd_m,y_own_sd_m,length_m,width_m,class"
FEWEST = 3
NEAR_M = 1.0  # a found lane belongs to a true one if the median distance is less


@dataclass
class Tally:
    """Counts and errors of one variant."""

    flows: np.ndarray = field(default_factory=lambda: np.zeros(4, int))  # true, found, missed, invented
    lanes: np.ndarray = field(default_factory=lambda: np.zeros(4, int))
    stops: np.ndarray = field(default_factory=lambda: np.zeros(4, int))
    middles: list[float] = field(default_factory=list)
    normalised: list[float] = field(default_factory=list)
    places: list[float] = field(default_factory=list)
    scenes: int = 0
    seconds: float = 0.0


def write(street: Street, path: Path) -> None:
    """Writes the tracks of a street."""
    with path.open("w") as file:
        file.write(HEADER + "\n")
        for number, track in enumerate(street.tracks):
            for row in track.rows:
                values = ",".join(f"{value:.4f}" for value in row)
                file.write(f"{number},{values},{track.length_m:.3f},{track.width_m:.3f},{track.kind}\n")


def crosses(path: np.ndarray, gate: dict, inward: bool) -> float | None:
    """Returns the index along a path at which it crosses a gate into the scene or out of it."""
    a, b = map(np.array, gate["line"])
    out, mid, half = np.array(gate["outward"]), (a + b) / 2, np.linalg.norm(b - a) / 2
    t = (path - mid) @ out
    side = (path - mid) @ (b - a) / (2 * half)
    for k in np.nonzero((t[:-1] > 0) != (t[1:] > 0))[0]:
        if (t[k] > 0) == inward and abs(side[k]) < half + 2:
            return float(k)
    return None


def whole(street: Street) -> list[list[Track]]:
    """Returns the tracks of each movement that were seen on the whole path.

    They begin and end while they drive, not at the clip's ends. They cover 60 % of the length on which 90 % of the
    positions of all tracks of the movement are.
    """
    result: list[list] = [[] for _ in street.movements]
    for number, movement in enumerate(street.movements):
        tracks = [track for track in street.tracks if track.movement == number]
        if not tracks:
            continue
        along = [distances(track.rows[:, 1:3], movement.lanes[0])[2] for track in tracks]
        low, high = np.percentile(np.concatenate(along), [5, 95])
        for track, places in zip(tracks, along, strict=True):
            times, speeds = track.rows[[0, -1], 0], np.abs(track.rows[:, 4])
            drives = min(speeds[:3].mean(), speeds[-3:].mean()) > 2
            if np.ptp(places) > 0.6 * (high - low) and drives and times[0] > 1 and times[1] < street.seconds - 1.2:
                result[number].append(track)
    return result


def compare(street: Street, truth: Street, found: dict, tally: Tally, name: str, log: Callable[[str], None]) -> None:
    """Adds the differences between a true street and the found scene."""
    movements, complete = street.movements, whole(truth)
    matched: dict[int, list] = {}
    for a, b, count in found["flows"]:
        fits = None
        for i, movement in enumerate(movements):
            for path in movement.lanes:
                start = crosses(path, found["arms"][a], True)
                end = crosses(path, found["arms"][b], False)
                if start is not None and end is not None and start < end:
                    fits = i
        if fits is None or fits in matched:
            tally.flows[3] += 1
            log(f"{name}: invented flow {a} to {b} with {count}")
        else:
            matched[fits] = [a, b]
    for i, tracks in enumerate(complete):
        if len(tracks) >= FEWEST:
            tally.flows[0] += 1
            tally.flows[1 if i in matched else 2] += 1
            if i not in matched:
                log(f"{name}: missed flow {i} with {len(tracks)} of ends {movements[i].lanes[0][[0, -1]].round().tolist()}")
    lanes(movements, complete, found, tally, name, log)
    stops(street, truth, found, tally, name, log)
    tally.scenes += 1
    tally.seconds = max(tally.seconds, found["seconds"])


def distances(points: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the distances of points from a path, the path's directions there, and the distances along the path."""
    step = np.diff(path, axis=0)
    length = np.linalg.norm(step, axis=1)
    at = np.clip(((points[:, None] - path[:-1]) * step).sum(2) / length**2, 0, 1)
    away = np.linalg.norm(points[:, None] - path[:-1] - at[..., None] * step, axis=2)
    best = away.argmin(1)
    along = np.cumsum(length)[best] - length[best] * (1 - at[np.arange(len(at)), best])
    return away.min(1), (step / length[:, None])[best], along


def lanes(movements: list[Movement], complete: list, found: dict, tally: Tally, name: str, log: Callable[[str], None]) -> None:
    """Compares lanes."""
    count = {}
    for i, movement in enumerate(movements):
        for k, path in enumerate(movement.lanes):
            inside = [(distances(t.rows[:, 1:3], path)[0] < 0.5).mean() > 0.7 for t in complete[i]]
            count[i, k] = sum(inside)
    hits: dict[tuple[int, int], int] = {}
    for lane in found["lanes"]:
        points = np.array(lane["middle"])
        forward = np.gradient(points, axis=0)
        best, errors = None, None
        for i, movement in enumerate(movements):
            for k, path in enumerate(movement.lanes):
                away, direction, _ = distances(points, path)
                if (direction * forward).sum() > 0 and (errors is None or np.mean(away) < np.mean(errors)):
                    best, errors = (i, k), away
        if errors is None or np.median(errors) > NEAR_M:
            tally.lanes[3] += 1
            log(f"{name}: invented lane {points[[0, -1]].round().tolist()} with {len(lane['stays'])} stays")
            continue
        tally.middles += errors.tolist()
        tally.normalised += (errors / lane["middle_sd_m"]).tolist()
        if best in hits and lane["from"] is not None and lane["to"] is not None:
            tally.lanes[3] += 1
            log(f"{name}: lane {best} is found twice")
        hits[best] = hits.get(best, 0) + 1
        if np.median(errors) > 0.4:
            log(f"{name}: lane {best} is off by {np.median(errors):.2f} m, {len(lane['stays'])} vehicles")
    for key, vehicles in count.items():
        if vehicles >= FEWEST:
            tally.lanes[0] += 1
            tally.lanes[1 if key in hits else 2] += 1
            if key not in hits:
                log(f"{name}: missed lane {key} with {vehicles}")


def stops(street: Street, truth: Street, found: dict, tally: Tally, name: str, log: Callable[[str], None]) -> None:
    """Compares stop lines: those of each direction, on any of its lanes."""
    hit = set()
    for line in found["stop_lines"]:
        place, forward = np.array(line["place"]), np.array(line["forward"])
        errors = {}
        for i, movement in enumerate(street.movements):
            for k, stop in enumerate(movement.stops):
                _, direction, _ = distances(place[None], movement.lanes[k])
                if abs(np.cross(forward, place - stop)) < 1.75 and direction[0] @ forward > 0.8:
                    errors[i] = (place - stop) @ forward
        near = min(errors.values(), key=abs, default=np.inf)
        if abs(near) > 4:
            tally.stops[3] += 1
            log(f"{name}: invented stop line at {place.round(1).tolist()}, {line['queues']} queues, {near:.1f} m off")
        else:
            tally.places.append(abs(near))
            hit |= {i for i, error in errors.items() if abs(error) < 4}
    for i, movement in enumerate(street.movements):
        heads = set()
        for number, track in enumerate(truth.tracks):
            rest = track.rows[np.abs(track.rows[:, 4]) < 0.1]
            if track.movement != i or len(rest) < 10:
                continue
            front = rest[:, 1:3] + track.length_m / 2 * np.stack([np.cos(rest[:, 3]), np.sin(rest[:, 3])], 1)
            there = np.min([np.linalg.norm(front - stop, axis=1) for stop in movement.stops], axis=0) < 2
            if there.sum() < 10:
                continue
            times, rows = rest[there, 0], track.rows
            drives = np.abs(rows[:, 4]) > 2
            if drives[rows[:, 0] < times[0]].any() and drives[rows[:, 0] > times[-1]].any():
                heads.add(number)
        if len(heads) >= FEWEST:
            tally.stops[0] += 1
            tally.stops[1 if i in hit else 2] += 1
            if i not in hit:
                log(f"{name}: missed stop line of {i} with {len(heads)} queues")


def cases(arguments: argparse.Namespace) -> list[tuple[str, str, Street, Street]]:
    """Returns variant, name, street as seen, and the same street without noise and cuts."""
    result = []
    for seed in arguments.seeds:
        rng = np.random.default_rng([seed, 5])
        base = [("rendered", f"{seed}.{n}", _kept(arguments, seed, n, 60.0, 4)) for n in range(arguments.rendered)]
        base += [
            ("rendered, 5 min", f"{seed}.{n}", _kept(arguments, seed, n + 100, 300.0, 2 * (n + 1))) for n in range(arguments.long)
        ]
        base += [("turning", f"{seed}.{n}", turning(1000 * seed + n)) for n in range(arguments.turning)]
        for kind, name, street in base:
            result.append((kind + ", exact", name, street, street))
            result.append((kind, name, variants.noisy(street, rng), street))
            other = variants.moved(street, rng.uniform(0, 2 * np.pi), True)
            result.append((kind + ", mirrored", name, variants.noisy(other, rng), other))
            few = variants.fewer(street, rng, 0.3)
            result.append((kind + ", 30 %", name, variants.noisy(few, rng), few))
            result.append((kind + ", noise × 2", name, variants.noisy(street, rng, 0.2, 1.0), street))
            result.append((kind + ", cut each 60 m", name, *variants.cut(variants.noisy(street, rng), rng, 60.0)))
            result.append((kind + ", parked", name, variants.noisy(variants.parked(street, rng, 30), rng), street))
    return result


def _kept(arguments: argparse.Namespace, seed: int, number: int, seconds: float, count: int) -> Street:
    """Returns a rendered street, from the folder of streets if it is there."""
    file = arguments.streets / f"{seed}-{number}.pickle"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps(rendered(seed, number, seconds, count)))
    return pickle.loads(file.read_bytes())


def main() -> None:
    """Makes streets, finds their scenes, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--rendered", type=int, default=4, help="streets of 60 s per seed")
    parser.add_argument("--long", type=int, default=2, help="streets of 300 s per seed: two lanes, four lanes")
    parser.add_argument("--turning", type=int, default=8, help="junctions with turning vehicles per seed")
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/examples/scene")
    parser.add_argument("--streets", type=Path, default=ROOT / ".work/streets", help="folder for streets, which take seconds")
    parser.add_argument("--only", default="", help="variants whose name has this text")
    parser.add_argument("--list", action="store_true", help="prints each difference")
    parser.add_argument("--keep", type=Path, help="keeps tracks and results in this folder, for draw_scene.py")
    arguments = parser.parse_args()
    everything = [case for case in cases(arguments) if arguments.only in case[0]]
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{kind.replace(' ', '_').replace(',', '')}-{name}.csv" for kind, name, *_ in everything]
        for file, case in zip(files, everything, strict=True):
            write(case[2], file)
        command = [part for file in files for part in (str(file), "--next")]
        lines = subprocess.run([arguments.binary, *command], check=True, capture_output=True, text=True).stdout.splitlines()
        if arguments.keep:
            for file, line in zip(files, lines, strict=True):
                file.with_suffix(".json").write_text(line)
    tallies: dict[str, Tally] = {}
    for (kind, name, street, truth), line in zip(everything, lines, strict=True):
        log = (lambda text: print(text, file=sys.stderr)) if arguments.list else (lambda _: None)
        compare(street, truth, json.loads(line), tallies.setdefault(kind, Tally()), f"{kind} {name}", log)
    print(f"{'variant':32} scenes  flows t/f/m/i     lanes t/f/m/i     middle 50/95 %, /sd  stops t/f/m/i   error 50/max  s")
    for kind, tally in tallies.items():
        row = ["/".join(map(str, values)) for values in (tally.flows, tally.lanes, tally.stops)]
        middle = "-"
        if tally.middles:
            rms = np.sqrt(np.mean(np.square(tally.normalised)))
            middle = "{:.2f} {:.2f}, {:.2f}".format(*np.percentile(tally.middles, [50, 95]), rms)
        place = f"{np.median(tally.places):.2f} {np.max(tally.places):.2f}" if tally.places else "-"
        print(f"{kind:32} {tally.scenes:5}   {row[0]:16}  {row[1]:16}  {middle:18}  {row[2]:14}  {place:12}  {tally.seconds:.2f}")


if __name__ == "__main__":
    main()
