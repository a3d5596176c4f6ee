"""Draws a scene (or a window of its image) with OpenGL; runs on a GPU or on Mesa's llvmpipe."""

from __future__ import annotations

import os
from pathlib import Path

import moderngl
import numpy as np

from roadplane_train.cars.mesh import MATERIALS, CarMesh

from .appearance import CarAppearance
from .camera import Camera
from .gpu_car import GpuCar
from .props import SHAPES, unit_shape
from .scene import PlacedCar, Scene
from .textures import ENVIRONMENT_SIZE, environment_image, noise_image

SHADERS = Path(__file__).parent / "shaders"
ENVIRONMENTS = 96
INSTANCES = 1024  # of one shape of prop
MAX_CARS = 48  # as in common.glsl: cars that darken the ground and each other
DARKENED_M, DARKENED_HIGH_M = 6.6, 1.3  # open_sky of common.glsl: beyond this distance a car takes less than 2^-25 of the light
GROUND_REACH_M = 1500.0
SHADOW_CLUSTER_M = 0.09  # shadows are cast by a coarser mesh
NEAR_SHARE = 0.02  # near plane as a share of the depth of the nearest car, or of the scene's `nearest_m`


class Renderer:
    """One OpenGL context with its programs, textures and frame buffers."""

    def __init__(self, seed: int = 0, shadow_size: int = 1024) -> None:
        os.environ.setdefault("LP_NUM_THREADS", "1")
        self.context = moderngl.create_context(standalone=True, backend="egl")
        self.context.front_face = "cw"  # image rows run along GL rows: mirrored
        rng = np.random.default_rng(seed)
        self._noise = self._texture(noise_image(rng))
        self._environments = []
        for _ in range(ENVIRONMENTS):
            texture = self.context.texture(ENVIRONMENT_SIZE, 4, environment_image(rng).astype(np.float16).tobytes(), dtype="f2")
            texture.build_mipmaps()
            texture.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
            texture.repeat_y = False
            self._environments.append(texture)
        self._car = self._program("car.vert", "car.frag", common=True)
        self._ground = self._program("ground.vert", "ground.frag", common=True)
        self._prop = self._program("prop.vert", "prop.frag", common=True)
        self._sky = self._program("sky.vert", "sky.frag", common=True)
        self._car_truth = self._program("car.vert", "truth.frag")
        self._prop_truth = self._program("prop.vert", "truth.frag", define="PROP")
        self._car_shadow = self._program("car.vert", "shadow.frag")
        self._prop_shadow = self._program("prop.vert", "shadow.frag")
        self._shadow_map = self.context.depth_texture((shadow_size, shadow_size))
        self._shadow_map.compare_func = "<="
        self._shadow_map.repeat_x = self._shadow_map.repeat_y = False
        self._shadow_buffer = self.context.framebuffer(depth_attachment=self._shadow_map)
        self._targets: dict[tuple[str, int, int], tuple] = {}
        corners = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]], np.float32)
        self._sky_quad = self._simple(self._sky, corners, "in_corner")
        self._ground_quad = self._simple(self._ground, self._ground_grid(), "in_place")
        self._shapes = [tuple(self.context.buffer(a.tobytes()) for a in unit_shape(name)) for name in SHAPES]
        self._instances = [self.context.buffer(reserve=INSTANCES * 21 * 4) for _ in SHAPES]
        layout = [(shape[0], "3f", "in_position") for shape in self._shapes]
        self._prop_arrays = []
        for index in range(len(SHAPES)):
            self._prop_arrays.append(
                {
                    program: self.context.vertex_array(
                        program,
                        [
                            layout[index],
                            (self._shapes[index][1], "3f", "in_normal"),
                            (self._instances[index], "16f 4f 1f /i", "in_world_from_prop", "in_colour", "in_leaves"),
                        ],
                        skip_errors=True,
                    )
                    for program in (self._prop, self._prop_truth, self._prop_shadow)
                }
            )

    # Resources

    def _program(self, vertex: str, fragment: str, common: bool = False, define: str = "") -> moderngl.Program:
        source = (SHADERS / fragment).read_text()
        if common:
            source = (SHADERS / "common.glsl").read_text() + source
        if define:
            source = source.replace("#version 330\n", f"#version 330\n#define {define}\n", 1)
        return self.context.program(vertex_shader=(SHADERS / vertex).read_text(), fragment_shader=source)

    def _texture(self, image: np.ndarray) -> moderngl.Texture:
        texture = self.context.texture(image.shape[1::-1], image.shape[2], image.tobytes())
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
        return texture

    def _simple(self, program: moderngl.Program, data: np.ndarray, name: str) -> moderngl.VertexArray:
        return self.context.vertex_array(program, [(self.context.buffer(data.astype(np.float32).tobytes()), "2f", name)])

    @staticmethod
    def _ground_grid() -> np.ndarray:
        """Quads that grow with distance, so that clipping stays exact far away."""
        edges = np.concatenate([-np.geomspace(GROUND_REACH_M, 4, 9), [0], np.geomspace(4, GROUND_REACH_M, 9)])
        x0, y0 = np.meshgrid(edges[:-1], edges[:-1])
        x1, y1 = np.meshgrid(edges[1:], edges[1:])
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y0), (x1, y1), (x0, y1)]
        return np.stack([np.stack(c, axis=-1) for c in corners], axis=2).reshape(-1, 2)

    def upload(self, mesh: CarMesh) -> GpuCar:
        """Uploads a mesh to the GPU."""
        glass = mesh.materials == MATERIALS.index("glass")
        order = np.argsort(glass, kind="stable")
        faces, materials = mesh.faces[order], mesh.materials[order]
        key = faces.astype(np.int64) * len(MATERIALS) + materials[:, None]
        unique, index = np.unique(key.ravel(), return_inverse=True)
        vertex, material = unique // len(MATERIALS), unique % len(MATERIALS)
        data = np.concatenate([mesh.vertices[vertex], mesh.normals[vertex], material[:, None]], axis=1).astype(np.float32)
        vertices = self.context.buffer(data.tobytes())
        indices = self.context.buffer(index.astype(np.int32).tobytes())
        layout = [(vertices, "3f 3f 1f", "in_position", "in_normal", "in_material")]
        arrays = [
            self.context.vertex_array(program, layout, indices, skip_errors=True) for program in (self._car, self._car_truth)
        ]
        coarse_vertices, coarse_faces = clustered(mesh.vertices, mesh.faces, SHADOW_CLUSTER_M)
        coarse = self.context.buffer(coarse_vertices.tobytes()), self.context.buffer(coarse_faces.tobytes())
        shadow = self.context.vertex_array(self._car_shadow, [(coarse[0], "3f", "in_position")], coarse[1])
        return GpuCar(
            mesh,
            *arrays,
            shadow,
            solid_indices=3 * int((~glass).sum()),
            all_indices=3 * len(faces),
            buffers=(vertices, indices, *coarse),
            bounds=(mesh.vertices.min(0), mesh.vertices.max(0)),
            wheels=_wheels(mesh),
        )

    def _target(self, kind: str, width: int, height: int) -> tuple:
        """Returns frame buffers by kind and size.

        There is no multisampling, which costs llvmpipe four times as much; callers supersample.
        """
        key = (kind, width, height)
        if key not in self._targets:
            size = (width, height)
            if kind == "truth":
                self._targets[key] = (
                    self.context.framebuffer(
                        [self.context.renderbuffer(size, 2, dtype="f4")], self.context.depth_renderbuffer(size)
                    ),
                )
            else:
                self._targets[key] = (
                    self.context.framebuffer([self.context.renderbuffer(size, 4)], self.context.depth_renderbuffer(size)),
                )
        return self._targets[key]

    # Drawing

    def colour(
        self, scene: Scene, camera: Camera, window: tuple[float, float, float, float], size: tuple[int, int]
    ) -> np.ndarray:
        """Draws a window of the camera's image, resampled to `size` (width, height): RGB uint8 (height, width, 3)."""
        rounded = tuple(-(-n // 64) * 64 for n in size)
        (drawn,) = self._target("colour", *rounded)
        clip_from_world = self._clip(scene, camera, window)
        self._fill_instances(scene)
        shadow_from_world = self._draw_shadows(scene)
        drawn.use()
        drawn.viewport = (0, 0, *size)
        self._set_common(scene, camera, clip_from_world, shadow_from_world)
        self._paint(drawn, scene, camera, clip_from_world)
        data = drawn.read(viewport=(0, 0, *size), components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(size[1], size[0], 3)

    def redraw(
        self,
        image: np.ndarray,
        scene: Scene,
        camera: Camera,
        window: tuple[float, float, float, float],
        parts: list[tuple[int, int, int, int]],
    ) -> None:
        """Redraws parts (x, y, width, height in pixels of `image`) of the result of `colour` for the window.

        The bits are the same, as the rasteriser's coordinates are those of the whole picture; only its scissors differ.
        """
        if not parts:
            return
        size = image.shape[1::-1]
        (drawn,) = self._target("colour", *(-(-n // 64) * 64 for n in size))
        clip_from_world = self._clip(scene, camera, window)
        self._fill_instances(scene)
        shadow_from_world = self._draw_shadows(scene)
        drawn.use()
        drawn.viewport = (0, 0, *size)
        self._set_common(scene, camera, clip_from_world, shadow_from_world)
        pixel = window[2] / size[0], window[3] / size[1]
        for x, y, width, height in parts:
            place = window[0] + x * pixel[0], window[1] + y * pixel[1], width * pixel[0], height * pixel[1]
            drawn.scissor = (x, y, width, height)
            self._set_cars(scene, _darkening(scene, camera, place))
            self._paint(drawn, scene, camera, self._clip(scene, camera, place))
            data = drawn.read(viewport=(x, y, width, height), components=3, alignment=1)
            image[y : y + height, x : x + width] = np.frombuffer(data, np.uint8).reshape(height, width, 3)
        drawn.scissor = None

    def _paint(self, drawn: moderngl.Framebuffer, scene: Scene, camera: Camera, clip_from_world: np.ndarray) -> None:
        """Draws everything except cars that cannot touch the window of `clip_from_world`."""
        drawn.clear(0.5, 0.5, 0.5, 1.0)
        self.context.enable_only(moderngl.DEPTH_TEST)
        away = [np.linalg.norm(car.world_from_car[:3, 3] - [0, 0, camera.height_m]) for car in scene.cars]
        shown = [i for i, car in enumerate(scene.cars) if _in_window(car, clip_from_world)]
        near_first = np.array([i for i in np.argsort(away) if i in shown], int)
        for index in near_first:
            self._draw_car(scene, index, 0)
        for arrays, instances in zip(self._prop_arrays, self._counts, strict=True):
            if instances:
                arrays[self._prop].render(moderngl.TRIANGLES, instances=instances)
        self._ground_quad.render(moderngl.TRIANGLES)
        self.context.depth_func = "<="
        self._sky_quad.render(moderngl.TRIANGLE_STRIP)
        self.context.depth_func = "<"
        self.context.enable(moderngl.BLEND)
        self.context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        drawn.depth_mask = False
        for index in near_first[::-1]:
            self._draw_car(scene, index, 1)
        drawn.depth_mask = True
        self.context.disable(moderngl.BLEND)

    def truth(
        self, scene: Scene, camera: Camera, window: tuple[float, float, float, float], size: tuple[int, int], first: int = 0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the whole silhouette of one car, the object per pixel, and the depth, each (height, width).

        The silhouette is bool. Objects are 0 nothing, i + 1 car i, −1 prop; int. The depth is along the optical axis,
        m; inf for nothing. The ground is left out, as it hides no car. Glass hides like metal.
        """
        (target,) = self._target("truth", *size)
        target.use()
        target.clear(0.0, 1e9, 0.0, 0.0)
        self.context.enable_only(moderngl.DEPTH_TEST)
        clip_from_world = self._clip(scene, camera, window)
        for program in (self._car_truth, self._prop_truth):
            program["clip_from_world"].write(_gl(clip_from_world))
            program["optical_axis"].value = tuple(camera.camera_from_world[2])
        self._draw_truth(scene, first)
        alone = self._read_truth(target, size)[..., 0] != 0
        for index, car in enumerate(scene.cars):
            if index != first and _in_window(car, clip_from_world):
                self._draw_truth(scene, index)
        self._fill_instances(scene)
        self._noise.use(0)
        self._prop_truth["noise"].value = 0
        self._prop_truth["object"].value = -1.0
        for arrays, instances in zip(self._prop_arrays, self._counts, strict=True):
            if instances:
                arrays[self._prop_truth].render(moderngl.TRIANGLES, instances=instances)
        seen = self._read_truth(target, size)
        return alone, seen[..., 0].round().astype(np.int32), np.where(seen[..., 0] == 0, np.inf, seen[..., 1])

    def _draw_truth(self, scene: Scene, index: int) -> None:
        car = scene.cars[index]
        self._car_truth["object"].value = index + 1.0
        self._car_truth["world_from_car"].write(_gl(car.world_from_car))
        car.gpu.truth.render(moderngl.TRIANGLES, vertices=car.gpu.all_indices)

    @staticmethod
    def _read_truth(target: moderngl.Framebuffer, size: tuple[int, int]) -> np.ndarray:
        data = target.read(viewport=(0, 0, *size), components=2, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(size[1], size[0], 2)

    def _clip(self, scene: Scene, camera: Camera, window: tuple[float, float, float, float]) -> np.ndarray:
        pose = camera.camera_from_world
        depths = [float((pose @ car.world_from_car[:, 3])[2]) for car in scene.cars]
        nearest = min((d for d in depths if d > 0), default=10.0) if scene.nearest_m is None else scene.nearest_m
        near = max(0.2, NEAR_SHARE * nearest)
        return camera.clip_from_world(window, near, 4 * GROUND_REACH_M)

    def _fill_instances(self, scene: Scene) -> None:
        self._counts = []
        for shape, buffer in zip(SHAPES, self._instances, strict=True):
            rows = [
                np.concatenate([p.world_from_prop.T.ravel(), p.colour, [p.texture, p.leaves]])
                for p in scene.props
                if p.shape == shape
            ][:INSTANCES]
            self._counts.append(len(rows))
            if rows:
                buffer.write(np.array(rows, np.float32).tobytes())

    def _draw_shadows(self, scene: Scene) -> np.ndarray:
        light, centre, reach = scene.light, scene.centre, scene.shadow_reach_m
        side = np.cross([0, 1e-6, 1.0], light.to_sun)  # also valid with the sun in the zenith
        side /= np.linalg.norm(side)
        up = np.cross(light.to_sun, side)
        rotation = np.stack([side, up, -light.to_sun])
        shadow_from_world = np.eye(4)
        scale = np.array([1 / reach, 1 / reach, 1 / (2 * reach)])
        shadow_from_world[:3, :3] = rotation * scale[:, None]
        shadow_from_world[:3, 3] = -shadow_from_world[:3, :3] @ centre
        if light.sun[1] <= 0:
            return shadow_from_world
        self._shadow_buffer.use()
        self._shadow_buffer.clear(depth=1.0)
        self.context.enable_only(moderngl.DEPTH_TEST)
        clip = _gl(shadow_from_world)
        self._car_shadow["clip_from_world"].write(clip)
        self._prop_shadow["clip_from_world"].write(clip)
        for car in scene.cars:
            self._car_shadow["world_from_car"].write(_gl(car.world_from_car))
            car.gpu.shadow.render(moderngl.TRIANGLES)
        for arrays, instances in zip(self._prop_arrays, self._counts, strict=True):
            if instances:
                arrays[self._prop_shadow].render(moderngl.TRIANGLES, instances=instances)
        return shadow_from_world

    def _set_common(self, scene: Scene, camera: Camera, clip: np.ndarray, shadow_from_world: np.ndarray) -> None:
        light = scene.light
        self._noise.use(0)
        self._environments[light.environment].use(1)
        self._shadow_map.use(2)
        values = {
            "camera_position": camera.centre_m,
            "to_sun": tuple(light.to_sun),
            "sun": tuple(light.sun),
            "sky": tuple(light.sky),
            "ground_radiance": tuple(scene.ground_radiance),
            "sun_mirror": light.sun_mirror,
            "dapple": light.dapple,
            "haze": light.haze,
            "exposure": light.exposure,
            "least_rise": scene.least_rise,
            "shadow_softness": light.softness_m / (2 * scene.shadow_reach_m),
            "noise": 0,
            "environment": 1,
            "shadow_map": 2,
        }
        raw = {
            "clip_from_world": _gl(clip),
            "shadow_from_world": _gl(shadow_from_world),
            "world_from_clip": _gl(np.linalg.inv(clip)),
        }
        for program in (self._car, self._ground, self._prop, self._sky):
            for name, value in values.items():
                if name in program:
                    program[name].value = value
            for name, value in raw.items():
                if name in program:
                    program[name].write(value)
        self._set_ground(scene)
        self._set_cars(scene, list(range(min(len(scene.cars), MAX_CARS))))

    def _set_cars(self, scene: Scene, darkening: list[int]) -> None:
        """Selects the cars, MAX_CARS at most, that take light of the sky from the ground and from each other."""
        place = np.zeros((MAX_CARS, 4), np.float32)
        extent = np.zeros((MAX_CARS, 3), np.float32)
        for row, index in enumerate(darkening):
            car = scene.cars[index]
            pose = car.world_from_car
            place[row] = (*pose[:2, 3], *pose[:2, 0])
            front, back = car.gpu.bounds[1][0], car.gpu.bounds[0][0]
            extent[row] = ((front - back) / 2, car.gpu.mesh.dims[1] / 2, (front + back) / 2)
        self._rows = {index: row for row, index in enumerate(darkening)}
        for program in (self._car, self._ground):
            program["car_count"].value = len(darkening)
            program["car_place"].write(place.tobytes())
            program["car_extent"].write(extent.tobytes())

    def _set_ground(self, scene: Scene) -> None:
        program, floor = self._ground, scene.floor
        grounds = floor.grounds
        program["low"].write(np.array([g.low for g in grounds], np.float32).tobytes())
        program["high"].write(np.array([g.high for g in grounds], np.float32).tobytes())
        program["scales"].write(np.array([(*g.scales, g.stains) for g in grounds], np.float32).tobytes())
        program["surface"].write(np.array([(g.cracks, g.gloss) for g in grounds], np.float32).tobytes())
        borders = np.zeros((3, 4), np.float32)
        for i, (normal_x, normal_y, distance) in enumerate(floor.borders[:3]):
            borders[i, :3] = normal_x, normal_y, distance
        program["borders"].write(borders.tobytes())
        program["kerb_width"].value = floor.kerb_width_m
        program["frame"].value = tuple(floor.frame)
        program["bays"].value = tuple(floor.bays)
        program["rows"].value = tuple(floor.rows)
        program["paint"].value = tuple(floor.paint)
        program["seed"].value = tuple(floor.seed)

    def _draw_car(self, scene: Scene, index: int, part: int) -> None:
        car, program = scene.cars[index], self._car
        program["world_from_car"].write(_gl(car.world_from_car))
        surface, mirror = material_tables(car.appearance)
        program["surface"].write(surface.tobytes())
        program["mirror"].write(mirror.tobytes())
        program["dirt"].value = (*car.appearance.dirt_colour, car.appearance.dirt)
        program["glass"].value = (car.appearance.glass, car.appearance.glass_reflection, car.appearance.seed, 0.0)
        program["lamps"].value = (car.appearance.headlamp, car.appearance.taillamp)
        program["own"].value = self._rows.get(int(index), -1)
        program["wheels"].value = car.gpu.wheels
        program["rolled"].value = car.rolled_m / car.gpu.wheels[2]
        gpu = car.gpu
        if part == 0:
            gpu.colour.render(moderngl.TRIANGLES, vertices=gpu.solid_indices)
        elif gpu.all_indices > gpu.solid_indices:
            gpu.colour.render(moderngl.TRIANGLES, vertices=gpu.all_indices - gpu.solid_indices, first=gpu.solid_indices)


def _wheels(mesh: CarMesh) -> tuple[float, float, float, float]:
    """Returns the wheels for car.vert: hubs and radius of a mesh, perhaps stretched.

    None if the keypoints do not give them.
    """
    if not np.isfinite(mesh.keypoints[:2]).all():
        return 0.0, 0.0, -1.0, 1.0
    front, rear = mesh.keypoints[:2]
    reach = np.ptp(mesh.vertices[np.unique(mesh.material_faces("tyre")), 0]) - (front[0] - rear[0])
    return float(front[0]), float(rear[0]), float(front[2]), float(reach / (2 * front[2]))


def clustered(vertices: np.ndarray, faces: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns a coarser mesh: vertices of one grid cell become their mean, faces without area are removed."""
    cells = np.floor(vertices / cell_m).astype(np.int64) + 4096
    _, index = np.unique(cells @ np.array([1 << 40, 1 << 20, 1]), return_inverse=True)
    counts = np.bincount(index)
    means = np.stack([np.bincount(index, vertices[:, axis]) / counts for axis in range(3)], axis=1)
    merged = index[faces]
    a, b, c = merged.T
    return means.astype(np.float32), merged[(a != b) & (b != c) & (a != c)].astype(np.int32)


def _in_window(car: PlacedCar, clip_from_world: np.ndarray) -> bool:
    """Returns whether the car's bounding box can touch the window."""
    low, high = car.gpu.bounds
    corners = np.array([(x, y, z, 1.0) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    clip = corners @ (clip_from_world @ car.world_from_car).T
    x, y, w = clip[:, 0], clip[:, 1], clip[:, 3]
    return bool((w > 0).any() and (x > -w).any() and (x < w).any() and (y > -w).any() and (y < w).any())


def _darkening(scene: Scene, camera: Camera, window: tuple[float, float, float, float]) -> list[int]:
    """Returns the cars that take light from the window's content.

    For others the shader's factor is 1 in single precision.
    """
    every = list(range(min(len(scene.cars), MAX_CARS)))
    x, y, width, height = window
    corners = [camera.ground_from_pixel(np.array([a, b])) for a in (x, x + width) for b in (y, y + height)]
    if any(corner is None for corner in corners):
        return every
    ground = np.array(corners)
    above = ground + (np.array([0, 0, camera.height_m]) - ground) * min(DARKENED_HIGH_M / camera.height_m, 1.0)
    points = np.concatenate([ground, above])[:, :2]
    low, high = points.min(0) - DARKENED_M, points.max(0) + DARKENED_M
    found = []
    for index in every:
        car = scene.cars[index]
        reach = np.hypot(np.abs(np.array(car.gpu.bounds)[:, 0]).max(), car.gpu.mesh.dims[1] / 2)
        place = car.world_from_car[:2, 3]
        if (place > low - reach).all() and (place < high + reach).all():
            found.append(index)
    return found


def material_tables(appearance: CarAppearance) -> tuple[np.ndarray, np.ndarray]:
    """Returns the uniforms `surface` and `mirror` of car.frag, each (14, 4) float32, rows as in MATERIALS."""
    tint = appearance.paint / max(appearance.paint.max(), 1e-3)
    level = min(0.05 + appearance.paint.max(), 0.6)
    flakes = tint * level * 0.75 * appearance.metallic
    rows = {
        "paint": ((*appearance.paint, 1.0), (*flakes, 4.2)),
        "tyre": ((0.012, 0.012, 0.012, 0.05), (0, 0, 0, 0)),
        "rim": ((*appearance.rim * 0.7, 0.4), (*appearance.rim * 0.6, 3.0)),
        "headlamp": ((0.32, 0.33, 0.35, 1.0), (0.45, 0.45, 0.46, 3.0)),
        "taillamp": ((0.28, 0.012, 0.01, 1.0), (0.08, 0.005, 0.004, 2.0)),
        "chrome": ((0.1, 0.1, 0.1, 0.3), (0.6, 0.6, 0.6, 1.0)),
        "plastic": ((*appearance.lower, 0.35), (0, 0, 0, 0)),
        "plate": ((*appearance.plate, 0.2), (0, 0, 0, 0)),
        "underbody": ((0.01, 0.01, 0.01, 0.0), (0, 0, 0, 0)),
        "interior": ((*appearance.interior, 0.0), (0, 0, 0, 0)),
        "gap": ((0.006, 0.006, 0.006, 0.0), (0, 0, 0, 0)),
        "glass": ((0.01, 0.01, 0.01, 0.0), (0, 0, 0, 0)),
        "livery": ((*appearance.livery, 0.6), (0, 0, 0, 0)),
        "indicator": ((0.55, 0.16, 0.01, 1.0), (0.08, 0.03, 0.004, 2.0)),
    }
    table = np.array([rows[name] for name in MATERIALS], np.float32)
    return np.ascontiguousarray(table[:, 0]), np.ascontiguousarray(table[:, 1])


def _gl(matrix: np.ndarray) -> bytes:
    """Returns column-major float32 bytes."""
    return np.ascontiguousarray(matrix.T, np.float32).tobytes()
