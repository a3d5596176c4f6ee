"""Plays a copied scene in SUMO, and compares every vehicle's position and heading every 0.1 s with the run's."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np
import sumo
import traci
from scene import STEP_S, Deviations, Vehicle, compare

BIN = Path(sumo.SUMO_HOME) / "bin"


def network(scene: Path, folder: Path) -> Path:
    """Converts the OpenDRIVE road to SUMO's network, in the same coordinates."""
    out = folder / "road.net.xml"
    subprocess.run(
        [
            BIN / "netconvert",
            "--opendrive-files",
            scene / "road.xodr",
            "--output-file",
            out,
            "--offset.disable-normalization",
            "true",
            "--no-warnings",
        ],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return out


def place(vehicle: Vehicle, time_s: float, edge: str) -> None:
    """Moves a vehicle; SUMO's positions are those of front bumpers, its angles are clockwise from north."""
    pose = vehicle.at(time_s)
    front = vehicle.ahead(pose, vehicle.centre_m + vehicle.dims_m[0] / 2)
    traci.vehicle.moveToXY(vehicle.name, edge, 0, *front, angle=90 - np.degrees(pose[2]), keepRoute=2)


def drive(vehicles: list[Vehicle], rows: dict[int, np.ndarray], end: float) -> Deviations:
    """Plays step by step."""
    edge = next(edge for edge in traci.edge.getIDList() if not edge.startswith(":"))
    traci.route.add("road", [edge])
    for vehicle in vehicles:
        traci.vehicletype.copy("DEFAULT_VEHTYPE", vehicle.name)
        length, width, height = vehicle.dims_m
        traci.vehicletype.setLength(vehicle.name, length)
        traci.vehicletype.setWidth(vehicle.name, width)
        traci.vehicletype.setHeight(vehicle.name, height)
    there: set[str] = set()
    deviations = Deviations.none()
    for step in range(int(end / STEP_S) + 1):
        time_s = step * STEP_S
        now = [v for v in vehicles if v.span_s[0] <= time_s <= v.span_s[1]]
        for name in there - {v.name for v in now}:
            traci.vehicle.remove(name)
        for vehicle in now:
            if vehicle.name not in there:
                traci.vehicle.add(vehicle.name, "road", vehicle.name, depart="now")
                traci.vehicle.setSpeedMode(vehicle.name, 0)
            place(vehicle, time_s, edge)
        there = {v.name for v in now}
        traci.simulationStep()
        for vehicle in now:
            found = np.array(traci.vehicle.getPosition(vehicle.name))
            heading = np.radians(90 - traci.vehicle.getAngle(vehicle.name))
            ahead = vehicle.centre_m + vehicle.dims_m[0] / 2
            deviations.add(rows[vehicle.track], vehicle, time_s, found, heading, ahead)
    return deviations


def play(scene: Path, vehicles: list[Vehicle], rows: dict[int, np.ndarray], end: float) -> Deviations:
    """Starts SUMO on the scene's road."""
    with tempfile.TemporaryDirectory() as folder:
        net = network(scene, Path(folder))
        traci.start(
            [
                str(BIN / "sumo"),
                "--net-file",
                str(net),
                "--step-length",
                str(STEP_S),
                "--no-step-log",
                "true",
                "--collision.action",
                "none",
                "--time-to-teleport",
                "-1",
                "--no-warnings",
                "true",
            ]
        )
        try:
            return drive(vehicles, rows, end)
        finally:
            traci.close()


if __name__ == "__main__":
    compare("SUMO", play)
