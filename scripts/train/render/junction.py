"""Traffic on a street with a signalled junction: following, queuing, overtaking, crossing, parking.

Each vehicle keeps to a line (a direction of the street, or of the road that crosses it). In the frame of the line, s
runs ahead and l to the left. Speeds along s follow the intelligent driver model (Treiber, Hennecke, Helbing 2000, Phys.
Rev. E 62). Vehicles shift sideways smoothly over an interval of s. Paths are those of the rear axle, as in `paths`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadplane_train.cars.mesh import CarMesh

from .camera import world_from_car
from .paths import Motion
from .places import Site, Spot

STEP_S = 0.1
REACH_M = 115.0  # distance from the site's centre where vehicles appear and disappear
REACTS_M = 60.0  # vehicles do not react to others farther ahead
WARM_S = 45.0  # traffic before the first frame
ACCELERATION, BRAKING, GAP_S, GAP_M = 1.6, 2.2, 1.1, 1.8
CYCLE_S, GREEN_S, CLEAR_S = 34.0, 15.0, 4.0  # cycle, green, clearance; the crossing road has the rest
STOP_M = 7.0  # distance from the crossing road's centre
CROSS_L = -1.7
CHANGE_M = (22.0, 12.0)  # length of a lane change, of leaving or entering a bay
SPEEDS = {"car": (9.0, 13.5), "truck": (6.5, 9.0), "bus": (6.0, 8.5)}
SHARES = {"car": 0.78, "truck": 0.12, "bus": 0.1}


@dataclass(frozen=True)
class Line:
    """A direction of a road."""

    origin: np.ndarray  # world, (2,)
    heading_rad: float
    stop_s: float  # stop line of the signal
    crosses: bool  # of the road that crosses the street


@dataclass
class Vehicle:
    """One vehicle and its trajectory; `at` works as that of `Mover`."""

    mesh: CarMesh
    wheelbase_m: float
    line: Line
    desired_mps: float
    lane: float  # l before any shift
    s: float
    speed: float = 0.0
    shifts: list[tuple[float, float, float]] = field(default_factory=list)  # from s, over this length, by l
    leaves_s: float | None = None  # leaves its bay after this time
    bay_s: float | None = None  # position of the rear axle in its target bay
    gone: bool = False
    from_step: int = 0
    track: list[tuple[float, float]] = field(default_factory=list)  # s and speed, one row per step
    front: float = 0.0  # rear axle to the front bumper, m
    back: float = 0.0  # rear bumper to the rear axle, m
    _sides: tuple | None = None

    def __post_init__(self) -> None:
        self.front = float(self.mesh.vertices[:, 0].max()) + self.wheelbase_m / 2
        self.back = -float(self.mesh.vertices[:, 0].min()) - self.wheelbase_m / 2

    @property
    def kind(self) -> str:
        """Returns car, truck or bus."""
        return self.mesh.body if self.mesh.body in SPEEDS else "car"

    def aside(self, s: float) -> tuple[float, float]:
        """Returns l and its slope at s."""
        left, slope = self.lane, 0.0
        for start, length, by in self.shifts:
            u = min(max((s - start) / length, 0.0), 1.0)
            left += by * u**3 * (10 - 15 * u + 6 * u**2)
            slope += by * 30 * u**2 * (1 - u) ** 2 / length
        return left, slope

    def sides(self) -> tuple[float, float]:
        """Returns the range of l that it occupies now, and that of its target."""
        if self._sides and self._sides[0] == (self.s, len(self.shifts)):
            return self._sides[1]
        ends = [self.aside(self.s)[0], self.aside(self.s + self.front)[0], self.aside(np.inf)[0]]
        if self.bay_s is not None and self.s + 20 < self.bay_s:
            ends = ends[:2]
        half = self.mesh.dims[1] / 2
        self._sides = (self.s, len(self.shifts)), (min(ends) - half, max(ends) + half)
        return self._sides[1]

    def at(self, time_s: float) -> Motion | None:
        """Returns its motion; None before it appears and after it leaves."""
        step = time_s / STEP_S - self.from_step
        if step < -1e-6 or step > len(self.track) - 1 + 1e-6:
            return None
        k = int(np.clip(np.floor(step), 0, len(self.track) - 2))
        share = float(np.clip(step - k, 0, 1))
        (s0, v0), (s1, v1) = self.track[k], self.track[k + 1]
        s, speed = s0 + (s1 - s0) * share, v0 + (v1 - v0) * share
        return self._motion(s, speed, (v1 - v0) / STEP_S)

    def _motion(self, s: float, speed: float, gain: float) -> Motion:
        aside, slope = self.aside(s)
        turn = np.arctan(slope)
        heading = self.line.heading_rad + turn
        ahead = np.array([np.cos(self.line.heading_rad), np.sin(self.line.heading_rad)])
        left = np.array([-ahead[1], ahead[0]])
        rear = self.line.origin + ahead * s + left * aside
        origin = rear + self.wheelbase_m / 2 * np.array([np.cos(heading), np.sin(heading)])
        speed = 0.0 if speed < 0.02 else speed / np.cos(turn)
        activity = "parked" if speed == 0 else "starting" if gain > 0.3 else "stopping" if gain < -0.3 else "moving"
        return Motion(world_from_car(*origin, heading), speed, activity)


class Junction:
    """A street with a road across it at `site.driveway_e`."""

    def __init__(
        self,
        rng: np.random.Generator,
        site: Site,
        seconds: float,
        meshes: dict[str, list[CarMesh]],
        headway_s: float,
        wheelbases: dict[int, float],
    ) -> None:
        self.rng, self.site, self.meshes, self.headway_s, self.wheelbases = rng, site, meshes, headway_s, wheelbases
        self.offset_s = rng.uniform(0, CYCLE_S)
        self.steps = round((WARM_S + seconds) / STEP_S) + 1
        e = site.driveway_e
        corner = site.place(e, 0.0)
        along, across = site.turn_rad, site.turn_rad + np.pi / 2
        self.lines = [
            Line(site.origin, along, e - STOP_M, False),
            Line(site.origin, along + np.pi, -e - STOP_M, False),
            Line(corner, across, -site.aisle_m - 1.5, True),
            Line(corner, across + np.pi, -site.aisle_m - 1.5, True),
        ]
        self.vehicles: list[Vehicle] = []
        self.bays = {
            side: sorted(
                (spot for spot in site.spots if spot.kind == "kerb" and spot.row == side), key=lambda spot: spot.e * -side
            )
            for side in (-1, 1)
        }
        self.wanted: list[tuple[float, int, float]] = []  # time from which a bay is free, for which line, s
        self._park()

    def run(self) -> list[Vehicle]:
        """Returns all vehicles at times from WARM_S before the first frame on; no two of them touched."""
        next_s = {
            (i, lane): self.rng.exponential(self.headway_s) for i, line in enumerate(self.lines) for lane in self._lanes(line)
        }
        for step in range(self.steps):
            time_s = step * STEP_S
            for (i, lane), due in next_s.items():
                if time_s >= due and self._arrive(i, lane, step):
                    next_s[i, lane] = time_s + 1.5 + self.rng.exponential(self.headway_s - 1.5)
            self._advance(time_s)
            for vehicle in self.vehicles:
                if not vehicle.gone:
                    vehicle.track.append((vehicle.s, vehicle.speed))
        for vehicle in self.vehicles:
            vehicle.from_step -= round(WARM_S / STEP_S)
        return self.vehicles

    def _lanes(self, line: Line) -> list[float]:
        if line.crosses:
            return [CROSS_L]
        return [-(k + 0.5) * self.site.period_m for k in range(self.site.lanes // 2)]

    def _draw(self, kind: str) -> CarMesh:
        return self.meshes[kind][self.rng.integers(len(self.meshes[kind]))]

    def _vehicle(self, mesh: CarMesh, line: int, lane: float, s: float) -> Vehicle:
        kind = mesh.body if mesh.body in SPEEDS else "car"
        return Vehicle(mesh, self.wheelbases[id(mesh)], self.lines[line], self.rng.uniform(*SPEEDS[kind]), lane, s)

    def _park(self) -> None:
        """Parks cars along both kerbs.

        Some will leave, and others take some of their bays. The kerb around these stays free.
        """
        for side, line in ((-1, 0), (1, 1)):
            bays, lane = self.bays[side], -(abs(self.bays[side][0].n) if self.bays[side] else 0.0)
            k = 1
            while k < len(bays) - 2:
                if self.rng.random() < 0.2:
                    leaves = WARM_S + self.rng.uniform(0.05, 0.65) * (self.steps * STEP_S - WARM_S)
                    vehicle = self._parked_vehicle(line, lane, bays[k + 1])
                    vehicle.leaves_s = leaves
                    if self.rng.random() < 0.7:
                        self.wanted.append((leaves + self.rng.uniform(4, 10), line, vehicle.s))
                    k += 3
                else:
                    if self.rng.random() < 0.7:
                        self._parked_vehicle(line, lane, bays[k])
                    k += 1

    def _parked_vehicle(self, line: int, lane: float, spot: Spot) -> Vehicle:
        vehicle = self._vehicle(self._draw("car"), line, lane + self.rng.normal(0, 0.08), 0.0)
        middle = spot.e * (1 if line == 0 else -1)
        vehicle.s = middle - vehicle.wheelbase_m / 2 + self.rng.normal(0, 0.1)
        self.vehicles.append(vehicle)
        return vehicle

    def _arrive(self, line: int, lane: float, step: int) -> bool:
        kinds = list(SHARES)
        vehicle = self._vehicle(self._draw(str(self.rng.choice(kinds, p=list(SHARES.values())))), line, lane, -REACH_M)
        low, high = vehicle.sides()
        for other in self._others(vehicle):
            near = other.s - other.back < vehicle.s + vehicle.front + 8 and other.s > vehicle.s - 1
            if near and self._beside(other, low, high):
                return False
        vehicle.speed, vehicle.from_step = 0.8 * vehicle.desired_mps, step
        due = [bay for bay in self.wanted if bay[1] == line and step * STEP_S > bay[0]]
        outer = lane == self._lanes(self.lines[line])[-1]
        if due and outer and vehicle.kind == "car":
            self.wanted.remove(due[0])
            vehicle.bay_s = due[0][2]
            by = -(self.site.aisle_m - 1.15) - lane
            vehicle.shifts.append((vehicle.bay_s - CHANGE_M[1] - 0.5, CHANGE_M[1], by))
        self.vehicles.append(vehicle)
        return True

    def _others(self, vehicle: Vehicle) -> list[Vehicle]:
        on_line = (v for v in self.vehicles if v.line is vehicle.line and v is not vehicle and not v.gone)
        return [v for v in on_line if abs(v.s - vehicle.s) < REACTS_M]

    @staticmethod
    def _beside(other: Vehicle, low: float, high: float) -> bool:
        a, b = other.sides()
        return a < high + 0.35 and b > low - 0.35

    def _is_green(self, line: Line, time_s: float) -> bool:
        clock = (time_s + self.offset_s) % CYCLE_S
        if line.crosses:
            return GREEN_S + CLEAR_S < clock < CYCLE_S - CLEAR_S
        return clock < GREEN_S

    def _advance(self, time_s: float) -> None:
        gains = []
        for vehicle in self.vehicles:
            if vehicle.gone or (vehicle.leaves_s is None and vehicle.lane < -self.site.aisle_m + 1.6):
                gains.append(0.0)
                continue
            if vehicle.leaves_s is not None and not vehicle.shifts:
                self._leave(vehicle, time_s)
                if not vehicle.shifts:
                    gains.append(0.0)
                    continue
            gains.append(self._gain(vehicle, time_s))
        for vehicle, gain in zip(self.vehicles, gains, strict=True):
            before = vehicle.speed
            vehicle.speed = max(before + gain * STEP_S, 0.0)
            vehicle.s += (before + vehicle.speed) / 2 * STEP_S
            vehicle.gone = vehicle.gone or vehicle.s > REACH_M + 15

    def _leave(self, vehicle: Vehicle, time_s: float) -> None:
        """Pulls out when the lane is free."""
        to = self._lanes(vehicle.line)[-1]
        if time_s < (vehicle.leaves_s or 0.0):
            return
        for other in self._others(vehicle):
            near = -28 < other.s - vehicle.s < 16 and self._beside(other, to - 1.2, to + 1.2)
            if near and other.lane > -self.site.aisle_m + 1.6:
                return
        vehicle.shifts.append((vehicle.s + 0.3, CHANGE_M[1], to - vehicle.lane))

    def _gain(self, vehicle: Vehicle, time_s: float) -> float:
        nose, (low, high) = vehicle.s + vehicle.front, vehicle.sides()
        gap, leader = np.inf, 0.0
        ahead = None
        for other in self._others(vehicle):
            room = other.s - other.back - nose
            if -2.0 < room < gap and other.s > vehicle.s and self._beside(other, low, high):
                gap, leader, ahead = room, other.speed, other
        to_stop = vehicle.line.stop_s - nose
        if 0 < to_stop < gap and not self._is_green(vehicle.line, time_s) and to_stop > vehicle.speed**2 / (2 * 3.5):
            gap, leader, ahead = to_stop, 0.0, None
        desired = vehicle.desired_mps
        if vehicle.bay_s is not None:
            to_bay = vehicle.bay_s - vehicle.s
            if to_bay < 0.05:
                return -4.0
            desired = min(desired, 3.0 if to_bay < 18 else desired, max(np.sqrt(2 * 0.9 * to_bay), 0.3))
        elif ahead is not None and gap < 30:
            self._overtake(vehicle, ahead)
        wanted = GAP_M + max(
            vehicle.speed * GAP_S + vehicle.speed * (vehicle.speed - leader) / (2 * np.sqrt(ACCELERATION * BRAKING)), 0.0
        )
        gain = ACCELERATION * (1 - (vehicle.speed / desired) ** 4 - (wanted / max(gap, 0.1)) ** 2)
        return float(np.clip(gain, -7.0, ACCELERATION))

    def _overtake(self, vehicle: Vehicle, ahead: Vehicle) -> None:
        """Changes lanes behind a slower vehicle if the other lane is free."""
        lanes = self._lanes(vehicle.line)
        here = vehicle.aside(np.inf)[0]
        settled = not vehicle.shifts or vehicle.s > vehicle.shifts[-1][0] + vehicle.shifts[-1][1] + 5
        slow = ahead.desired_mps < vehicle.desired_mps - 1.5 and vehicle.speed > 3 and ahead.speed > 2
        if len(lanes) < 2 or not settled or not slow or abs(vehicle.s + 30 - vehicle.line.stop_s) < 45:
            return
        to = max((lane for lane in lanes if abs(lane - here) > 1), key=lambda lane: -abs(lane - here))
        for other in self._others(vehicle):
            if -18 < other.s - vehicle.s < 25 and self._beside(other, to - 1.2, to + 1.2):
                return
        vehicle.shifts.append((vehicle.s, max(CHANGE_M[0], 3 * vehicle.speed), to - here))


def touching(vehicles: list[Vehicle], seconds: float) -> int:
    """Returns the pairs that come closer than 0.1 m at some time."""
    pairs = set()
    for time_s in np.arange(0, seconds, 0.5):
        there = [(i, v, m) for i, v in enumerate(vehicles) if (m := v.at(time_s)) is not None]
        places = np.array([m.world_from_car[:2, 3] for _, _, m in there])
        for a in range(len(there)):
            for b in np.nonzero(np.linalg.norm(places[a + 1 :] - places[a], axis=1) < 17)[0] + a + 1:
                if _touch(there[a][1], there[a][2], there[b][1], there[b][2]):
                    pairs.add((there[a][0], there[b][0]))
    return len(pairs)


def _touch(a: Vehicle, motion_a: Motion, b: Vehicle, motion_b: Motion) -> bool:
    for (one, first), (other, second) in (((a, motion_a), (b, motion_b)), ((b, motion_b), (a, motion_a))):
        x = np.linspace(one.mesh.vertices[:, 0].min(), one.mesh.vertices[:, 0].max(), 9)
        outline = np.array([(p, q) for p in x for q in (-one.mesh.dims[1] / 2, one.mesh.dims[1] / 2)])
        pose, frame = first.world_from_car, second.world_from_car
        local = (outline @ pose[:2, :2].T + pose[:2, 3] - frame[:2, 3]) @ frame[:2, :2]
        inside = (np.abs(local[:, 1]) < other.mesh.dims[1] / 2 + 0.1) & (local[:, 0] < other.mesh.vertices[:, 0].max() + 0.1)
        if (inside & (local[:, 0] > other.mesh.vertices[:, 0].min() - 0.1)).any():
            return True
    return False
