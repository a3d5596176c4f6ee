"""Lorries and buses, without keypoints; their origin is at half their length."""

from __future__ import annotations

import numpy as np

from .bus import Bus
from .cab import cab
from .chassis import chassis, tail
from .load import box_body, bucket, curtains
from .lorry import KINDS, Lorry
from .mesh import KEYPOINT_NAMES, CarMesh
from .surface import Shell, join

CITY_SHARE = 0.6  # share of city buses among buses; the others are coaches
CURTAIN_SHARE = 0.6  # share of curtain-siders among articulated lorries; the others have boxes


def sample_heavy(rng: np.random.Generator, kind: str) -> CarMesh:
    """Returns a random truck or bus (`kind`)."""
    if kind == "truck":
        kinds = list(KINDS)
        name = str(rng.choice(kinds, p=[KINDS[k].share for k in kinds]))
        vehicle: Lorry | Bus = Lorry(rng, name)
        whole = join(_lorry(vehicle))
    else:
        name = "city" if rng.random() < CITY_SHARE else "coach"
        vehicle = Bus(rng, name)
        whole = join(vehicle.shells())
    return CarMesh(
        f"{name}-{vehicle.length:.1f}", kind, whole.points.astype(np.float32), whole.normals.astype(np.float32),
        whole.faces.astype(np.int32), whole.materials.astype(np.uint8), np.full((len(KEYPOINT_NAMES), 3), np.nan),
        np.array([vehicle.length, vehicle.width, vehicle.height]),
    )  # fmt: skip


def _lorry(lorry: Lorry) -> list[Shell]:
    load = {"tipper": bucket, "curtain": curtains}.get(lorry.kind, box_body)
    if lorry.kind == "articulated" and lorry.rng.random() < CURTAIN_SHARE:
        load = curtains
    return [*cab(lorry), *load(lorry), *chassis(lorry), *tail(lorry)]
