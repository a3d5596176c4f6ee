"""Plays a copied scene in SUMO and compares every vehicle's place and heading at every 0.1 s with the run's."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import sumo
import traci
from scene import STEP_S, Deviations, Vehicle, read_run, read_scene

BIN = Path(sumo.SUMO_HOME) / "bin"


def network(scene: Path, folder: Path) -> Path:
    """The OpenDRIVE road as SUMO's own network, where it lies."""
    out = folder / "road.net.xml"
    subprocess.run([BIN / "netconvert", "--opendrive-files", scene / "road.xodr", "--output-file", out,
                    "--offset.disable-normalization", "true", "--no-warnings"], check=True, stdout=subprocess.DEVNULL)
    return out


def place(vehicle: Vehicle, time_s: float, edge: str) -> None:
    """Moves a vehicle; SUMO's places are those of front bumpers, its angles clockwise from north."""
    pose = vehicle.at(time_s)
    front = vehicle.ahead(pose, vehicle.centre_m + vehicle.dims_m[0] / 2)
    traci.vehicle.moveToXY(vehicle.name, edge, 0, *front, angle=90 - np.degrees(pose[2]), keepRoute=2)


def play(vehicles: list[Vehicle], rows: dict[int, np.ndarray], end: float) -> Deviations:
    """Step by step."""
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


def main() -> None:
    """Exit code 1 where the bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path, help="folder that roadplane copy wrote")
    parser.add_argument("run", type=Path, help="folder of the run")
    args = parser.parse_args()
    vehicles, end = read_scene(args.scene)
    with tempfile.TemporaryDirectory() as folder:
        net = network(args.scene, Path(folder))
        traci.start([str(BIN / "sumo"), "--net-file", str(net), "--step-length", str(STEP_S), "--no-step-log", "true",
                     "--collision.action", "none", "--time-to-teleport", "-1", "--no-warnings", "true"])
        try:
            deviations = play(vehicles, read_run(args.run), end)
        finally:
            traci.close()
    sys.exit(0 if deviations.report("SUMO", len(vehicles)) else 1)


if __name__ == "__main__":
    main()
