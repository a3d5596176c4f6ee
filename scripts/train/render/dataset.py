"""Renders a data set of whole frames with truth.

  roadplane-train render dataset --out DIR --preset eval

It has stills and clips of parking lots and streets. Each item depends on the seed, its number, the split and the code
alone. Finished items are kept, so a killed run resumes. File formats: `truth.py`.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from roadplane_train.json_files import write_json

from .card import write_card
from .clips import Clip, sample_clip
from .crops import VisiblePart, real_meshes, visible_part
from .frames import Canvas, ExactCanvas, VideoWriter, draw, ffmpeg, finished, overlap
from .long_clips import sample_long_clip
from .paths import Motion
from .renderer import Renderer
from .stills import SIZE, WEATHERS, CarPool, Still, sample_still
from .truth import SMALLEST_SHARE, car_record, dataset_record, item_record
from .views import VehiclePool, sample_view

LARGE_PX, FEWEST_LARGE = 40, 5  # longer side and number of the large cars that a still must show
SLIVER_SHARE = 0.02  # least visible share of a vehicle in the truth of views; the training ignores small shares
LARGEST_STILL_BYTES = 250_000
TRUTH = ".truth.json.gz"
CROWD_OF_CLIP = ["quiet"] * 3 + ["busy"] * 5 + ["full"] * 4  # repeated in turn


@dataclass(frozen=True)
class Preset:
    """The amounts of a preset."""

    split: str
    stills: int
    clips: int
    seed: int
    seconds: float = 12.0
    fps: float = 10.0
    size: tuple[int, int] = SIZE  # of long clips; all others have SIZE
    cars: int = 20  # cars in view at a time, in long clips
    drivers: int | None = None  # drivers among them; None: no long clips, but short ones with a few movers
    mbit: float | None = None  # upper bound of a clip's bit rate, Mbit/s; None: constant quality
    one_camera: bool = False  # all clips from one camera, with other weather and other cars
    views: bool = False  # stills for the detector, with all kinds of vehicles


PRESETS = {
    "small": Preset("eval", 4, 1, 4, 3.0),
    "eval": Preset("eval", 50, 12, 4),  # contents of tests/data/lots
    "train": Preset("train", 2000, 60, 5),
    "views": Preset("train", 6000, 0, 31, views=True),  # for the detector
    "long": Preset("eval", 0, 1, 4, 60.0, 30.0, (1920, 1080), 20, 5, 4.0),
}


def suitable_still(renderer: Renderer, pool: CarPool, seed: list[int]) -> tuple[np.random.Generator, Still, list[dict]]:
    """Draws a still with enough large cars; also returns the cars, and the generator for the camera's noise."""
    for attempt in range(100):
        rng = np.random.default_rng([*seed, attempt])
        still = sample_still(rng, pool)
        cars = still_truth(renderer, still)
        large = [car for car in cars if max(car["box"][2] - car["box"][0], car["box"][3] - car["box"][1]) >= LARGE_PX]
        if len(large) >= FEWEST_LARGE:
            return rng, still, cars
    raise RuntimeError(f"seed {seed}: no scene with {FEWEST_LARGE} cars in 100 attempts")


def render_still(renderer: Renderer, pool: CarPool | VehiclePool, seed: list[int], folder: Path, stem: str) -> None:
    """Renders one picture and its truth."""
    if isinstance(pool, VehiclePool):
        rng = np.random.default_rng([*seed, 0])
        still = sample_view(rng, pool)
        cars = still_truth(renderer, still, SLIVER_SHARE)
    else:
        rng, still, cars = suitable_still(renderer, pool, seed)
    size = still.camera.image_size_px
    drawn = draw(renderer, still.scene, still.camera, (0, 0, *size))
    for effect in still.effects:
        drawn = effect(drawn)
    image = finished(rng, drawn, size, still.finish)
    media = folder / f"{stem}.jpg"
    part = media.with_suffix(".part.jpg")
    part.write_bytes(_jpeg(image))
    part.rename(media)
    meshes = {i: car.gpu.mesh for i, car in enumerate(still.scene.cars)}
    write_json(folder / f"{stem}{TRUTH}", item_record(media.name, None, still.conditions, still.camera, meshes, [cars]))


def still_truth(renderer: Renderer, still: Still, least_share: float = SMALLEST_SHARE) -> list[dict]:
    """Returns the cars of a still of which at least a share is visible; their motion is unknown."""
    records = []
    for index, car in enumerate(still.scene.cars):
        seen = visible_part(renderer, still.scene, still.camera, index, least_inside=0.0)
        if seen is not None and seen.seen_share >= least_share:
            records.append(car_record(index, Motion(car.world_from_car), seen))
    return records


def _jpeg(image: np.ndarray) -> bytes:
    """Encodes at the best quality up to 90 that keeps the file small."""
    for quality in range(90, 50, -5):
        _, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        if data.size <= LARGEST_STILL_BYTES:
            break
    return data.tobytes()


def clip_of(rng: np.random.Generator, pool: CarPool, number: int, plan: Preset) -> Clip:
    """Returns the clip of a number; its kind and weather alternate."""
    weather = list(WEATHERS)[number % len(WEATHERS)]
    if plan.drivers is not None:
        return sample_long_clip(rng, pool, weather, plan.size, plan.seconds, plan.fps, plan.cars, plan.drivers)
    if plan.one_camera:
        return sample_clip(rng, pool, "lot", weather, "busy", plan.seconds, plan.fps, [plan.seed])
    crowd = CROWD_OF_CLIP[number % len(CROWD_OF_CLIP)]
    layout = "lot" if crowd == "full" else ("lot", "street", "lot")[number % 3]
    return sample_clip(rng, pool, layout, weather, crowd, plan.seconds, plan.fps)


def render_long_clip(renderer: Renderer, pool: CarPool, seed: list[int], folder: Path, stem: str, plan: Preset) -> None:
    """Renders one video with steady traffic, and its truth.

    Each frame is the one before with its changed parts redrawn, within a grey level of a full redraw.
    """
    rng = np.random.default_rng(seed)
    clip = clip_of(rng, pool, seed[-1], plan)
    canvas = ExactCanvas(renderer, clip.camera)
    video = VideoWriter(folder / f"{stem}.mp4", plan.size, clip.fps, 24, plan.mbit)
    known: dict[int, VisiblePart | None] = {}
    records: dict[int, dict] = {}  # frames share those of cars at rest
    frames, start = [], time.monotonic()
    for number in range(clip.frames):
        before_s, time_s = max(number - 1, 0) / clip.fps, number / clip.fps
        scene, motions, before = clip.at(time_s), clip.motions(time_s), clip.motions(before_s)
        changed, hiding = clip.changed(before_s, time_s) if number else ([(0, 0, *plan.size)], [])
        canvas.update(scene, changed)
        video.write(finished(rng, canvas.drawn, plan.size, clip.finish))
        for index, motion in enumerate(motions):
            seen = known.get(index)
            moved = not np.array_equal(before[index].world_from_car, motion.world_from_car)
            if moved or index not in known or (seen and any(overlap(region, seen.extent) for region in hiding)):
                seen = known[index] = visible_part(renderer, scene, clip.camera, index, least_inside=0.0)
            elif motion.speed_mps == before[index].speed_mps and motion.activity == before[index].activity:
                continue
            records.pop(index, None)
            if seen is not None and seen.seen_share >= SMALLEST_SHARE:
                records[index] = car_record(index, motion, seen)
        frames.append([records[index] for index in sorted(records)])
        if number % 100 == 99:
            left = (time.monotonic() - start) / (number + 1) * (clip.frames - number - 1)
            print(f"{stem}: frame {number + 1} of {clip.frames}, {left / 60:.1f} min left", flush=True)
    video.finish()
    write_clip_truth(folder, stem, clip, frames)


def write_clip_truth(folder: Path, stem: str, clip: Clip, frames: list[list[dict]]) -> None:
    """Writes the truth file of a finished video."""
    meshes = {i: car.gpu.mesh for i, car in enumerate(clip.scene.cars)}
    record = item_record(f"{stem}.mp4", clip.fps, clip.conditions, clip.camera, meshes, frames)
    write_json(folder / f"{stem}{TRUTH}", record)


def render_clip(renderer: Renderer, pool: CarPool, seed: list[int], folder: Path, stem: str, plan: Preset) -> None:
    """Renders one video and its truth.

    Stationary things, and their truth, are computed again only where something passes.
    """
    rng = np.random.default_rng(seed)
    clip = clip_of(rng, pool, seed[-1], plan)
    canvas = Canvas(renderer, clip.camera)
    video = VideoWriter(folder / f"{stem}.mp4", SIZE, clip.fps, 24, plan.mbit)
    known: dict[int, VisiblePart | None] = {}
    frames = []
    for number in range(clip.frames):
        time_s = number / clip.fps
        scene, motions = clip.at(time_s), clip.motions(time_s)
        redrawn = canvas.update(scene, clip.moving_regions(time_s))
        video.write(finished(rng, canvas.drawn, SIZE, clip.finish))
        cars = []
        for index, motion in enumerate(motions):
            seen = known.get(index)
            unchanged = clip.movers[index].drive is None and index in known
            if not unchanged or (seen is not None and any(overlap(region, seen.extent) for region in redrawn)):
                seen = known[index] = visible_part(renderer, scene, clip.camera, index, least_inside=0.0)
            if seen is not None and seen.seen_share >= SMALLEST_SHARE:
                cars.append(car_record(index, motion, seen))
        frames.append(cars)
    video.finish()
    write_clip_truth(folder, stem, clip, frames)


def make(out: Path, plan: Preset, name: str, recipe: str, jobs: int = 1) -> None:
    """Makes the missing items in a number of processes, then `dataset.json` and the card."""
    folder = out / "scenes"
    folder.mkdir(parents=True, exist_ok=True)
    for leftover in folder.glob("*.part*"):
        leftover.unlink()
    stems = [("still", k) for k in range(plan.stills)] + [("clip", k) for k in range(plan.clips)]
    paths = {item: folder / f"{item[0]}_{item[1]:04d}{TRUTH}" for item in stems}
    missing = [item for item in stems if not paths[item].exists()]
    if any(kind == "clip" for kind, _ in missing):
        ffmpeg()  # checked first, as stills take minutes
    if jobs == 1:
        make_items(folder, plan, missing)
    else:
        with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:  # an OpenGL context does not survive a fork
            list(pool.map(make_items, [folder] * jobs, [plan] * jobs, [missing[k::jobs] for k in range(jobs)]))
    items = [f"scenes/{path.name}" for path in paths.values()]
    write_json(out / "dataset.json", dataset_record(name, plan.split, plan.seed, items), indent=1)
    write_card(out, recipe)


def make_items(folder: Path, plan: Preset, missing: list[tuple[str, int]]) -> None:
    """Renders items one after the other."""
    renderer = Renderer(shadow_size=4096) if missing else None
    pool = CarPool(renderer, plan.split, plan.seed, real_meshes(plan.split)) if renderer else None
    pool = VehiclePool(pool) if pool and plan.views else pool
    start = time.monotonic()
    work = sum(_cost(item, plan) for item in missing)
    done = 0.0
    for count, (kind, number) in enumerate(missing, 1):
        stem = f"{kind}_{number:04d}"
        seed = [plan.seed, ("still", "clip").index(kind), number]
        if kind == "still":
            render_still(renderer, pool, seed, folder, stem)
        else:
            render = render_clip if plan.drivers is None else render_long_clip
            render(renderer, pool, seed, folder, stem, plan)
        done += _cost((kind, number), plan)
        left = (time.monotonic() - start) / done * (work - done)
        print(f"{stem}: {count} of {len(missing)}, {left / 60:.1f} min left", flush=True)


def _cost(item: tuple[str, int], plan: Preset) -> float:
    """Returns a rough share of the work, to estimate the time left."""
    return 1.0 if item[0] == "still" else 0.2 * plan.fps * plan.seconds


def _size(text: str) -> tuple[int, int]:
    width, height = text.split("x")
    return int(width), int(height)


def _word(key: str, value: object) -> str:
    """Returns an option as it was typed."""
    if value is True:
        return f"--{key.replace('_', '-')}"
    return f"--{key} {value[0]}x{value[1]}" if isinstance(value, tuple) else f"--{key} {value}"


def main() -> None:
    """Renders the data set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--preset", choices=PRESETS, default="small", help="default values of the options below")
    parser.add_argument("--split", choices=("train", "eval"), help="split of the cars; splits share no model")
    parser.add_argument("--stills", type=int)
    parser.add_argument("--clips", type=int)
    parser.add_argument("--seconds", type=float, help="of a clip")
    parser.add_argument("--fps", type=float, help="of a clip")
    parser.add_argument("--size", type=_size, metavar="WIDTHxHEIGHT", help="of long clips")
    parser.add_argument("--drivers", type=int, help="number of cars that drive at a time; makes long clips")
    parser.add_argument("--cars", type=int, help="number of cars in view at a time, in long clips")
    parser.add_argument("--mbit", type=float, help="upper bound of a clip's bit rate, Mbit/s (default: constant quality)")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--one-camera", action="store_true", default=None, help="makes clips of one camera on different days")
    parser.add_argument("--name", default="lots")
    parser.add_argument("--jobs", type=int, default=1, help="processes that render at the same time")
    options = parser.parse_args()
    names = ("split", "stills", "clips", "seconds", "fps", "size", "drivers", "cars", "mbit", "seed", "one_camera")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    plan = Preset(**{**PRESETS[options.preset].__dict__, **given})
    if plan.views and (plan.clips or plan.drivers is not None):
        parser.error("--preset views makes stills only")
    if plan.drivers is None and plan.size != SIZE:
        parser.error("--size needs --drivers")
    if plan.one_camera and plan.drivers is not None:
        parser.error("--one-camera and --drivers exclude each other")
    words = [f"--preset {options.preset}"]
    words += [_word(key, value) for key, value in given.items()]
    make(options.out, plan, options.name, f"roadplane-train render dataset --out DIR {' '.join(words)}", options.jobs)


if __name__ == "__main__":
    main()
