"""Meshes of Debian's `sweethome3d-furniture` (CC-BY 3.0, CC0): cars with keypoints that we marked, and other vehicles.

The meshes stay in the package. `meshes.json` beside this file says how each becomes a `CarMesh`: scale, origin,
materials, keypoints. `roadplane-train cars meshes` lists them.
"""

from __future__ import annotations

import argparse
import json
import zipfile
from pathlib import Path

import numpy as np

from . import obj
from .mesh import KEYPOINT_NAMES, MATERIALS, CarMesh
from .shading import face_normals, smooth_normals, thin_out, weld

FURNITURE = Path("/usr/share/sweethome3d/furniture")
CATALOGUE = Path(__file__).with_name("meshes.json")
PACKAGE = "sweethome3d-furniture"
SPLITS = ("train", "eval")
KINDS = ("cars", "others")
MOST_FACES = 30_000
CREASE_DEG = 40.0


class MissingFurnitureError(FileNotFoundError):
    """The Debian package that holds the meshes is not installed in the expected folder."""


def catalogue(kind: str = "cars") -> list[dict]:
    """Returns the entries of meshes.json for `cars`, or `others`: lorries, buses, and motorcycles without riders."""
    return json.loads(CATALOGUE.read_text())[kind]


def load_meshes(split: str | None = None, furniture: Path = FURNITURE, kind: str = "cars") -> list[CarMesh]:
    """Returns all vehicles of a part of the catalogue, or those of one split; no net is trained on `eval` vehicles."""
    if split is not None and split not in SPLITS:
        raise ValueError(f"split is one of {SPLITS}, not {split!r}")
    return [load(entry, furniture) for entry in catalogue(kind) if split in (None, entry["split"])]


def load(entry: dict, furniture: Path = FURNITURE) -> CarMesh:
    """Returns one vehicle of the catalogue."""
    triangles = _read(furniture / entry["archive"], entry["entry"])
    # the files have y up, z forward, x to the car's left
    vertices = triangles.vertices[:, [2, 0, 1]] * entry["scale"] - entry["origin"]
    if entry.get("backwards"):
        vertices = vertices * [-1, -1, 1]
    if "steered" in entry:
        vertices = _straighten(vertices, triangles, entry["steered"])
    materials = _materials(vertices, triangles, entry)
    faces = _outward(vertices, triangles, entry.get("flip", []))
    kept = materials >= 0
    faces, materials = faces[kept], materials[kept]
    vertices, faces, kept = weld(vertices, faces)
    vertices, faces, materials = thin_out(vertices, faces, materials[kept], MOST_FACES)
    vertices, normals, faces = smooth_normals(vertices, faces, CREASE_DEG)
    return CarMesh(
        name=entry["name"], body=entry["body"], vertices=vertices.astype(np.float32), normals=normals.astype(np.float32),
        faces=faces.astype(np.int32), materials=materials.astype(np.uint8), keypoints=_keypoints(entry.get("keypoints", {})),
        dims=np.array(entry["dims"]), credit=entry["credit"],
    )  # fmt: skip


def _read(archive: Path, name: str) -> obj.Triangles:
    if not archive.is_file():
        raise MissingFurnitureError(f"no {archive.name}: install Debian's {PACKAGE}, or give --furniture ({archive.parent})")
    with zipfile.ZipFile(archive) as content:
        return obj.parse(content.read(name).decode("latin-1"))


def _keypoints(left: dict[str, list[float] | None]) -> np.ndarray:
    """Returns the keypoints of both sides from those of the left side, as cars are symmetric; others have none."""
    half = np.full((18, 3), np.nan)
    for i, name in enumerate(KEYPOINT_NAMES[:18]):
        point = left.get(name.removeprefix("left_"))
        if point is not None:
            half[i] = point
    return np.concatenate([half, half * (1, -1, 1)])


def _materials(vertices: np.ndarray, triangles: obj.Triangles, entry: dict) -> np.ndarray:
    """Maps the material names of the file to ours (−1: leave out).

    Where one name covers several parts, boxes around the face's centre distinguish them. A box is [x_min, x_max,
    |y|_min, |y|_max, z_min, z_max] in metres.
    """
    number = {name: i for i, name in enumerate(MATERIALS)} | {"": -1}
    names, which = np.unique(triangles.materials, return_inverse=True)
    materials = np.array([number[entry["materials"][name]] for name in names])[which]
    centre = vertices[triangles.faces].mean(1)
    centre[:, 1] = abs(centre[:, 1])
    for region in entry.get("regions", []):
        low, high = np.reshape(region["box"], (3, 2)).T
        inside = ((centre >= low) & (centre <= high)).all(1)
        materials[inside & (triangles.materials == region["material"])] = number[region["as"]]
    return materials


def _outward(vertices: np.ndarray, triangles: obj.Triangles, flip: list[str]) -> np.ndarray:
    """Returns the faces, with those of the named materials turned away from the car's centre line.

    Some files wind them wrongly.
    """
    faces = triangles.faces.copy()
    suspect = np.isin(triangles.materials, flip)
    centre = vertices[faces].mean(1)
    reach = 0.75 * abs(vertices[np.unique(faces), 0]).max()
    spine = np.stack([centre[:, 0].clip(-reach, reach), 0 * centre[:, 1], np.full(len(centre), 0.7)], axis=1)
    inward = (face_normals(vertices, faces) * (centre - spine)).sum(1) < 0
    faces[suspect & inward] = faces[suspect & inward][:, ::-1]
    return faces


def _straighten(vertices: np.ndarray, triangles: obj.Triangles, wheels: list[dict[str, str]]) -> np.ndarray:
    """Turns a pair of steered wheels straight ahead and sets them level with each other.

    The tread is a ring: the direction in which it spreads least is its axle. The wheel turns about the vertical axis.
    """
    vertices = vertices.copy()
    rings = [np.unique(triangles.faces[triangles.groups == wheel["tread"]]) for wheel in wheels]
    centres = np.array([vertices[ring].mean(0) for ring in rings])
    straight = np.array([1, 0, 1]) * centres.mean(0) + np.array([0, 1, 0]) * np.sign(centres) * abs(centres).mean(0)
    for wheel, ring, centre, target in zip(wheels, rings, centres, straight):
        axle = np.linalg.svd(vertices[ring] - centre, full_matrices=False)[2][2]
        angle = np.arctan2(axle[0], axle[1]) if axle[1] > 0 else np.arctan2(-axle[0], -axle[1])
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        whole = np.unique(triangles.faces[np.char.startswith(triangles.groups, wheel["groups"])])
        vertices[whole] = (vertices[whole] - centre) @ turn.T + target
    return vertices


def main() -> None:
    """Lists the vehicles: name, split, body, size, faces and keypoints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--furniture", type=Path, default=FURNITURE, help="folder of the package's .sh3f files")
    parser.add_argument("--split", choices=SPLITS)
    arguments = parser.parse_args()
    for mesh in (mesh for kind in KINDS for mesh in load_meshes(arguments.split, arguments.furniture, kind)):
        points = int(np.isfinite(mesh.keypoints).all(1).sum())
        size = " × ".join(f"{d:.2f}" for d in mesh.dims)
        print(f"{mesh.name:24s} {mesh.body:10s} {size} m  {len(mesh.faces):6d} faces  {points} keypoints")


if __name__ == "__main__":
    main()
