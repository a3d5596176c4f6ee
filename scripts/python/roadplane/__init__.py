"""Finished runs of `roadplane` in Python: tracks, poses, events and cameras.

>>> import roadplane
>>> run = roadplane.load("results/lot")
>>> run.tracks().groupby("track")["speed_mps"].max()
>>> run.poses()[["frame", "track", "x_m", "y_m", "reprojection_rms_px"]]
>>> run.camera.ground_from_pixel([[640, 500]])

The world frame is in metres: z up, origin on the ground under the camera, y the horizontal viewing direction, x to the
right. Pixel (0, 0) is the centre of the top-left pixel.
"""

from roadplane.camera import Camera, SecondPlane, View
from roadplane.run import Run, load

__all__ = ["Camera", "Run", "SecondPlane", "View", "load"]
