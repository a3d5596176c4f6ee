"""Draws the trajectories of a run from above, coloured by speed.

python plot_from_above.py RUN IMAGE.png
"""

import sys

import matplotlib.pyplot as plt

import roadplane


def main() -> None:
    """Reads a run and writes a picture."""
    run = roadplane.load(sys.argv[1])
    tracks = run.tracks()
    # Each segment of the camera has its own world coordinates. Draw the first segment only.
    tracks = tracks[tracks["segment"] == 0]
    figure, axes = plt.subplots(figsize=(8, 8))
    points = axes.scatter(tracks["x_m"], tracks["y_m"], c=3.6 * tracks["speed_mps"].abs(), s=4)
    axes.plot(0, 0, marker="^", color="black", linestyle="none", label="camera")
    axes.set(aspect="equal", xlabel="x, m", ylabel="y, m")
    axes.legend()
    figure.colorbar(points, label="speed, km/h")
    figure.savefig(sys.argv[2], dpi=150)


if __name__ == "__main__":
    main()
