"""A car as triangles with a material per face, and its 36 keypoints."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[3]
KEYPOINTS = json.loads((REPOSITORY / "models" / "keypoints.json").read_text())
KEYPOINT_NAMES: list[str] = KEYPOINTS["names"]
MIRROR: list[int] = KEYPOINTS["mirror"]

# Materials of faces; the renderer decides their appearance.
MATERIALS = (
    "paint",
    "glass",
    "tyre",
    "rim",
    "headlamp",
    "taillamp",
    "chrome",
    "plastic",
    "plate",
    "underbody",
    "interior",
    "gap",
    "livery",  # a second paint, of lorries and buses
    "indicator",
)

BODY_TYPES = ("sedan", "hatchback", "wagon", "suv", "minivan", "van", "pickup", "coupe")


@dataclass
class CarMesh:
    """A car in its own frame, m: x forward, y left, z up, origin on the ground midway between the axles."""

    name: str
    body: str  # one of BODY_TYPES, or truck or bus
    vertices: np.ndarray  # (V, 3) float32
    normals: np.ndarray  # (V, 3) float32, unit, outward; vertices are split where the surface has a crease
    faces: np.ndarray  # (F, 3) int32, counter-clockwise seen from outside
    materials: np.ndarray  # (F,) uint8, index into MATERIALS
    keypoints: np.ndarray  # (36, 3) float64; NaN if the car has no such point
    dims: np.ndarray  # (3,) length, width without mirrors, height
    credit: str = ""  # author and licence of an imported mesh

    def material_faces(self, material: str) -> np.ndarray:
        """Faces of one material, (n, 3)."""
        return self.faces[self.materials == MATERIALS.index(material)]
