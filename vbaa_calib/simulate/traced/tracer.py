"""Pictures by mitsuba 3: a larger and finer pinhole or thin-lens picture, resampled through our lens.

Mitsuba works in millimetres about the rig: its ray offsets grow with the coordinates.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import Sheet
from vbaa_calib.simulate.render.meshes import Triangles, object_mesh, tube_mesh
from vbaa_calib.simulate.scene.lens import RayMap
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Joints, SceneSpec

from .bench import TRACE, bench, facing, lights, matt, picture_of, placed, rgb

_MM = 1000.0


@cache
def _load_mitsuba() -> Any:
    """The module, set to its fastest variant. Raises InputError if it is not installed."""
    try:
        import mitsuba
    except ImportError as error:
        raise InputError(
            f"needs mitsuba ({error})", where="--render mitsuba", remedy="pip install 'vbaa-calib[render]'"
        ) from error
    # an unsuitable LLVM aborts the process: try in another one
    # A program that an LLVM too old for this processor cannot compile.
    program = (
        "import mitsuba as mi, drjit as dr, numpy as np; mi.set_variant('llvm_ad_rgb'); "
        "print(np.array(dr.minimum(mi.Float([1, 2]), mi.Float([2, 1]))))"
    )
    probe = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    )
    mitsuba.set_variant("scalar_rgb" if probe.returncode else "llvm_ad_rgb")
    return mitsuba


SurfacedTube = tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]
"""Arc lengths, points (antenna frame), radii, all in metres, and the surface of a tube."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """The rig at one instant. wires : the antenna and its holder."""

    T_world_camera: Pose
    T_world_antenna: Pose
    wires: Sequence[SurfacedTube] = ()


@dataclass(frozen=True, eq=False)
class Tracer:
    """What all pictures of a scene share: mitsuba, the lens, the surroundings, and the radiance of a white card."""

    mi: Any
    scene: SceneSpec
    rays: RayMap
    around: dict[str, Any]
    card: float
    lift_m: float = 0.0

    def picture(self, exposures: Sequence[Exposure], things: dict[str, Any], seed: int) -> np.ndarray:
        """(height, width, 3) float32 brightness in linear red, green, blue; the mean over the exposures."""
        spec = self.scene.traced
        each = round(spec.samples / TRACE.finer**2 / len(exposures))
        total: Any = sum(
            _render(self.mi, self._around_and(one, things), self._sensor(one), each, seed + n)
            for n, one in enumerate(exposures)
        )
        # pixels saturate; without a limit a rare path through nylon would be a spark
        fine = np.minimum(total / len(exposures) * (spec.exposure / self.card), TRACE.full_well)
        return _through_lens(self.rays, _pinhole(self.rays), fine)

    def _around_and(self, one: Exposure, things: dict[str, Any]) -> dict[str, Any]:
        wires = {
            f"wire_{n}": _mesh(
                self.mi, tube_mesh(s * _MM, self.at(one.T_world_antenna @ points), radius * _MM, 0.6), look
            )
            for n, (s, points, radius, look) in enumerate(one.wires)
        }
        return self.around | things | wires

    def at(self, points_world_m: np.ndarray) -> np.ndarray:
        """Points (..., 3) as mitsuba has them."""
        return _MM * (points_world_m - _origin(self.scene) + np.array([0.0, 0.0, self.lift_m]))

    def raised_above(self, points_world_m: np.ndarray) -> Tracer:
        """The same with the rig lifted until points (N, 3) are above everything on the bench."""
        needed = TRACE.clear_m - self.scene.traced.bench_below_m + _origin(self.scene)[2] - points_world_m[:, 2].min()
        return replace(self, lift_m=max(float(needed), 0.0))

    def touched(self, obj: TouchObject) -> Any:
        """The touched object."""
        shape = object_mesh(obj)
        look = matt(rgb(self.scene.picture.object))
        return _mesh(self.mi, Triangles(self.at(shape.vertices), shape.normals, shape.faces), look)

    def board(self, sheet: Sheet, T_world_board: Pose) -> Any:
        """The printed sheet."""
        rows, columns = sheet.texture.shape[:2]
        corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]]) / sheet.texels_per_m - sheet.margin_m
        vertices = self.at(T_world_board @ np.pad(corners, ((0, 0), (0, 1))))
        normals = np.tile(-T_world_board.rotation[:, 2], (4, 1))
        faces, uv = np.array([[0, 2, 1], [0, 3, 2]]), np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        print_ = np.repeat(sheet.texture[..., :1] / np.float32(65535), 3, axis=2)
        return _mesh(self.mi, Triangles(vertices, normals, faces), matt(picture_of(print_)), uv)

    def _sensor(self, one: Exposure) -> dict[str, Any]:
        focal, (width, height) = _pinhole(self.rays)
        spec, camera = self.scene.traced, one.T_world_camera
        # mitsuba's camera: x left, y up, z forward
        turned = placed(self.at(camera.translation_m), camera.rotation @ np.diag([-1.0, -1.0, 1.0]))
        middle = self.scene.T_antenna_camera.inverse() @ np.array([0.5 * self.scene.antenna.length_m, 0.0, 0.0])
        aperture: dict[str, Any] = {"type": "perspective"}
        if spec.aperture_m:
            focus = float(middle[2]) if spec.focus_m is None else spec.focus_m
            aperture = {"type": "thinlens", "aperture_radius": spec.aperture_m / 2 * _MM, "focus_distance": focus * _MM}
        return aperture | {
            "fov": float(np.rad2deg(2 * np.arctan(width / 2 / focal))),
            "fov_axis": "x",
            "near_clip": 1.0,
            "far_clip": 1e5,
            "to_world": turned,
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "multijitter"},
        }


def tracer(scene: SceneSpec, rays: RayMap, rng: np.random.Generator) -> Tracer:
    """Prepare a scene. Raises InputError without mitsuba, or for a lens too wide for a pinhole."""
    mi = _load_mitsuba()
    if np.abs(rays.padded).max() > TRACE.widest:
        what = "sees more than 143°, too wide for a pinhole picture"
        raise InputError(what, where=f"scene {scene.name}: camera", remedy="take a longer lens or the other renderer")
    spec = scene.traced
    home = scene.T_world_antenna(Joints(0.0, 0.0))
    middle = _MM * (home @ np.array([scene.antenna.length_m / 2, 0.0, 0.0]) - _origin(scene))
    along = float(np.arctan2(*home.rotation[1::-1, 0]))
    below = np.array([0.0, 0.0, -_MM * spec.bench_below_m])
    things = lights(spec.light) | bench(spec.bench, spec.bench_roughness, middle[:2], along, rng)
    around = {name: _loaded(mi, thing, below) for name, thing in things.items()}
    lit = {name: thing for name, thing in around.items() if name in lights(spec.light)}
    return Tracer(mi, scene, rays, around, _card(mi, lit, middle))


def _origin(scene: SceneSpec) -> np.ndarray:
    return scene.kinematics.position_world_m


def _card(mi: Any, lit: dict[str, Any], middle: np.ndarray) -> float:
    """Radiance of a white card that lies where the antenna is."""
    white = matt(rgb(1.0))
    card = {"type": "rectangle", "to_world": placed(middle, scale=(5.0, 5.0, 1.0)), "bsdf": white}
    eye = middle + np.array([0.0, 0.0, 60.0])
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sensor = {"type": "perspective", "fov": 4.0, "to_world": placed(eye, facing(eye, middle)), "film": film}
    return float(_render(mi, lit | {"card": card}, sensor, 256, 0).mean())


def _mesh(mi: Any, shape: Triangles, look: dict[str, Any], uv: np.ndarray | None = None) -> Any:
    """One of mitsuba's meshes."""
    holds = mi.Properties()
    holds["surface"] = mi.load_dict(_native(mi, look))
    made = mi.Mesh("mesh", len(shape.vertices), len(shape.faces), holds, True, uv is not None)
    values = mi.traverse(made)
    values["vertex_positions"] = np.ravel(shape.vertices).astype(np.float32)
    values["vertex_normals"] = np.ravel(shape.normals).astype(np.float32)
    values["faces"] = np.ravel(shape.faces).astype(np.uint32)
    if uv is not None:
        values["vertex_texcoords"] = np.ravel(uv).astype(np.float32)
    values.update()
    return made


def _loaded(mi: Any, thing: Any, shift: np.ndarray) -> Any:
    """A thing of the bench, set to where the bench is."""
    if isinstance(thing, tuple):
        shape, look = thing
        return _mesh(mi, Triangles(shape.vertices + shift, shape.normals, shape.faces), look)
    if "to_world" in thing:
        thing = thing | {"to_world": placed(shift) @ thing["to_world"]}
    return mi.load_dict(_native(mi, thing))


def _native(mi: Any, thing: Any) -> Any:
    """A dictionary with arrays as mitsuba wants them."""
    if not isinstance(thing, dict):
        return thing
    made = {key: _native(mi, value) for key, value in thing.items()}
    if "to_world" in made:
        made["to_world"] = mi.ScalarTransform4f(made["to_world"])
    if made.get("type") == "bitmap":
        made["bitmap"] = mi.Bitmap(np.ascontiguousarray(made.pop("data")))
    return made


def _render(mi: Any, things: dict[str, Any], sensor: dict[str, Any], samples: int, seed: int) -> np.ndarray:
    scene = {"type": "scene", "integrator": {"type": "path", "max_depth": TRACE.depth}, "eye": _native(mi, sensor)}
    loaded = mi.load_dict(scene | {name: _native(mi, thing) for name, thing in things.items()})
    return np.array(mi.render(loaded, spp=max(1, samples), seed=seed), np.float32)[..., :3]


def _pinhole(rays: RayMap) -> tuple[float, tuple[int, int]]:
    """Focal length and size, px, of the pinhole picture that holds all of the lens's rays, axis in its middle."""
    focal = TRACE.finer * float(np.diag(rays.lens.matrix)[:2].mean())
    width, height = 2 * np.ceil(focal * np.abs(rays.padded).max(axis=(0, 1))).astype(int) + 4
    return focal, (int(width), int(height))


def _through_lens(rays: RayMap, pinhole: tuple[float, tuple[int, int]], fine: np.ndarray) -> np.ndarray:
    """(height, width, 3) what the lens makes of the pinhole's picture: the mean over each of its own pixels."""
    focal, size = pinhole
    width, height = rays.lens.image_size
    where = rays.block(0, 0, width, height, TRACE.subpixels) * np.float32(focal) + np.float32(np.array(size) / 2 - 0.5)
    samples = cv2.remap(fine, where.astype(np.float32), np.empty(0), cv2.INTER_LINEAR)
    return cv2.resize(samples, (width, height), interpolation=cv2.INTER_AREA)
