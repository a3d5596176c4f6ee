"""Files of gates and zones in pixels, for `roadplane traffic --gates`."""

from __future__ import annotations

import json
from pathlib import Path

Points = list[list[float]]


def write_gates(path: Path, size_px: list[int], lines: dict[str, Points], zones: dict[str, Points]) -> None:
    """Writes lines and outlines of zones by their names. An outline does not repeat its first point."""
    shapes = [(name, "LineString", points) for name, points in lines.items()]
    shapes += [(name, "Polygon", [[*points, points[0]]]) for name, points in zones.items()]
    features = [
        {"type": "Feature", "properties": {"name": name}, "geometry": {"type": kind, "coordinates": coordinates}}
        for name, kind, coordinates in shapes
    ]
    content = {"type": "FeatureCollection", "coordinates": "pixels", "image_size_px": size_px, "frame": 0}
    path.write_text(json.dumps(content | {"features": features}))
