"""Plans traffic: manoeuvres on a site, timed so that no car touches another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from roadplane_train.cars.mesh import CarMesh

from .camera import Camera
from .paths import Drive, Leg, Motion, Piece, reach, straight, turn, turn_across
from .places import Site, Spot

GAP_M = 0.3  # between cars
CHECK_S = 0.2
TRIES = 60
LEAST_SEEN = 0.3  # share of the clip that a driver is in the picture


@dataclass
class Mover:
    """A car of known size that drives, or is parked throughout."""

    dims: np.ndarray
    wheelbase_m: float
    bounds: tuple[float, float]  # rear and front end, car frame
    drive: Drive | None = None
    rest: Motion | None = None
    _places: tuple[object, np.ndarray, np.ndarray] | None = field(default=None, repr=False)  # drive or rest, times, positions

    def at(self, time_s: float) -> Motion:
        """Returns its motion at a time."""
        if self.drive is not None:
            return self.drive.at(time_s)
        assert self.rest is not None
        return self.rest

    def places(self, times: np.ndarray) -> np.ndarray:
        """Returns its positions, (n, 2); the last result is cached."""
        source = self.drive or self.rest
        if self._places is None or self._places[0] is not source or not np.array_equal(self._places[1], times):
            self._places = source, times, np.array([self.at(time_s).world_from_car[:2, 3] for time_s in times])
        return self._places[2]


def mover(mesh: CarMesh, wheelbase_m: float, rest: Motion | None = None) -> Mover:
    """Returns a car that drives, or is parked throughout if `rest` is given."""
    return Mover(mesh.dims, wheelbase_m, (float(mesh.vertices[:, 0].min()), float(mesh.vertices[:, 0].max())), rest=rest)


def collide(a: Mover, b: Mover, seconds: float) -> bool:
    """Returns whether two cars come closer than GAP_M: outline points of one in the other's rectangle."""
    if a.drive is None and b.drive is None:
        return False
    times = np.arange(0, seconds + CHECK_S, CHECK_S)
    for time_s in times[np.linalg.norm(a.places(times) - b.places(times), axis=1) < 8]:
        pose_a, pose_b = a.at(time_s).world_from_car, b.at(time_s).world_from_car
        if _reaches(pose_a, a, pose_b, b) or _reaches(pose_b, b, pose_a, a):
            return True
    return False


def _reaches(pose_a: np.ndarray, a: Mover, pose_b: np.ndarray, b: Mover) -> bool:
    x = np.linspace(*a.bounds, 7)
    outline = np.array([(x_, y) for x_ in x for y in (-a.dims[1] / 2, 0, a.dims[1] / 2)])
    world = outline @ pose_a[:2, :2].T + pose_a[:2, 3]
    local = (world - pose_b[:2, 3]) @ pose_b[:2, :2]
    beside = np.abs(local[:, 1]) < b.dims[1] / 2 + GAP_M
    return bool((beside & (local[:, 0] > b.bounds[0] - GAP_M) & (local[:, 0] < b.bounds[1] + GAP_M)).any())


def in_picture(camera: Camera, motions: list[Motion]) -> np.ndarray:
    """Returns whether a car's centre is in the picture, ignoring occlusion, (n,)."""
    points = np.array([motion.world_from_car[:3, 3] for motion in motions])
    pixels, depth = camera.pixel_from_world(points + [0, 0, 0.6])
    return (depth > 6) & (pixels > 0).all(1) & (pixels < camera.image_size_px).all(1)


class Traffic:
    """Adds drives to a site one by one; each begins, ends or passes between `begin_s` and `begin_s + span_s`."""

    def __init__(self, rng: np.random.Generator, site: Site, seconds: float, camera: Camera) -> None:
        self.rng, self.site, self.seconds, self.camera = rng, site, seconds, camera
        self.middle_e = float((camera.ground_from_pixel(np.array(camera.principal_point_px))[:2] - site.origin) @ site.along)
        self.movers: list[Mover] = []
        self.begin_s, self.span_s = 0.0, seconds

    def add(
        self,
        car: Mover,
        manoeuvre: Callable[[float], Drive | None],
        tries: int = TRIES,
        suits: Callable[[Mover], bool] = lambda _: True,
    ) -> bool:
        """Adds a drive of a manoeuvre if some choice of it suits and stays clear of all other cars."""
        for _ in range(tries):
            drive = manoeuvre(car.wheelbase_m)
            if drive is None:
                continue
            car.drive = drive
            if self._seen(drive) and suits(car) and not any(collide(car, other, self.seconds) for other in self.movers):
                self.movers.append(car)
                return True
        car.drive = None
        return False

    def _seen(self, drive: Drive) -> bool:
        """Returns whether the car is in the picture for long enough."""
        inside = in_picture(self.camera, [drive.at(t) for t in self.begin_s + np.arange(0, self.span_s, 0.5)])
        return bool(inside.mean() >= LEAST_SEEN)

    def _passing(self, drive: Drive, reach_s: float) -> Drive:
        """Starts a drive such that it passes the picture's centre (`reach_s` after its start) in the given time."""
        drive.start_s = self.begin_s + self.rng.uniform(0.25, 0.75) * self.span_s - reach_s
        return drive

    # On both kinds of site. `direction` is +1 along e, −1 against it; traffic keeps right.

    def through(self, wheelbase_m: float, halt: bool = False) -> Drive:
        """Drives along an aisle or a lane, perhaps with a halt."""
        rng, site = self.rng, self.site
        direction = rng.choice([-1, 1])
        n, cruise = self._lane(direction), self._cruise()
        before, after = 45.0 + rng.uniform(-6, 6), 55.0
        legs = [Leg([straight(before + after)], cruise)]
        if halt:
            legs = [
                Leg([straight(before)], cruise, to_rest=True, rest_s=rng.uniform(1.5, 3.0)),
                Leg([straight(after)], cruise, from_rest=True),
            ]
        drive = Drive(legs, wheelbase_m).placed(site.pose(self.middle_e - direction * before, n, 0.0 if direction > 0 else np.pi))
        return self._passing(drive, before / cruise + (1.0 if halt else 0.0))

    def _lane(self, direction: int) -> float:
        rng, site = self.rng, self.site
        if site.layout == "lot":
            return rng.integers(0, 2) * site.period_m - direction * rng.uniform(1.3, 1.6)
        return -direction * (rng.integers(site.lanes // 2) + 0.5) * site.period_m + rng.normal(0, 0.1)

    def _cruise(self) -> float:
        return self.rng.uniform(3.0, 5.0) if self.site.layout == "lot" else self.rng.uniform(6.5, 10.5)

    # Parking lots

    def out_of_aisle(self, wheelbase_m: float) -> Drive:
        """Drives along an aisle to the crossing lane at its end, then left or right."""
        rng, site = self.rng, self.site
        side = rng.choice([-1, 1])
        bend = turn(side * 90, rng.uniform(5.0, 6.5))
        lane_e = site.end_e + 3.4 + side * 1.6  # keeps right: farther out if it turns left
        before = 40.0
        n = rng.integers(0, 2) * site.period_m - rng.uniform(1.3, 1.6)
        drive = Drive([Leg([straight(before), bend, straight(50)], self._cruise())], wheelbase_m)
        drive.placed(site.pose(lane_e - reach([bend])[0] - before, n, 0.0))
        return self._passing(drive, (before + bend.length_m / 2 + 3) / 3.8)

    def into_aisle(self, wheelbase_m: float) -> Drive:
        """Drives along the crossing lane and into an aisle, left or right."""
        rng, site = self.rng, self.site
        direction = rng.choice([-1, 1])  # along n
        bend = turn(direction * 90, rng.uniform(5.0, 6.5))  # up and to the left, or down and to the right: towards −e
        lane_e = site.end_e + 3.4 + direction * 1.6
        n_aisle = rng.integers(0, 2) * site.period_m + rng.uniform(1.3, 1.6)
        before = 30.0
        drive = Drive([Leg([straight(before), bend, straight(60)], self._cruise())], wheelbase_m)
        drive.placed(site.pose(lane_e, n_aisle - direction * (reach([bend])[0] + before), direction * np.pi / 2))
        return self._passing(drive, (before + bend.length_m / 2) / 3.8)

    def _bay_turn(
        self, spot: Spot, direction: int, wheelbase_m: float, radius_m: float, backwards: bool
    ) -> tuple[Piece, float] | None:
        """Returns the turn between an aisle, driven along `direction`, and a bay; and the straight rest in the bay."""
        site = self.site
        toward = 1 if spot.row % 2 else -1  # from the aisle to the bay, along n
        aisle_n = (spot.row // 2) * site.period_m
        bend = turn(90, radius_m, 2.0)
        nose_in = np.sin(spot.heading_rad) * toward > 0
        if nose_in == backwards:
            return None
        rear_n = (spot.n - aisle_n) * toward - (wheelbase_m / 2 if nose_in else -wheelbase_m / 2)
        lane_n = -direction * 1.4 * toward
        rest = rear_n - lane_n - abs(reach([bend])[1])
        return (bend, rest) if rest > 0.2 else None

    def park(self, spot: Spot) -> Callable[[float], Drive | None]:
        """Drives into a bay: forwards, or past it and backwards, as the spot's heading requires."""

        def manoeuvre(wheelbase_m: float) -> Drive | None:
            rng = self.rng
            direction = rng.choice([-1, 1])
            toward = 1 if spot.row % 2 else -1
            backwards = np.sin(spot.heading_rad) * toward < 0
            found = self._bay_turn(spot, direction, wheelbase_m, rng.uniform(4.0, 4.8), backwards)
            if found is None:
                return None
            bend, rest = found
            cruise, before = rng.uniform(2.6, 3.6), rng.uniform(25, 35)
            if backwards:  # the heading turns from `direction` to the bay's, away from `toward`
                bend = Piece(bend.length_m, -direction * toward * np.pi / 2, bend.ramp_m)
                legs = [
                    Leg([straight(before)], cruise, to_rest=True, rest_s=rng.uniform(0.6, 1.2)),
                    Leg([bend, straight(rest)], 1.7, backwards=True, from_rest=True, to_rest=True, parking_from=0),
                ]
            else:
                bend = Piece(bend.length_m, direction * toward * np.pi / 2, bend.ramp_m)
                legs = [Leg([straight(before), bend, straight(rest)], cruise, to_rest=True, parking_from=1)]
            drive = Drive(legs, wheelbase_m).placed(self.site.pose(spot.e, spot.n, spot.heading_rad), at_end=True)
            drive.start_s = self.begin_s + rng.uniform(0.72, 0.95) * self.span_s - drive.length_s
            return drive

        return manoeuvre

    def leave(self, spot: Spot) -> Callable[[float], Drive | None]:
        """Drives out of a bay: backwards and away, or straight out forwards, as the spot's heading requires."""

        def manoeuvre(wheelbase_m: float) -> Drive | None:
            rng = self.rng
            direction = rng.choice([-1, 1])  # direction in which it drives away
            toward = 1 if spot.row % 2 else -1
            nose_in = np.sin(spot.heading_rad) * toward > 0
            found = self._bay_turn(spot, direction, wheelbase_m, rng.uniform(4.0, 4.8), backwards=not nose_in)
            if found is None:
                return None
            bend, rest = found
            cruise = rng.uniform(3.0, 4.5)
            if nose_in:
                bend = Piece(bend.length_m, -direction * toward * np.pi / 2, bend.ramp_m)
                pause = rng.uniform(0.6, 1.2)
                legs = [
                    Leg([straight(rest), bend], 1.7, backwards=True, from_rest=True, to_rest=True, rest_s=pause),
                    Leg([straight(60)], cruise, from_rest=True),
                ]
            else:
                bend = Piece(bend.length_m, direction * toward * np.pi / 2, bend.ramp_m)
                legs = [Leg([straight(rest), bend, straight(60)], cruise, from_rest=True)]
            drive = Drive(legs, wheelbase_m).placed(self.site.pose(spot.e, spot.n, spot.heading_rad))
            drive.start_s = self.begin_s + rng.uniform(0.08, 0.4) * self.span_s
            return drive

        return manoeuvre

    # Streets

    def u_turn(self, wheelbase_m: float) -> Drive:
        """Turns from the kerb side's lane to the opposite one, four lanes across."""
        rng, site = self.rng, self.site
        direction, before = rng.choice([-1, 1]), 40.0
        offset = (site.lanes - 1) * site.period_m
        bend, cruise = turn_across(180, offset), rng.uniform(5.5, 7.5)
        drive = Drive([Leg([straight(before), bend, straight(50)], cruise)], wheelbase_m)
        drive.placed(
            site.pose(
                self.middle_e + rng.uniform(-5, 5) - direction * before, -direction * offset / 2, 0.0 if direction > 0 else np.pi
            )
        )
        return self._passing(drive, before / cruise + 3.5)

    def into_driveway(self, wheelbase_m: float) -> Drive:
        """Leaves the road, to the left across the other lanes or to the right."""
        rng, site = self.rng, self.site
        direction, side, before = rng.choice([-1, 1]), rng.choice([-1, 1]), 40.0
        lane = 0 if side > 0 else site.lanes // 2 - 1
        bend, cruise = turn(side * 90, rng.uniform(5.5, 6.5)), rng.uniform(6, 8)
        n = -direction * (lane + 0.5) * site.period_m
        drive = Drive([Leg([straight(before), bend, straight(25)], cruise)], wheelbase_m)
        drive.placed(site.pose(site.driveway_e - direction * (reach([bend])[0] + before), n, 0.0 if direction > 0 else np.pi))
        return self._passing(drive, before / cruise + 3.0)

    def _to_kerb(self, spot: Spot) -> list[Piece]:
        """Returns the double curve from the outer lane's centre to a kerb spot."""
        offset = abs(spot.n) - (self.site.lanes / 2 - 0.5) * self.site.period_m
        low, high = 4.0, 40.0
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (low, middle) if abs(reach([turn(-middle, 9, 2), turn(middle, 9, 2)])[1]) > offset else (middle, high)
        return [turn(-low, 9, 2), turn(low, 9, 2)]

    def pull_in(self, spot: Spot) -> Callable[[float], Drive | None]:
        """Drives from the lane to the kerb."""

        def manoeuvre(wheelbase_m: float) -> Drive:
            rng = self.rng
            pieces = [straight(rng.uniform(30, 45)), *self._to_kerb(spot), straight(1.0)]
            legs = [Leg(pieces, rng.uniform(4, 6), to_rest=True, parking_from=1)]
            drive = Drive(legs, wheelbase_m).placed(self.site.pose(spot.e, spot.n, spot.heading_rad), at_end=True)
            drive.start_s = self.begin_s + rng.uniform(0.6, 0.95) * self.span_s - drive.length_s
            return drive

        return manoeuvre

    def pull_out(self, spot: Spot, room_m: float = 2.5) -> Callable[[float], Drive | None]:
        """Reverses a little, as a parked driver does, then drives out into the lane."""

        def manoeuvre(wheelbase_m: float) -> Drive:
            rng = self.rng
            curves = self._to_kerb(spot)
            legs = [
                Leg([straight(room_m)], 1.4, backwards=True, from_rest=True, to_rest=True, rest_s=rng.uniform(0.5, 1.0)),
                Leg([curves[1], curves[0], straight(60)], rng.uniform(6, 8), from_rest=True),
            ]
            drive = Drive(legs, wheelbase_m).placed(self.site.pose(spot.e, spot.n, spot.heading_rad))
            drive.start_s = self.begin_s + rng.uniform(0.05, 0.4) * self.span_s
            return drive

        return manoeuvre
