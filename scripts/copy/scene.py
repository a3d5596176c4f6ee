"""Reads a copied scene, and the run that it was copied from."""

from __future__ import annotations

import argparse
import csv
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

STEP_S = 0.1


@dataclass
class Vehicle:
    """A vehicle of scenario.xosc. Poses are x, y (m) of the centre of the rear axle and heading (rad)."""

    name: str
    track: int
    dims_m: tuple[float, float, float]  # length, width, height
    centre_m: float  # centre of the body forward of the rear axle
    half_wheelbase_m: float
    times_s: np.ndarray  # [n]
    poses: np.ndarray  # [n, 3]
    span_s: tuple[float, float]

    def at(self, time_s: float) -> np.ndarray:
        """Returns the pose at a time; between vertices everything changes linearly, as the standard says."""
        return np.array([np.interp(time_s, self.times_s, self.poses[:, i]) for i in range(3)])

    def ahead(self, pose: np.ndarray, metres: float) -> np.ndarray:
        """Returns a point forward of the rear axle."""
        return pose[:2] + metres * np.array([np.cos(pose[2]), np.sin(pose[2])])


def numbers(element: ET.Element, *names: str) -> list[float]:
    """Returns attributes as numbers."""
    return [float(element.attrib[name]) for name in names]


def read_scene(folder: Path) -> tuple[list[Vehicle], float]:
    """Returns vehicles and length of scenario.xosc."""
    root = ET.parse(folder / "scenario.xosc").getroot()
    end = float(root.find("Storyboard/StopTrigger//SimulationTimeCondition").attrib["value"])
    first = {p.attrib["entityRef"]: p.find(".//WorldPosition") for p in root.iterfind("Storyboard/Init/Actions/Private")}
    groups = {g.find("Actors/EntityRef").attrib["entityRef"]: g for g in root.iter("ManeuverGroup")}
    return [_vehicle(entity, first, groups, end) for entity in root.iterfind("Entities/ScenarioObject")], end


def _vehicle(entity: ET.Element, first: dict, groups: dict, end: float) -> Vehicle:
    name, body = entity.attrib["name"], entity.find("Vehicle")
    group = groups.get(name)
    times, places, span = [0.0], [first.get(name)], [0.0, end]
    for event in group.iter("Event") if group is not None else ():
        begin = float(event.find("StartTrigger//SimulationTimeCondition").attrib["value"])
        added, vertices = event.find(".//AddEntityAction//WorldPosition"), list(event.iter("Vertex"))
        if added is not None:
            times, places, span[0] = [begin], [added], begin
        elif vertices:
            times = [float(vertex.attrib["time"]) for vertex in vertices]
            places = [vertex.find("Position/WorldPosition") for vertex in vertices]
        else:
            span[1] = begin
    size, track = body.find("BoundingBox/Dimensions"), body.find("Properties/Property[@name='track']")
    return Vehicle(
        name,
        int(track.attrib["value"]),
        tuple(numbers(size, "length", "width", "height")),
        *numbers(body.find("BoundingBox/Center"), "x"),
        numbers(body.find("Axles/FrontAxle"), "positionX")[0] / 2,
        np.array(times),
        np.array([numbers(place, "x", "y", "h") for place in places]),
        tuple(span),
    )


def read_fcd(file: Path, vehicles: list[Vehicle]) -> list[Vehicle]:
    """Returns the vehicles with the trajectories of SUMO's floating car data (front bumpers, angles from north)."""
    rows: dict[int, list] = {}
    for step in ET.parse(file).getroot():
        for seen in step:
            x, y, angle = numbers(seen, "x", "y", "angle")
            rows.setdefault(int(seen.attrib["id"]), []).append((float(step.attrib["time"]), x, y, np.radians(90 - angle)))
    start = min(trajectory[0][0] for trajectory in rows.values())
    played = []
    for vehicle in vehicles:
        trajectory = np.array(rows[vehicle.track])
        trajectory[:, 0], trajectory[:, 3] = trajectory[:, 0] - start, np.unwrap(trajectory[:, 3])
        front = vehicle.centre_m + vehicle.dims_m[0] / 2
        rear = trajectory[:, 1:3] - front * np.column_stack([np.cos(trajectory[:, 3]), np.sin(trajectory[:, 3])])
        poses = np.column_stack([rear, trajectory[:, 3]])
        span_s = (trajectory[0, 0], trajectory[-1, 0])
        played.append(replace(vehicle, times_s=trajectory[:, 0], poses=poses, span_s=span_s))
    return played


def read_run(folder: Path) -> dict[int, np.ndarray]:
    """Returns time (from the first row of all), x, y and heading (unwrapped) of each row by track: [n, 4]."""
    tracks: dict[int, list] = {}
    with (folder / "tracks.csv").open(newline="") as table:
        for row in csv.DictReader(table):
            tracks.setdefault(int(row["track"]), []).append(
                [float(row[name]) for name in ("time_s", "x_m", "y_m", "heading_rad")]
            )
    start = min(rows[0][0] for rows in tracks.values())
    arrays = {track: np.array(rows) for track, rows in tracks.items()}
    for rows in arrays.values():
        rows[:, 0] -= start
        rows[:, 3] = np.unwrap(rows[:, 3])
    return arrays


@dataclass
class Deviations:
    """The deviations of a played scene from the run, over all vehicles and steps."""

    metres: list[float]
    degrees: list[float]

    @classmethod
    def none(cls) -> Deviations:
        """Returns deviations without poses."""
        return cls([], [])

    def add(self, rows: np.ndarray, vehicle: Vehicle, time_s: float, place: np.ndarray, heading: float, ahead_m: float) -> None:
        """Adds a point at a distance ahead of the rear axle, and a heading, against those of the run at that time."""
        x, y, turned = (np.interp(time_s, rows[:, 0], rows[:, i]) for i in (1, 2, 3))
        ours = np.array([x, y]) + (ahead_m - vehicle.half_wheelbase_m) * np.array([np.cos(turned), np.sin(turned)])
        self.metres.append(float(np.linalg.norm(place - ours)))
        self.degrees.append(float(abs(np.degrees(np.angle(np.exp(1j * (heading - turned)))))))

    def report(self, name: str, vehicles: int) -> bool:
        """Prints a line; returns whether the limits are met: 2 cm and 0.5° everywhere."""
        print(
            f"{name}: {vehicles} vehicles, {len(self.metres)} poses, at most {100 * max(self.metres):.2f} cm "
            f"and {max(self.degrees):.3f}° from the run"
        )
        return max(self.metres) <= 0.02 and max(self.degrees) <= 0.5


def compare(simulator: str, play: Callable[[Path, list[Vehicle], dict[int, np.ndarray], float], Deviations]) -> None:
    """Runs the command line of a script that plays a scene; exits with 1 if the limits are not met.

    `play` gets the scene's folder, the vehicles, the run's rows by track, and the seconds.
    """
    parser = argparse.ArgumentParser(description=f"Plays a copied scene in {simulator} and compares it with the run.")
    parser.add_argument("scene", type=Path, help="folder that roadplane copy wrote")
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument(
        "--fcd", type=Path, metavar="FILE", help="plays this floating car data of the run instead of the scene's trajectories"
    )
    args = parser.parse_args()
    vehicles, end = read_scene(args.scene)
    if args.fcd:
        simulator += ", floating car data"
        vehicles = read_fcd(args.fcd, vehicles)
    deviations = play(args.scene, vehicles, read_run(args.run), end)
    sys.exit(0 if deviations.report(simulator, len(vehicles)) else 1)
