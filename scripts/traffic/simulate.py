"""Simulates traffic in SUMO: tracks of all vehicles, and the conflicts that SUMO's SSM device finds."""

from __future__ import annotations

import math
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import sumo

BIN = Path(sumo.SUMO_HOME) / "bin"
# Numbers of SUMO's encounter types (MSDevice_SSM.h): following, merging, crossing, oncoming, collision.
KINDS = {2: "following", 3: "following", 6: "merging", 7: "merging", 20: "oncoming", 111: "collision"}
KINDS |= dict.fromkeys((10, 11, 12, 13, 14, 15, 16, 17), "crossing")
ARMS = {"w": (-150, 0, 2), "e": (150, 0, 2), "s": (0, -150, 1), "n": (0, 150, 1)}


@dataclass
class Extreme:
    """The most critical value of a measure."""

    value: float
    time_s: float
    kind: str


@dataclass
class Pair:
    """All that SUMO's devices of two vehicles say about them."""

    ttc: Extreme | None = None
    drac: Extreme | None = None
    pet: Extreme | None = None
    # Deceleration to avoid a crash at each time, m/s².
    dracs: dict[float, float] = field(default_factory=dict)


@dataclass
class Simulation:
    """A simulation: SUMO's numbers of the vehicles, their states and their conflicts."""

    numbers: dict[str, int]
    # Centre x, y (m), heading (rad), speed (m/s), acceleration (m/s²) at each time of each vehicle.
    states: dict[str, dict[float, tuple[float, ...]]]
    pairs: dict[frozenset[str], Pair]
    sizes_m: dict[str, tuple[float, float]]

    def approach(self, name: str, nearest_m: float) -> dict[float, tuple[float, ...]]:
        """The states of a vehicle before it first is within a distance of the junction's centre."""
        states = self.states[name]
        near = [time_s for time_s, state in states.items() if math.hypot(*state[:2]) < nearest_m]
        return {time_s: state for time_s, state in states.items() if not near or time_s < near[0]}

    def tracks(self, nearest_m: float = 0) -> str:
        """Tracks as CSV, up to a distance from the junction's centre."""
        lines = ["time_s,track,x_m,y_m,heading_rad,speed_mps,length_m,width_m"]
        for name in self.states:
            length, width = self.sizes_m[name]
            for time_s, (x, y, heading, speed, _) in self.approach(name, nearest_m).items():
                lines.append(f"{time_s:.2f},{self.numbers[name]},{x:.4f},{y:.4f},{heading:.6f},{speed:.4f},{length},{width}")
        return "\n".join(lines) + "\n"


def call(program: str, *arguments: object) -> None:
    """Runs a program of SUMO."""
    subprocess.run([BIN / program, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def network(folder: Path, straight_only: bool) -> Path:
    """Builds a junction of four arms with one lane per direction; the road from west to east has the right of way."""
    nodes = "".join(f'<node id="{arm}" x="{x}" y="{y}"/>' for arm, (x, y, _) in ARMS.items())
    edges = "".join(
        f'<edge id="{arm}_in" from="{arm}" to="c" numLanes="1" speed="13.9" priority="{priority}"/>'
        f'<edge id="{arm}_out" from="c" to="{arm}" numLanes="1" speed="13.9" priority="{priority}"/>'
        for arm, (_, _, priority) in ARMS.items()
    )
    across = {"w": "e", "e": "w", "s": "n", "n": "s"}
    targets = {a: across[a] if straight_only else [b for b in ARMS if b != a] for a in ARMS}
    connections = "".join(
        f'<connection from="{a}_in" to="{b}_out" fromLane="0" toLane="0" visibility="200"/>' for a in ARMS for b in targets[a]
    )
    for suffix, text in {
        "nod": f'<nodes><node id="c" x="0" y="0" type="priority"/>{nodes}</nodes>',
        "edg": f"<edges>{edges}</edges>",
        "con": f"<connections>{connections}</connections>",
    }.items():
        (folder / f"net.{suffix}.xml").write_text(text)
    kinds = {"node": "nod", "edge": "edg", "connection": "con"}
    files = [f"--{kind}-files={folder}/net.{suffix}.xml" for kind, suffix in kinds.items()]
    call("netconvert", *files, "-o", folder / "net.xml", "--offset.disable-normalization", "true")
    return folder / "net.xml"


def simulate(folder: Path, flows: dict[str, float], types: str, straight_only: bool, limits: tuple[float, ...]) -> Simulation:
    """Simulates flows, e.g. `{"we": 0.1}` vehicles per second from west to east, and reads the outputs. `types` defines
    the type `main` for the road with right of way and the type `minor`. The limits are those of TTC, DRAC and PET."""
    net = network(folder, straight_only)
    text = "".join(
        f'<flow id="{flow}" from="{flow[0]}_in" to="{flow[1]}_out" type="{"main" if flow[0] in "we" else "minor"}" '
        f'begin="0" end="900" probability="{rate}" departSpeed="max" departPos="base"/>'
        for flow, rate in flows.items()
    )
    (folder / "routes.xml").write_text(f"<routes>{types}{text}</routes>")
    options = {
        "net-file": net,
        "route-files": folder / "routes.xml",
        "step-length": 0.1,
        "seed": 5,
        "precision": 4,
        "fcd-output": folder / "fcd.xml",
        "fcd-output.acceleration": "true",
        "collision.action": "none",
        "time-to-teleport": -1,
        "no-step-log": "true",
        "device.ssm.probability": 1,
        "device.ssm.measures": "TTC DRAC PET",
        "device.ssm.thresholds": " ".join(map(str, limits)),
        "device.ssm.range": 100,
        "device.ssm.extratime": 10,
        "device.ssm.trajectories": "true",
        "device.ssm.file": folder / "ssm.xml",
    }
    call("sumo", *(f"--{name}={value}" for name, value in options.items()))
    sizes = {kind.get("id"): tuple(float(kind.get(k)) for k in ("length", "width")) for kind in ET.fromstring(f"<t>{types}</t>")}
    return read(folder, sizes)


def read(folder: Path, sizes: dict[str, tuple[float, float]]) -> Simulation:
    """Reads the tracks and the conflicts."""
    states: dict[str, dict[float, tuple[float, ...]]] = {}
    sizes_m = {}
    for step in ET.parse(folder / "fcd.xml").iter("timestep"):
        time_s = round(float(step.get("time")), 2)
        for row in step.iter("vehicle"):
            name = row.get("id")
            sizes_m[name] = sizes[row.get("type")]
            # SUMO's positions are those of front bumpers, its angles are clockwise from north.
            heading = math.radians(90 - float(row.get("angle")))
            back = sizes_m[name][0] / 2
            x, y = float(row.get("x")) - back * math.cos(heading), float(row.get("y")) - back * math.sin(heading)
            state = (x, y, heading, float(row.get("speed")), float(row.get("acceleration")))
            states.setdefault(name, {})[time_s] = state
    pairs: dict[frozenset[str], Pair] = {}
    for conflict in ET.parse(folder / "ssm.xml").iter("conflict"):
        pair = pairs.setdefault(frozenset((conflict.get("ego"), conflict.get("foe"))), Pair())
        times = [round(float(t), 2) for t in conflict.find("timeSpan").get("values").split()]
        dracs = conflict.find("DRACSpan").get("values").split()
        for time_s, drac in zip(times, dracs, strict=True):
            if drac != "NA":
                pair.dracs[time_s] = max(float(drac), pair.dracs.get(time_s, 0.0))
        for name, tag, worse in (("ttc", "minTTC", min), ("drac", "maxDRAC", max), ("pet", "PET", min)):
            found = conflict.find(tag)
            if found is None or found.get("value") == "NA":
                continue
            one = Extreme(float(found.get("value")), float(found.get("time")), KINDS.get(int(found.get("type")), ""))
            other = getattr(pair, name)
            setattr(pair, name, one if other is None else worse(other, one, key=lambda extreme: extreme.value))
    return Simulation({name: i for i, name in enumerate(states)}, states, pairs, sizes_m)
