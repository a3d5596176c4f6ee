"""A camera above the ground: projection, its inverse on the ground, and both with their uncertainties."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Steps of numerical derivatives: by the camera's parameters (rad or log), and by pixels.
_STEP = 1e-5
_STEP_PX = 1e-3
# Points closer than this are at or behind the camera, m. Rays that descend less do not meet the ground.
_NEAREST_M = 1e-3
_LEAST_DESCENT = 1e-9


@dataclass(frozen=True, eq=False)
class SecondPlane:
    """The second plane of the ground, beyond a line at which the slope changes.

    Attributes:
        params: [4] as in `Camera`, above this plane.
        covariance: [4, 4] of `params`.
        rises: whether the ground lies above the first plane there.
    """

    params: Array
    covariance: Array
    rises: bool


@dataclass(frozen=True, eq=False, repr=False)
class Camera:
    """A camera with square pixels above the ground, during one time interval.

    Attributes:
        span_s: first and last time of the interval, s.
        image_size_px: width and height, px.
        principal_point_px: x and y, px.
        params: [4] log focal length (px), tilt, roll (rad), log height (m). Tilt is the angle of the optical axis below
            the horizontal. Roll is positive if the horizon turns clockwise in the picture.
        covariance: [4, 4] of `params`; infinite on its diagonal for unknown parameters.
        status: how the parameters were determined, as in `camera.json`.
        `bend`: radial distortion. Without it, a pixel at `p` from the principal point would be at
            `p / (1 + bend |p|² / (width / 2)²)`.
        `bend_sd`: standard deviation of `bend`; None if it was not estimated, and the lens has no distortion here.
        `second_plane`: the second plane of the ground; None if the ground is one plane. Positions on it are x and y in
            the world, as seen from above.
    """

    span_s: tuple[float, float]
    image_size_px: tuple[int, int]
    principal_point_px: tuple[float, float]
    params: Array
    covariance: Array
    status: str
    bend: float = 0.0
    bend_sd: float | None = None
    second_plane: SecondPlane | None = None

    def __repr__(self) -> str:
        """Returns the camera's main parameters in one line."""
        size = "{} × {} px".format(*self.image_size_px)
        span = "{:g}–{:g} s".format(*self.span_s)
        angles = f"tilt {np.degrees(self.tilt_rad):.1f}°, roll {np.degrees(self.roll_rad):.1f}°"
        return f"Camera({size}, {span}, f {self.focal_px:.0f} px, {angles}, height {self.height_m:.2f} m, {self.status})"

    @classmethod
    def from_json(cls, segment: Mapping[str, Any]) -> Camera:
        """Reads one of the `segments` of `camera.json`."""
        lens = segment.get("lens") or {"bend": 0.0, "bend_sd": None}
        params = [np.log(segment["focal_px"]), segment["tilt_rad"], segment["roll_rad"], np.log(segment["height_m"])]
        return cls(
            span_s=(segment["span_s"][0], segment["span_s"][1]),
            image_size_px=(segment["image_size_px"][0], segment["image_size_px"][1]),
            principal_point_px=(segment["principal_point_px"][0], segment["principal_point_px"][1]),
            params=np.array(params),
            covariance=_covariance(segment["covariance"]),
            status=segment["status"],
            bend=lens["bend"],
            bend_sd=lens["bend_sd"],
            second_plane=_second_plane(segment),
        )

    @property
    def focal_px(self) -> float:
        """Returns the focal length, px."""
        return float(np.exp(self.params[0]))

    @property
    def focal_sd_px(self) -> float:
        """Returns the standard deviation of the focal length, px."""
        return self.focal_px * self._sd(0)

    @property
    def tilt_rad(self) -> float:
        """Returns the angle of the optical axis below the horizontal, rad."""
        return float(self.params[1])

    @property
    def tilt_sd_rad(self) -> float:
        """Returns the standard deviation of the tilt, rad."""
        return self._sd(1)

    @property
    def roll_rad(self) -> float:
        """Returns the clockwise rotation of the horizon in the picture, rad."""
        return float(self.params[2])

    @property
    def roll_sd_rad(self) -> float:
        """Returns the standard deviation of the roll, rad."""
        return self._sd(2)

    @property
    def height_m(self) -> float:
        """Returns the height above the ground, m."""
        return float(np.exp(self.params[3]))

    @property
    def height_sd_m(self) -> float:
        """Returns the standard deviation of the height, m."""
        return self.height_m * self._sd(3)

    def project(self, points: npt.ArrayLike) -> Array:
        """Projects points into the picture.

        Args:
            points: [..., 3] or, on the ground, [..., 2] in the world, m.

        Returns:
            [..., 2] px; NaN for points at or behind the camera.
        """
        return self._project(self.params, self._points(points))

    def project_sd(self, points: npt.ArrayLike) -> Array:
        """Returns the standard deviations of `project` due to the camera's uncertainty, to first order.

        Args:
            points: as for `project`, assumed to be exact in the world of the true camera.

        Returns:
            [..., 2] px; infinite if the camera is unknown.
        """
        where = self._points(points)
        return _sds(_by_camera(lambda params: self._project(params, where), self.params), self.covariance)

    def ground_from_pixel(self, pixels: npt.ArrayLike) -> Array:
        """Intersects the viewing rays of pixels with the ground.

        Args:
            pixels: [..., 2] px.

        Returns:
            [..., 2] x and y in the world, m; NaN at or above the horizon.
        """
        return self._ground(self.params, np.asarray(pixels, dtype=float))

    def ground_from_pixel_sd(self, pixels: npt.ArrayLike, pixel_sd: float = 0.0) -> Array:
        """Returns the standard deviations of `ground_from_pixel` due to the camera's uncertainty, to first order.

        Args:
            pixels: [..., 2] px.
            pixel_sd: standard deviation of each pixel coordinate, px.

        Returns:
            [..., 2] m; infinite if the camera is unknown.
        """
        where = np.asarray(pixels, dtype=float)
        variance = _sds(_by_camera(lambda params: self._ground(params, where), self.params), self.covariance) ** 2
        if self.second_plane is not None:
            second, covariance = self.second_plane.params, self.second_plane.covariance
            on_second = _sds(_by_camera(lambda params: self._on_second(params, where), second), covariance) ** 2
            variance = np.where(self._is_beyond(self.params, where), on_second, variance)
        for axis in np.eye(2) * _STEP_PX:
            by_pixel = (self._ground(self.params, where + axis) - self._ground(self.params, where - axis)) / (2 * _STEP_PX)
            variance = variance + (by_pixel * pixel_sd) ** 2
        return np.sqrt(variance)

    def undistorted(self, pixels: npt.ArrayLike) -> Array:
        """Returns the pixels [..., 2] at which a lens without distortion would show the scene points of pixels."""
        distorted = np.asarray(pixels, dtype=float) - np.asarray(self.principal_point_px)
        return np.asarray(self.principal_point_px + distorted / (1 + self._per_px2() * _square(distorted)))

    def distorted(self, pixels: npt.ArrayLike) -> Array:
        """Returns the pixels [..., 2] at which the lens shows undistorted pixels."""
        straight = np.asarray(pixels, dtype=float) - np.asarray(self.principal_point_px)
        root = np.sqrt(np.maximum(1 - 4 * self._per_px2() * _square(straight), 0))
        return np.asarray(self.principal_point_px + straight * (2 / (1 + root)))

    def camera_from_world(self) -> Array:
        """Returns the [4, 4] motion from the world to the camera's frame (x right, y down, z forward)."""
        motion = np.eye(4)
        motion[:3, :3] = _camera_from_world(self.params)
        motion[:3, 3] = -self.height_m * motion[:3, 2]
        return motion

    def _sd(self, i: int) -> float:
        return float(np.sqrt(self.covariance[i, i]))

    def _project(self, params: Array, points: Array) -> Array:
        in_camera = (points - [0.0, 0.0, np.exp(params[3])]) @ _camera_from_world(params).T
        z = in_camera[..., 2:]
        before = np.where(z > _NEAREST_M, z, np.nan)
        return self.distorted(self.principal_point_px + np.exp(params[0]) / before * in_camera[..., :2])

    def _ground(self, params: Array, pixels: Array) -> Array:
        rays = self._rays(params, pixels)
        on_first = _where_met(rays, params, params)
        if self.second_plane is None:
            return on_first
        return np.where(self._is_beyond(params, pixels), self._on_second(self.second_plane.params, pixels), on_first)

    def _on_second(self, second: Array, pixels: Array) -> Array:
        return _where_met(self._rays(second, pixels), second, self.params)

    def _is_beyond(self, params: Array, pixels: Array) -> npt.NDArray[np.bool_]:
        """Returns whether [..., 1] pixels show the second plane."""
        rays = self._rays(params, pixels)
        if self.second_plane is None:
            return np.zeros(rays.shape[:-1] + (1,), dtype=bool)
        is_nearer = _nearness(self.second_plane.params, rays) > _nearness(params, rays)
        return np.asarray(is_nearer == self.second_plane.rises)

    def _rays(self, params: Array, pixels: Array) -> Array:
        """Returns the viewing rays [..., 3] of pixels in the camera's frame."""
        slopes = (self.undistorted(pixels) - np.asarray(self.principal_point_px)) / np.exp(params[0])
        return np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)

    def _points(self, points: npt.ArrayLike) -> Array:
        """Returns points [..., 3] in the world; points without z are on the ground."""
        array = np.asarray(points, dtype=float)
        if array.shape[-1] != 2:
            return array
        z = np.zeros_like(array[..., :1])
        if self.second_plane is not None:
            up = _camera_from_world(self.second_plane.params)[:, 2]
            motion = self.camera_from_world()
            in_camera = np.concatenate([array, z], axis=-1) @ motion[:3, :3].T + motion[:3, 3]
            above = (in_camera @ up)[..., None] + np.exp(self.second_plane.params[3])
            z = np.where((above < 0) == self.second_plane.rises, -above / (up @ motion[:3, 2]), z)
        return np.concatenate([array, z], axis=-1)

    def _per_px2(self) -> float:
        return self.bend / (self.image_size_px[0] / 2) ** 2


@dataclass(frozen=True, eq=False)
class View:
    """The picture of one frame of a camera that turns or zooms.

    `Camera` projects into the camera's first picture, the world picture. A view converts between that picture and the
    frame's own, in which the boxes of `tracks` lie.

    Attributes:
        picture_from_world: [3, 3] homography from undistorted pixels of the world picture to those of the frame.
        camera: the camera, whose lens both pictures have; None for a lens without distortion.
    """

    picture_from_world: Array
    camera: Camera | None = None

    def picture_from_world_px(self, pixels: npt.ArrayLike) -> Array:
        """Converts pixels [..., 2] of the world picture to pixels of the frame."""
        return self._mapped(self.picture_from_world, pixels)

    def world_from_picture_px(self, pixels: npt.ArrayLike) -> Array:
        """Converts pixels [..., 2] of the frame to pixels of the world picture."""
        return self._mapped(np.asarray(np.linalg.inv(self.picture_from_world)), pixels)

    def _mapped(self, homography: Array, pixels: npt.ArrayLike) -> Array:
        array = np.asarray(pixels, dtype=float)
        if self.camera is not None:
            array = self.camera.undistorted(array)
        mapped = np.concatenate([array, np.ones_like(array[..., :1])], axis=-1) @ homography.T
        straight = np.asarray(mapped[..., :2] / mapped[..., 2:])
        return straight if self.camera is None else self.camera.distorted(straight)

    def turn(self, camera: Camera) -> tuple[float, Array]:
        """Returns the zoom, and the [3, 3] rotation from the camera's frame to that of the frame's camera."""
        x, y = camera.principal_point_px
        rays = np.array([[camera.focal_px, 0, x], [0, camera.focal_px, y], [0, 0, 1]])
        turn = np.linalg.inv(rays) @ self.picture_from_world @ rays
        rows = np.linalg.norm(turn, axis=1)
        growth = float(np.sqrt((rows[0] ** 2 + rows[1] ** 2) / 2) / rows[2])
        left, _, right = np.linalg.svd(np.diag([1 / growth, 1 / growth, 1]) @ turn)
        return growth, left @ right


def _by_camera(of: Callable[[Array], Array], params: Array) -> Array:
    """Returns the [..., 4] derivatives of a function of the camera's parameters, by central differences."""
    steps = np.eye(4) * _STEP
    return np.stack([(of(params + step) - of(params - step)) / (2 * _STEP) for step in steps], axis=-1)


def _nearness(params: Array, rays: Array) -> Array:
    """Returns one over the factors [..., 1] by which rays meet a plane; negative above its horizon."""
    return np.asarray(-(rays @ _camera_from_world(params)[:, 2:]) / np.exp(params[3]))


def _where_met(rays: Array, params: Array, world: Array) -> Array:
    """Returns x and y [..., 2] at which rays meet a plane, in the world of the camera's parameters `world`, m."""
    nearness = _nearness(params, rays)
    meets = nearness > _LEAST_DESCENT / np.exp(params[3])
    return np.asarray((rays @ _camera_from_world(world))[..., :2] / np.where(meets, nearness, np.nan))


def _second_plane(segment: Mapping[str, Any]) -> SecondPlane | None:
    if len(segment.get("ground", [])) < 2:
        return None
    plane = segment["ground"][1]
    params = [np.log(segment["focal_px"]), plane["tilt_rad"], plane["roll_rad"], np.log(plane["height_m"])]
    return SecondPlane(np.array(params), _covariance(plane["covariance"]), plane["slope_rad"] > 0)


def _covariance(entries: list[list[float | None]]) -> Array:
    """Returns a covariance of `camera.json`; unknown parameters have infinite variances."""
    covariance = np.array([[np.nan if v is None else v for v in row] for row in entries], dtype=float)
    unknown = np.isnan(covariance)
    covariance[unknown] = np.where(np.eye(4)[unknown] > 0, np.inf, 0.0)
    return covariance


def _square(pixels: Array) -> Array:
    return np.asarray(np.sum(pixels**2, axis=-1, keepdims=True))


def _camera_from_world(params: Array) -> Array:
    """Returns the [3, 3] rotation; its columns are right, forward and up."""
    (sin_t, cos_t), (sin_r, cos_r) = ((np.sin(angle), np.cos(angle)) for angle in params[1:3])
    up = np.array([sin_r * cos_t, -cos_r * cos_t, -sin_t])
    # A camera that points straight down has no horizontal viewing direction; the picture's up direction replaces it.
    axis = np.array([0.0, 0.0, 1.0]) if np.hypot(up[0], up[1]) > 1e-9 else np.array([0.0, -1.0, 0.0])
    level = axis - up * (up @ axis)
    forward = level / np.linalg.norm(level)
    return np.column_stack([np.cross(forward, up), forward, up])


def _sds(derivatives: Array, covariance: Array) -> Array:
    if not np.isfinite(covariance).all():
        return np.full(derivatives.shape[:-1], np.inf)
    return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", derivatives, covariance, derivatives)))
