"""Finished runs of `roadplane` in Python: tracks, camera and events.

>>> import roadplane
>>> run = roadplane.load("results/lot")
>>> run.tracks().groupby("track")["speed_mps"].max()
>>> run.camera.ground_from_pixel([[640, 500]])

World: z up, origin on the ground under the camera, y the viewing direction laid on the ground, x to the right; metres.
Pixel (0, 0) is the centre of the top-left pixel.
"""

from roadplane.camera import Camera
from roadplane.run import Run, load

__all__ = ["Camera", "Run", "load"]
