"""Tests of the stills for the detector; they need EGL."""

from __future__ import annotations

import numpy as np
import pytest

from .dataset import SLIVER_SHARE, still_truth
from .frames import draw
from .places import make_lot, make_street
from .renderer import Renderer
from .roadside import PAINT_M, add_roadside
from .scene import _clear
from .sky import WEATHERS, glare, lamp_pools, rain, sample_sky
from .stills import CarPool
from .views import MIX, VehiclePool, sample_view, sample_wide_camera


def test_cameras_aim_at_the_ground_from_all_heights() -> None:
    rng = np.random.default_rng(1)
    cameras = [sample_wide_camera(rng)[0] for _ in range(300)]
    tilts, heights = (np.array([getattr(c, name) for c in cameras]) for name in ("tilt_rad", "height_m"))
    assert tilts.min() < np.radians(5) and tilts.max() > np.radians(50)
    assert heights.min() < 4 and heights.max() > 30


def test_every_weather_has_light() -> None:
    for number, weather in enumerate(WEATHERS):
        light = sample_sky(np.random.default_rng(number), weather)
        assert (light.level > 0).all() and light.to_sun[2] > 0
    assert sum(WEATHERS.values()) == pytest.approx(1)
    assert sum(MIX.values()) < 1


def test_effects_keep_black_dark_and_lamps_bright() -> None:
    image = np.zeros((64, 96, 3), np.uint8)
    image[30:34, 40:44] = 255
    for effect in (lamp_pools, rain, lambda rng, x: glare(rng, x, (1.0, 2.0))):
        done = effect(np.random.default_rng(1), image)
        assert done.shape == image.shape and done.dtype == np.uint8
        assert done[31, 41].min() > 150 and done[0, 0].max() < 40
    assert glare(np.random.default_rng(1), image, (1.0, 2.0))[35, 41].min() > 0


def test_things_on_the_road_are_paint_and_all_others_are_beside_it() -> None:
    painted = upright = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        site = make_street(rng, np.array([5.0, 30.0]), 0.7, False, 4) if seed % 2 else make_lot(rng, np.zeros(2), 0.7, False)
        before = len(site.props)
        add_roadside(rng, site)
        for prop in site.props[before:]:
            n = abs((prop.world_from_prop[:2, 3] - site.origin) @ site.across)
            if prop.world_from_prop[2, 2] == PAINT_M:
                painted += 1
            elif site.layout == "street":
                upright += 1
                assert n > site.aisle_m, "it lies on the road"
    assert painted > 50 and upright > 50


@pytest.mark.egl
def test_views_depend_on_their_seed_alone_and_vehicles_do_not_touch() -> None:
    renderer = Renderer(shadow_size=512)
    records = []
    for first in (0, 2):
        pool = VehiclePool(CarPool(renderer, "eval", 9, []))
        for number in range(first, 3):  # the second time without the stills before it
            still = sample_view(np.random.default_rng([9, number]), pool)
        records.append(still_truth(renderer, still, SLIVER_SHARE))
    assert records[0] == records[1]
    for k, car in enumerate(still.scene.cars):
        others = still.scene.cars[:k]
        pose = car.world_from_car
        assert _clear(pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0]), car.gpu.mesh.dims, others, 0.0)


@pytest.mark.egl
def test_parked_motorcycles_have_no_riders() -> None:
    pool = VehiclePool(CarPool(Renderer(shadow_size=64), "train", 9, []))
    if not pool.meshes["motorcycle"]:
        pytest.skip("Debian's sweethome3d-furniture is missing")
    rng = np.random.default_rng(3)
    heights = {moving: [pool.of(rng, {"motorcycle": 1.0}, moving).mesh.dims[2] for _ in range(12)] for moving in (True, False)}
    assert min(heights[True]) > 1.4 > max(heights[False])


@pytest.mark.egl
def test_dense_fog_hides_cars_with_their_panes() -> None:
    renderer = Renderer(shadow_size=512)
    still = sample_view(np.random.default_rng([9, 2]), VehiclePool(CarPool(renderer, "eval", 9, [])))
    still.scene.light.haze = 10.0
    camera, (width, height) = still.camera, still.camera.image_size_px
    horizon = int(height / 2 - camera.focal_px * np.tan(camera.tilt_rad) + width * abs(np.tan(camera.roll_rad))) + 2
    ground = (0, max(horizon, 0), width, height - max(horizon, 0))
    with_cars = draw(renderer, still.scene, camera, ground).astype(int)
    still.scene.cars.clear()
    without = draw(renderer, still.scene, camera, ground).astype(int)
    assert abs(with_cars - without).max() <= 2
