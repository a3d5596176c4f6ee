"""Makes tests/data/geometry.json, with which the tests compare the geometry in Rust and in Python.

python3 scripts/python/geometry_fixture.py > tests/data/geometry.json
"""

import json

import numpy as np

from roadplane import Camera

# Ordinary; steep with a roll and outward distortion; nearly level with inward distortion; almost straight down.
PARAMS = [[7.2, 0.31, 0.02, 2.1], [6.6, 1.1, -0.2, 2.9], [8.3, 0.09, 0.005, 1.6], [7.0, 1.5, 0.0, 3.0]]
DISTORTIONS = [0.0, -0.15, 0.03, -0.02]
PIXELS = [[639.5, 359.5], [12.0, 700.0], [1250.0, 420.5], [640.0, 110.0]]


def main() -> None:
    """Prints the fixture."""
    random = np.random.default_rng(22)
    cases = []
    for params, bend in zip(PARAMS, DISTORTIONS, strict=True):
        spread = random.normal(size=(4, 4)) * [[0.03], [0.01], [0.004], [0.04]]
        camera = Camera((0.0, 9.0), (1280, 720), (639.5, 359.5), np.array(params), spread @ spread.T, "estimated", bend)
        pixels = [pixel for pixel in PIXELS if np.isfinite(camera.ground_from_pixel(pixel)).all()]
        above = np.column_stack([camera.ground_from_pixel(pixels), np.linspace(0, 1.5, len(pixels))])
        cases.append(
            {
                "params": params,
                "bend": bend,
                "covariance": camera.covariance.tolist(),
                "pixels": pixels,
                "ground_m": camera.ground_from_pixel(pixels).tolist(),
                "ground_sd_m": camera.ground_from_pixel_sd(pixels).tolist(),
                "points_m": above.tolist(),
                "points_px": camera.project(above).tolist(),
            }
        )
    print(json.dumps({"image_size_px": [1280, 720], "cases": cases}))


if __name__ == "__main__":
    main()
