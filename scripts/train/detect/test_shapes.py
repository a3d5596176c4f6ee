"""Tests of the drawn pictures without vehicles."""

from __future__ import annotations

import numpy as np

from roadplane_train.detect.shapes import SIZE_PX, picture


def test_a_picture_depends_on_its_seed_and_number_alone() -> None:
    photograph = np.full((256, 512, 3), 90, np.uint8)
    first, again, other = (picture(3, number, [photograph]) for number in (0, 0, 1))
    assert first.shape == (*SIZE_PX[::-1], 3) and (first == again).all() and (first != other).any()


def test_shapes_have_edges() -> None:
    for number in range(5):
        image = picture(4, number, []).astype(float)
        steps = np.abs(np.diff(image, axis=1)).max()
        assert steps > 10, "a gradient alone has no edges"
