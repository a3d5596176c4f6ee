"""A car as the renderer draws it."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from roadplane_train.cars.mesh import CarMesh


@dataclass
class GpuCar:
    """A car mesh in GPU buffers; glass comes last so that it can be blended."""

    mesh: CarMesh
    colour: moderngl.VertexArray
    truth: moderngl.VertexArray
    shadow: moderngl.VertexArray
    solid_indices: int
    all_indices: int
    buffers: tuple[moderngl.Buffer, ...]
    bounds: tuple[np.ndarray, np.ndarray]
    wheels: tuple[float, float, float, float]  # see car.vert

    def release(self) -> None:
        """Frees the GPU memory."""
        for item in (self.colour, self.truth, self.shadow, *self.buffers):
            item.release()
