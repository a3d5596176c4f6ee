"""Plays a copied scene in MetaDrive's replay of recorded traffic, and compares it with the run.

It compares every vehicle's position and heading every 0.1 s, without pictures.
"""

from __future__ import annotations

import pickle
import tempfile
from pathlib import Path

import numpy as np
from metadrive.engine.base_engine import BaseEngine
from metadrive.envs.scenario_env import ScenarioEnv
from metadrive.policy.replay_policy import ReplayEgoCarPolicy
from metadrive.scenario.scenario_description import ScenarioDescription
from metadrive.type import MetaDriveType
from scene import STEP_S, Deviations, Vehicle, compare

SCENARIO = "sd_roadplane_copy.pkl"
# MetaDrive fetches textures and meshes at its first start; without pictures they are not needed.
BaseEngine.try_pull_asset = staticmethod(lambda: None)


def recorded(vehicle: Vehicle, steps: int) -> dict:
    """Returns a track in MetaDrive's form: positions of the body's centre."""
    times = np.arange(steps) * STEP_S
    poses = np.array([vehicle.at(t) for t in times])
    middle = poses[:, :2] + vehicle.centre_m * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    valid = (times >= vehicle.span_s[0]) & (times <= vehicle.span_s[1])
    length, width, height = vehicle.dims_m
    state = {
        "position": np.column_stack([middle, np.full(steps, height / 2)]),
        "heading": poses[:, 2],
        "velocity": np.gradient(middle, STEP_S, axis=0),
        "valid": valid,
        "length": np.full(steps, length),
        "width": np.full(steps, width),
        "height": np.full(steps, height),
    }
    meta = {"track_length": steps, "type": MetaDriveType.VEHICLE, "object_id": vehicle.name, "dataset": "roadplane"}
    return {"type": MetaDriveType.VEHICLE, "state": state, "metadata": meta}


def write_scenario(folder: Path, vehicles: list[Vehicle], steps: int) -> None:
    """Writes one scenario and MetaDrive's two lists beside it.

    The first vehicle that is present at the start is the ego.
    """
    ego = max(vehicles, key=lambda v: (v.span_s[0] <= 0, v.span_s[1]))
    x, y = np.concatenate([v.poses[:, :2] for v in vehicles]).T
    left, right, middle = x.min() - 25, x.max() + 25, (y.min() + y.max()) / 2
    lane = {
        "type": MetaDriveType.LANE_SURFACE_STREET,
        "polyline": np.column_stack([np.linspace(left, right, 50)] * 2),
        "polygon": np.array([[left, y.min() - 25], [right, y.min() - 25], [right, y.max() + 25], [left, y.max() + 25]]),
        "entry_lanes": [],
        "exit_lanes": [],
        "left_neighbor": [],
        "right_neighbor": [],
    }
    lane["polyline"][:, 1] = middle
    tracks = {v.name: recorded(v, steps) for v in vehicles}
    meta = {
        "id": "copy",
        "coordinate": MetaDriveType.COORDINATE_METADRIVE,
        "ts": np.arange(steps) * STEP_S,
        "metadrive_processed": False,
        "sdc_id": ego.name,
        "dataset": "roadplane",
        "scenario_id": "copy",
        "sample_rate": STEP_S,
        "tracks_to_predict": {},
        "number_summary": {},
    }
    scenario = ScenarioDescription(
        {
            "id": "copy",
            "version": "roadplane",
            "length": steps,
            "tracks": tracks,
            "dynamic_map_states": {},
            "map_features": {"ground": lane},
            "metadata": meta,
        }
    )
    scenario["metadata"]["number_summary"] = ScenarioDescription.get_number_summary(scenario)
    for name, content in (
        (SCENARIO, scenario.to_dict()),
        ("dataset_summary.pkl", {SCENARIO: scenario["metadata"]}),
        ("dataset_mapping.pkl", {SCENARIO: ""}),
    ):
        (folder / name).write_bytes(pickle.dumps(content))


def replay(folder: Path, vehicles: list[Vehicle], rows: dict[int, np.ndarray], steps: int) -> Deviations:
    """Replays the scenario step by step."""
    env = ScenarioEnv(
        {
            "use_render": False,
            "image_observation": False,
            "agent_policy": ReplayEgoCarPolicy,
            "data_directory": str(folder),
            "num_scenarios": 1,
            "horizon": steps + 1,
            "log_level": 50,
            "no_light": True,
            "reactive_traffic": False,
            "skip_missing_light": True,
            "store_map": False,
            "need_lane_localization": False,
            "no_static_vehicles": False,
            "set_static": True,
            "filter_overlapping_car": False,
        }
    )
    deviations = Deviations.none()
    try:
        env.reset(seed=0)
        # MetaDrive moves the ego's first position to its origin.
        origin = env.engine.data_manager.current_scenario["metadata"]["old_origin_in_current_coordinate"]
        for step in range(steps):
            ids = env.engine.traffic_manager.obj_id_to_scenario_id
            objects = {ids[o.name]: o for o in env.engine.get_objects().values() if o.name in ids}
            for vehicle in vehicles:
                time_s = step * STEP_S
                if not vehicle.span_s[0] <= time_s <= vehicle.span_s[1]:
                    continue
                played = objects[vehicle.name]
                deviations.add(
                    rows[vehicle.track],
                    vehicle,
                    time_s,
                    np.array(played.position) - origin[:2],
                    played.heading_theta,
                    vehicle.centre_m,
                )
            env.step([0, 0])
    finally:
        env.close()
    return deviations


def play(_scene: Path, vehicles: list[Vehicle], rows: dict[int, np.ndarray], end: float) -> Deviations:
    """Writes the scene in MetaDrive's form and replays it."""
    steps = int(end / STEP_S) + 1
    with tempfile.TemporaryDirectory() as folder:
        write_scenario(Path(folder), vehicles, steps)
        return replay(Path(folder), vehicles, rows, steps)


if __name__ == "__main__":
    compare("MetaDrive", play)
