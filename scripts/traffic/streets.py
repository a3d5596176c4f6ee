"""Streets with known arms, lanes and stop lines, and the tracks that a camera sees of their vehicles.

`rendered` takes the streets of `roadplane-train render busy`. `turning` makes junctions on which vehicles turn, which
those streets lack. Both return a `Street`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadplane_train.cars.builder import sample_car
from roadplane_train.cars.heavy import sample_heavy
from roadplane_train.render.busy import MODELS, _in_view, sample_camera, sample_street
from roadplane_train.render.camera import Camera
from roadplane_train.render.junction import GAP_M, Junction
from roadplane_train.render.places import make_street
from roadplane_train.render.stills import wheelbase

LEAST_PX = 20.0  # longer side of a vehicle that the detector finds
LEAST_SHARE = 0.3  # visible share of such a vehicle
BRIDGED_S = 2.0  # longest time that the tracker follows a hidden vehicle
RATE_HZ = 5.0


@dataclass
class Track:
    """The states of one vehicle: time, x, y, heading, speed, sd of x, sd of y (n, 7)."""

    rows: np.ndarray
    length_m: float
    width_m: float
    movement: int | None  # index of the true movement; None: it parks, or was parked
    kind: str = "car"


@dataclass
class Movement:
    """A true flow: the middles of its lanes (polylines), and where the front bumpers stop on them, if they do."""

    lanes: list[np.ndarray]
    stops: list[np.ndarray] = field(default_factory=list)


@dataclass
class Street:
    """A street with the tracks of one clip."""

    tracks: list[Track]
    movements: list[Movement]
    seconds: float


def rendered(seed: int, number: int, seconds: float, lanes: int = 4) -> Street:
    """Returns a street of the renderer. Only large vehicles in the picture that no others hide are seen."""
    rng = np.random.default_rng([seed, 3, number])
    meshes = {
        k: [sample_car(rng, split="eval") if k == "car" else sample_heavy(rng, k) for _ in range(n)] for k, n in MODELS.items()
    }
    bases = {id(m): wheelbase(m) if k == "car" else 0.55 * float(m.dims[0]) for k, many in meshes.items() for m in many}
    while True:
        camera = sample_camera(rng, (1280, 720))
        site = sample_street(rng, camera, False)
        if lanes != 4:
            site = make_street(rng, site.origin, site.turn_rad, False, lanes, site.driveway_e)
        junction = Junction(rng, site, seconds, meshes, rng.uniform(3.5, 6.0), bases)
        vehicles = junction.run()
        if _in_view(camera, vehicles, seconds):
            break
    lines = {id(line): i for i, line in enumerate(junction.lines)}
    movements = []
    for line in junction.lines:
        ahead = np.array([np.cos(line.heading_rad), np.sin(line.heading_rad)])
        left = np.array([-ahead[1], ahead[0]])
        offsets = junction._lanes(line)
        paths = [line.origin + left * offset + np.outer(np.arange(-115.0, 131.0, 1.0), ahead) for offset in offsets]
        movements.append(Movement(paths, [line.origin + left * offset + ahead * (line.stop_s - GAP_M) for offset in offsets]))
    seen: dict[int, list[list[float]]] = {}
    for time_s in np.arange(0, seconds, 1 / RATE_HZ):
        there = [(i, m) for i, v in enumerate(vehicles) if (m := v.at(time_s)) is not None]
        boxes, depths = _boxes(camera, [(vehicles[i].mesh.dims, m.world_from_car) for i, m in there])
        for k in _visible(boxes, depths, camera.image_size_px):
            i, m = there[k]
            pose = m.world_from_car
            seen.setdefault(i, []).append([time_s, *pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0]), m.speed_mps, 0, 0])
    tracks = []
    for i, rows in seen.items():
        vehicle, array = vehicles[i], np.array(rows)
        parks = vehicle.leaves_s is not None or vehicle.bay_s is not None or vehicle.lane < -site.aisle_m + 1.6
        movement = None if parks else lines[id(vehicle.line)]
        for part in np.split(array, np.nonzero(np.diff(array[:, 0]) > BRIDGED_S)[0] + 1):
            if len(part) >= 3:
                tracks.append(Track(part, *map(float, vehicle.mesh.dims[:2]), movement, vehicle.kind))
    return Street(tracks, movements, seconds)


def _boxes(camera: Camera, placed: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the boxes (n, 4) and least depths (n,) of vehicles of given size and pose."""
    boxes, depths = [], []
    for dims, pose in placed:
        corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]) * dims
        pixels, depth = camera.pixel_from_world(corners @ pose[:3, :3].T + pose[:3, 3])
        boxes.append([*pixels.min(0), *pixels.max(0)])
        depths.append(depth.min())
    return np.array(boxes).reshape(-1, 4), np.array(depths)


def _visible(boxes: np.ndarray, depths: np.ndarray, size: tuple[int, int]) -> list[int]:
    """Returns the large vehicles of which enough is in the picture and not behind the boxes of others."""
    found, share = [], (np.arange(8) + 0.5) / 8
    large = (depths > 3) & ((boxes[:, 2:] - boxes[:, :2]).max(1) >= LEAST_PX)
    for k in np.nonzero(large)[0]:
        low, high = boxes[k, :2], boxes[k, 2:]
        points = np.stack(np.meshgrid(*(low + share[:, None] * (high - low)).T), -1).reshape(-1, 2)
        free = ((points >= 0) & (points < size)).all(1)
        for other in np.nonzero((depths < depths[k]) & (depths > 3))[0]:
            free &= ~((points > boxes[other, :2]) & (points < boxes[other, 2:])).all(1)
        if free.mean() >= LEAST_SHARE:
            found.append(int(k))
    return found


def turning(seed: int, seconds: float = 300.0) -> Street:
    """Returns a junction of three or four arms with turning vehicles. Each fourth seed is a curve with six lanes."""
    rng = np.random.default_rng([seed, 17])
    width, centre = rng.uniform(3.1, 3.6), np.array([rng.uniform(-8, 8), rng.uniform(35, 55)])
    movements: list[Movement] = []
    if seed % 4 == 3:
        radius, at = rng.uniform(120, 400), np.linspace(-80, 80, 161)
        turn = rng.uniform(0, 2 * np.pi)
        for sign in (1, -1):
            lanes = []
            for lane in range(3):
                r = radius + sign * (lane + 0.5) * width + sign * 1.0
                arc = np.stack([r * np.sin(at / radius), r * np.cos(at / radius) - radius], 1)[::sign]
                lanes.append(centre + arc @ _rotation(turn).T)
            movements.append(Movement(lanes))
        rates = [rng.integers(3, 40, 3) for _ in movements]
    else:
        arms = 3 if seed % 4 == 2 else 4
        angles = rng.uniform(0, 2 * np.pi) + np.arange(arms) * np.pi / 2 + rng.uniform(-0.25, 0.25, arms)
        pockets = rng.integers(1, 3, arms)  # lanes that lead into the junction
        mouth = 8.0 + 2.0 * width
        rates = []
        for a in range(arms):
            for b in range(arms):
                if a == b or rng.random() < 0.15:
                    continue
                turn = (angles[b] - angles[a] - np.pi + np.pi) % (2 * np.pi) - np.pi
                straight = abs(abs(turn) - np.pi) < 0.6
                right = not straight and 0 < turn < np.pi  # the next arm counter-clockwise is to the right
                into = 0 if not right else pockets[a] - 1
                used = range(pockets[a]) if straight and pockets[a] == pockets[b] else [into]
                lanes, stops = [], []
                for lane in used:
                    leave = min(lane, pockets[b] - 1)
                    path = _path(centre, angles[a], angles[b], (lane + 0.5) * width, (leave + 0.5) * width, mouth)
                    lanes.append(path)
                    stops.append(path[int(np.argmin(np.linalg.norm(path - centre, axis=1) > mouth + 2))])
                movements.append(Movement(lanes, stops))
                rates.append(np.array([rng.choice([0, 3, 4, 8, 20]) for _ in lanes]))
    reach, far = rng.uniform(38, 60), rng.uniform(0, 2 * np.pi)
    tracks = []
    for number, (movement, counts) in enumerate(zip(movements, rates, strict=True)):
        for lane, count in enumerate(counts):
            for _ in range(count):
                tracks += _drive(rng, movement, number, lane, centre, reach, far, seconds)
    return Street(tracks, movements, seconds)


def _rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _path(centre: np.ndarray, a: float, b: float, left_in: float, left_out: float, mouth: float) -> np.ndarray:
    """Returns the path from arm a to arm b: straight, a Bézier curve of degree 3, straight. Traffic keeps right."""
    out_a, out_b = np.array([np.cos(a), np.sin(a)]), np.array([np.cos(b), np.sin(b)])
    side_a, side_b = np.array([-out_a[1], out_a[0]]), np.array([out_b[1], -out_b[0]])
    start, end = centre + out_a * mouth + side_a * left_in, centre + out_b * mouth + side_b * left_out
    pull = 0.45 * np.linalg.norm(end - start)
    u = np.linspace(0, 1, 40)[1:-1, None]
    p1, p2 = start - out_a * pull, end - out_b * pull
    curve = (1 - u) ** 3 * start + 3 * u * (1 - u) ** 2 * p1 + 3 * u**2 * (1 - u) * p2 + u**3 * end
    tail = np.arange(0, 80.0, 1.0)[:, None]
    return np.concatenate([start + out_a * tail[::-1], curve, end + out_b * tail])


def _drive(
    rng: np.random.Generator,
    movement: Movement,
    number: int,
    lane: int,
    centre: np.ndarray,
    reach: float,
    far: float,
    seconds: float,
) -> list[Track]:
    """Returns the tracks of a vehicle on a lane, or of a queue of two.

    They are seen within `reach` of the centre, and farther in the direction `far`.
    """
    path = movement.lanes[lane]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    speed, start_s, pause = rng.uniform(6, 12), rng.uniform(-10, seconds), round(rng.uniform(5, 20) * RATE_HZ)
    halts = bool(movement.stops) and rng.random() < 0.5
    behind, tracks = 0.0, []
    for _ in range(2 if halts and rng.random() < 0.4 else 1):
        length = rng.uniform(3.8, 5.0)
        s = np.arange(0, along[-1], speed / RATE_HZ)
        speeds = np.full(len(s), speed)
        if halts:
            stop = along[np.argmin(np.linalg.norm(path - movement.stops[lane], axis=1))] - length / 2 - abs(rng.normal(0, 0.6))
            k = int(np.searchsorted(s, stop - behind))
            s = np.concatenate([s[:k], np.full(pause, stop - behind), stop - behind + s[: len(s) - k]])
            speeds = np.concatenate([speeds[:k], np.zeros(pause), speeds[k:]])
        times = start_s + 0.2 * behind + np.arange(len(s)) / RATE_HZ
        keep = s < along[-1]
        s, speeds, times = s[keep], speeds[keep], times[keep]
        xy = np.stack([np.interp(s, along, path[:, i]) for i in (0, 1)], 1)
        heading = np.interp(s, along[:-1], np.unwrap(np.arctan2(*np.diff(path, axis=0).T[::-1])))
        away = xy - centre
        towards = np.cos(np.arctan2(away[:, 1], away[:, 0]) - far)
        limits = reach + np.array([rng.normal(0, 2), rng.uniform(-20, 10)])
        before = np.arange(len(s)) < len(s) / 2  # a vehicle is found and lost at different distances
        limit = np.where(towards > 0.8, limits[1], np.where(before, limits[0], reach + rng.normal(0, 2)))
        keep = (np.linalg.norm(away, axis=1) < limit) & (times >= 0) & (times < seconds)
        if keep.sum() >= 5:
            rows = np.column_stack([times, xy, heading, speeds, np.zeros((len(s), 2))])[keep]
            tracks.append(Track(rows, length, 1.8, number))
        behind = 7.0
    return tracks
