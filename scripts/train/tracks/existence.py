"""Fits the probability that a track is a vehicle: logistic regression on the features of tracks with truth.

  roadplane-train tracks existence CANDIDATES.csv... --out models/tracks.json

`roadplane-lab eval tracker CLIPS --recorded RUNS --set track.min_exists_p=0 --candidates FILE` makes such a file.
"""

from __future__ import annotations

from .logistic import run


def main() -> None:
    """Fits and writes the weights."""
    run("existence", __doc__)
