"""Path-traced pictures of a plan by mitsuba 3: bench, clutter, lights, board, object and antenna.

Mitsuba renders a larger and finer pinhole or thin-lens picture, which is resampled through our lens. It works in
millimetres about the rig (the bench is z = 0): its ray offsets grow with the coordinates.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core
from vbaa_calib.simulate.plan import AntennaShot, BoardShot
from vbaa_calib.simulate.render.board import Sheet, outline
from vbaa_calib.simulate.render.meshes import Triangles, object_mesh, tube_mesh
from vbaa_calib.simulate.render.object import pressed_in
from vbaa_calib.simulate.render.picture import Studio, blurred, digitise
from vbaa_calib.simulate.render.settings import PAINT
from vbaa_calib.simulate.scene.lens import RayMap
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Joints, SceneSpec, Stretch
from vbaa_calib.simulate.shots import Strand, free_wires, wires_of


class TracedPictures:
    """Takes path-traced pictures of a scene. Raises InputError where mitsuba is not installed."""

    def __init__(self, scene: SceneSpec, place: Studio, sheet: Sheet, rng: np.random.Generator) -> None:
        self._scene, self._place, self._sheet = scene, place, sheet
        self._tracer = _tracer(scene, place.rays, rng)

    def shot(self, shot: BoardShot | AntennaShot, after: AntennaShot | None, rng: np.random.Generator) -> np.ndarray:
        """(height, width) or (height, width, 3) BGR, uint8. after : the next frame, for motion blur."""
        scene, T_world_camera = self._scene, self._scene.T_world_camera(shot.joints)
        if isinstance(shot, BoardShot):
            return self._with_board(shot.joints, T_world_camera @ shot.T_camera_board, [], rng)
        things = {}
        if shot.indentation_m is not None:
            things["object"] = self._tracer.touched(pressed_in(scene.object, shot.indentation_m))
        moves = after is not None and scene.traced.shutter > 0
        instants = _while_open(shot, after, scene.traced.shutter) if after is not None and moves else [shot]
        exposures = [self._exposure(one.joints, wires_of(scene, one.arclength_m, one.points_m)) for one in instants]
        return self._taken(self._tracer, exposures, things, rng)

    def over(self, rng: np.random.Generator) -> np.ndarray:
        """The picture of the free antenna over the board that lies under it."""
        over = self._scene.over
        assert over is not None
        T_world_board = self._scene.T_world_antenna(over.joints) @ over.T_antenna_board(self._sheet.spec)
        return self._with_board(over.joints, T_world_board, free_wires(self._scene, over.joints), rng)

    def _with_board(
        self, joints: Joints, T_world_board: Pose, wires: list[Strand], rng: np.random.Generator
    ) -> np.ndarray:
        # rig and board are lifted until nothing on the bench reaches through the board
        raised = self._tracer.raised_above(T_world_board @ outline(self._sheet))
        return self._taken(
            raised, [self._exposure(joints, wires)], {"board": raised.board(self._sheet, T_world_board)}, rng
        )

    def _exposure(self, joints: Joints, wires: list[Strand]) -> Exposure:
        scene = self._scene
        drawn = [tube for antenna in wires[:1] for tube in _antenna_tubes(scene, antenna)]
        drawn += [(one.arclength_m, one.points_m, one.radius_m, _matt(_rgb(one.paint))) for one in wires[1:]]
        return Exposure(scene.T_world_camera(joints), scene.T_world_antenna(joints), drawn)

    def _taken(
        self, from_: _Tracer, exposures: list[Exposure], things: dict[str, Any], rng: np.random.Generator
    ) -> np.ndarray:
        spec, light = self._place.spec, self._place.light
        linear = from_.picture(exposures, things, int(rng.integers(2**31)))
        # red, green and blue in grey, as BT.601 weighs them
        grey = np.array([0.299, 0.587, 0.114], np.float32)
        linear, light = (linear[..., ::-1], light[..., None]) if self._scene.traced.color else (linear @ grey, light)
        return digitise(spec, 255.0 * blurred(np.ascontiguousarray(linear), spec.blur_px) * light, rng)


def _antenna_tubes(scene: SceneSpec, antenna: Strand) -> Iterator[_SurfacedTube]:
    """The antenna as a sequence of tubes, each with its own surface."""
    spec, first, last = scene.traced, antenna.arclength_m[0], antenna.arclength_m[-1]
    looks: list[Stretch] = [(first, last, spec.material, spec.colour, 0.0), *spec.stretches]
    bounds = np.unique(np.clip([bound for one in looks for bound in one[:2]], first, last))
    for part, middle in zip(antenna.cut(bounds), (bounds[1:] + bounds[:-1]) / 2, strict=True):
        _, _, material, colour, thickness_m = [one for one in looks if one[0] <= middle <= one[1]][-1]
        surface = _antenna_surface(material, colour or 3 * (scene.picture.antenna,))
        if surface is not None:
            yield part.arclength_m, part.points_m, part.radius_m + thickness_m, surface


def _while_open(shot: AntennaShot, after: AntennaShot, shutter: float) -> list[AntennaShot]:
    """The antenna at instants while the shutter is open, centred on the shot and moving towards the next frame."""
    ahead, _ = core.simulate.spline(after.arclength_m, after.points_m, shot.arclength_m)
    turn = np.subtract(*(np.array([at.pan_rad, at.tilt_rad]) for at in (after.joints, shot.joints)))
    shares = shutter * ((np.arange(5) + 0.5) / 5 - 0.5)
    return [
        replace(
            shot,
            joints=Joints(*(np.array([shot.joints.pan_rad, shot.joints.tilt_rad]) + share * turn)),
            points_m=shot.points_m + share * (ahead - shot.points_m),
        )
        for share in shares
    ]


_MM = 1000.0


@cache
def _load_mitsuba() -> Any:
    """The mitsuba module, set to its fastest variant. Raises InputError if it is not installed."""
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


_SurfacedTube = tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]
"""Arc lengths, points (antenna frame), radii, all in metres, and the surface of a tube."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """The rig at one instant of the exposure. wires : the antenna and its holder."""

    T_world_camera: Pose
    T_world_antenna: Pose
    wires: Sequence[_SurfacedTube] = ()


@dataclass(frozen=True, eq=False)
class _Tracer:
    """What all traced pictures of a scene share: mitsuba, the lens, the surroundings, the radiance of a white card."""

    mi: Any
    scene: SceneSpec
    rays: RayMap
    around: dict[str, Any]
    card: float
    lift_m: float = 0.0

    def picture(self, exposures: Sequence[Exposure], things: dict[str, Any], seed: int) -> np.ndarray:
        """(height, width, 3) float32 linear red, green, blue: the mean over the exposures."""
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
        """Points (..., 3) in mitsuba's coordinates, mm."""
        return _MM * (points_world_m - _origin(self.scene) + np.array([0.0, 0.0, self.lift_m]))

    def raised_above(self, points_world_m: np.ndarray) -> _Tracer:
        """The tracer with the rig lifted until points (N, 3) are above everything on the bench."""
        needed = TRACE.clear_m - self.scene.traced.bench_below_m + _origin(self.scene)[2] - points_world_m[:, 2].min()
        return replace(self, lift_m=max(float(needed), 0.0))

    def touched(self, obj: TouchObject) -> Any:
        """The touched object as a mitsuba mesh."""
        shape = object_mesh(obj)
        look = _matt(_rgb(self.scene.picture.object))
        return _mesh(self.mi, Triangles(self.at(shape.vertices), shape.normals, shape.faces), look)

    def board(self, sheet: Sheet, T_world_board: Pose) -> Any:
        """The printed sheet as a mitsuba mesh."""
        rows, columns = sheet.paper.shape
        corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]]) / sheet.texels_per_m - sheet.margin_m
        vertices = self.at(T_world_board @ np.pad(corners, ((0, 0), (0, 1))))
        normals = np.tile(-T_world_board.rotation[:, 2], (4, 1))
        faces, uv = np.array([[0, 2, 1], [0, 3, 2]]), np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        print_ = np.repeat(np.where(sheet.paper, PAINT.paper, PAINT.ink)[..., None], 3, axis=2)
        return _mesh(self.mi, Triangles(vertices, normals, faces), _matt(_picture_of(print_)), uv)

    def _sensor(self, one: Exposure) -> dict[str, Any]:
        focal, (width, height) = _pinhole(self.rays)
        spec, camera = self.scene.traced, one.T_world_camera
        # mitsuba's camera: x left, y up, z forward
        turned = _placed(self.at(camera.translation_m), camera.rotation @ np.diag([-1.0, -1.0, 1.0]))
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


def _tracer(scene: SceneSpec, rays: RayMap, rng: np.random.Generator) -> _Tracer:
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
    things = _lights(spec.light) | _bench(spec.bench, spec.bench_roughness, middle[:2], along, rng)
    around = {name: _loaded(mi, thing, below) for name, thing in things.items()}
    lit = {name: thing for name, thing in around.items() if name in _lights(spec.light)}
    return _Tracer(mi, scene, rays, around, _card(mi, lit, middle))


def _origin(scene: SceneSpec) -> np.ndarray:
    return scene.kinematics.position_world_m


def _card(mi: Any, lit: dict[str, Any], middle: np.ndarray) -> float:
    """Radiance of a white card at the antenna's place."""
    white = _matt(_rgb(1.0))
    card = {"type": "rectangle", "to_world": _placed(middle, scale=(5.0, 5.0, 1.0)), "bsdf": white}
    eye = middle + np.array([0.0, 0.0, 60.0])
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sensor = {"type": "perspective", "fov": 4.0, "to_world": _placed(eye, _facing(eye, middle)), "film": film}
    return float(_render(mi, lit | {"card": card}, sensor, 256, 0).mean())


def _mesh(mi: Any, shape: Triangles, look: dict[str, Any], uv: np.ndarray | None = None) -> Any:
    """A mitsuba mesh of triangles with a material."""
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
    """A mitsuba object of the bench, moved by `shift`."""
    if isinstance(thing, tuple):
        shape, look = thing
        return _mesh(mi, Triangles(shape.vertices + shift, shape.normals, shape.faces), look)
    if "to_world" in thing:
        thing = thing | {"to_world": _placed(shift) @ thing["to_world"]}
    return mi.load_dict(_native(mi, thing))


def _native(mi: Any, thing: Any) -> Any:
    """A dictionary with its arrays converted to mitsuba's types."""
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
    """Focal length and size, px, of a centred pinhole picture that contains all of the lens's rays."""
    focal = TRACE.finer * float(np.diag(rays.lens.matrix)[:2].mean())
    width, height = 2 * np.ceil(focal * np.abs(rays.padded).max(axis=(0, 1))).astype(int) + 4
    return focal, (int(width), int(height))


def _through_lens(rays: RayMap, pinhole: tuple[float, tuple[int, int]], fine: np.ndarray) -> np.ndarray:
    """(height, width, 3) the pinhole picture resampled through the lens: the mean over each of its pixels."""
    focal, size = pinhole
    width, height = rays.lens.image_size
    where = rays.block(0, 0, width, height, TRACE.subpixels) * np.float32(focal) + np.float32(np.array(size) / 2 - 0.5)
    samples = cv2.remap(fine, where.astype(np.float32), np.empty(0), cv2.INTER_LINEAR)
    return cv2.resize(samples, (width, height), interpolation=cv2.INTER_AREA)


_Thing = dict[str, Any]
_Solid = _Thing | tuple[Triangles, _Thing]
"""One of mitsuba's own shapes, or triangles and their surface."""


@dataclass(frozen=True)
class _TraceSettings:
    """How mitsuba traces a picture. Its lengths are mm."""

    finer: float = 2.0  # pixels of mitsuba's picture per pixel of ours, in the middle of it
    subpixels: int = 4  # samples per pixel and axis when the lens is applied
    widest: float = 3.0  # largest tangent of the angle of view
    full_well: float = 2.0  # brightness at which a pixel saturates
    clear_m: float = 0.05  # height above everything on the bench
    depth: int = 4  # longest path of light, in reflections
    texels: int = 2048  # of the bench's texture, a side
    textured_mm: float = 800.0  # side of the part of the bench with texture
    bench_mm: float = 4000.0  # side of the bench


TRACE = _TraceSettings()


def _rgb(*value: float) -> _Thing:
    """A mitsuba colour; from a single number a grey."""
    return {"type": "rgb", "value": list(value) if len(value) == 3 else 3 * [float(value[0])]}


def _placed(middle: Any, turn: np.ndarray | None = None, scale: Any = (1.0, 1.0, 1.0)) -> np.ndarray:
    """(4, 4) transform: scale, then rotation (3, 3), then translation."""
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if turn is None else turn) @ np.diag(np.asarray(scale, float))
    matrix[:3, 3] = middle
    return matrix


def _facing(middle: Any, target: Any) -> np.ndarray:
    """(3, 3) rotation with its z axis from `middle` to `target`."""
    z = np.asarray(target, float) - np.asarray(middle, float)
    z /= np.linalg.norm(z)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _matt(colour: _Thing) -> _Thing:
    """A diffuse surface with a colour or a texture."""
    return {"type": "diffuse", "reflectance": colour}


def _picture_of(texture: np.ndarray) -> _Thing:
    """A mitsuba texture from linear brightness (rows, columns, 3)."""
    return {"type": "bitmap", "data": texture.astype(np.float32), "raw": True, "wrap_mode": "mirror"}


# --- antenna


def _antenna_surface(material: str, paint: Sequence[float]) -> _Thing | None:
    """The antenna's material with the reflectance of its paint; None: a stretch that is not there."""
    if material == "none":
        return None
    metal = {"type": "roughconductor", "material": "Cr", "distribution": "ggx"}
    if material == "steel":
        return metal | {"alpha": 0.16}
    if material == "nitinol":
        # a dark oxide over a duller metal
        oxide = _matt(_rgb(0.07, 0.06, 0.055))
        dull = metal | {"alpha": 0.28, "specular_reflectance": _rgb(0.62, 0.57, 0.52)}
        return {"type": "blendbsdf", "weight": 0.4, "a": dull, "b": oxide}
    if material == "nylon":
        # milky: most of the light passes, some is scattered where it enters
        clear = {"type": "roughdielectric", "alpha": 0.08, "int_ior": 1.53, "ext_ior": 1.0}
        return {"type": "blendbsdf", "weight": 0.3, "a": clear, "b": _matt(_rgb(0.8))}
    if material == "clear":
        # a fishing line: it shows what lies behind, bent, and highlights
        return {"type": "roughdielectric", "alpha": 0.03, "int_ior": 1.53, "ext_ior": 1.0}
    if material == "rubber":
        return {"type": "roughplastic", "alpha": 0.4, "diffuse_reflectance": _rgb(0.025)}
    return {"type": "roughplastic", "alpha": 0.2, "diffuse_reflectance": _rgb(*paint)}


# --- light


def _lights(kind: str) -> dict[str, _Thing]:
    """Lights of one kind: soft boxes, one small lamp from above or low from the side, or a room with a window."""

    def panel(middle: tuple[float, float, float], half: tuple[float, float], radiance: float) -> _Thing:
        matrix = _placed(middle, _facing(middle, (60.0, 0.0, 150.0)), (*half, 1.0))
        return {"type": "rectangle", "to_world": matrix, "emitter": {"type": "area", "radiance": _rgb(radiance)}}

    def room(radiance: float) -> _Thing:
        return {"type": "constant", "radiance": _rgb(radiance)}

    if kind == "lamp":
        return {"lamp": panel((-220.0, 330.0, 650.0), (25.0, 25.0), 200.0), "room": room(0.25)}
    if kind == "side":
        return {"lamp": panel((90.0, 420.0, 560.0), (14.0, 14.0), 640.0), "room": room(0.15)}
    if kind == "daylight":
        return {"window": panel((200.0, 1400.0, 900.0), (600.0, 450.0), 6.0), "room": room(0.8)}
    left, right = (-320.0, 420.0, 700.0), (380.0, -460.0, 620.0)
    return {"left": panel(left, (150.0, 150.0), 10.0), "right": panel(right, (110.0, 150.0), 7.0), "room": room(0.12)}


# --- bench


def _bench(
    kind: str, roughness: float | None, middle: np.ndarray, along: float, rng: np.random.Generator
) -> dict[str, _Solid]:
    """The bench and the things on it: diffuse, which is quick to trace, except metal.

    roughness : of a gloss on the bench itself; None: none. middle : (2,) under the middle of the antenna.
    along : direction of the antenna at rest, rad from x.
    """

    def finish(colour: _Thing) -> _Thing:
        if roughness is None:
            return _matt(colour)
        return {"type": "roughplastic", "alpha": roughness, "diffuse_reflectance": colour}

    turn = Rotation.from_euler("z", along + rng.uniform(-0.6, 0.6)).as_matrix()
    top = _placed([*middle, 0.0], turn, (TRACE.textured_mm / 2, TRACE.textured_mm / 2, 1.0))
    texture = {"wood": _wood, "cloth": _cloth, "patchwork": _patchwork}.get(kind, _plain)(rng)
    things: dict[str, _Solid] = {
        "top": {"type": "rectangle", "to_world": top, "bsdf": finish(_picture_of(texture))},
        "around": {
            "type": "rectangle",
            "to_world": _placed([*middle, -1.0], scale=(TRACE.bench_mm / 2, TRACE.bench_mm / 2, 1.0)),
            "bsdf": finish(_rgb(*texture.mean(axis=(0, 1)))),
        },
    }
    if kind == "cluttered":
        for number, thing in enumerate(_clutter(middle, along, rng)):
            things[f"thing_{number}"] = thing
    return things


def _colour(rng: np.random.Generator) -> _Thing:
    return _rgb(*np.clip(rng.uniform(0.05, 0.85) * rng.uniform(0.4, 1.2, 3), 0.02, 0.9))


def _box(middle: Any, size: Any, angle: float, surface: _Thing) -> _Thing:
    turn = Rotation.from_euler("z", angle).as_matrix()
    return {"type": "cube", "to_world": _placed(middle, turn, np.asarray(size) / 2), "bsdf": surface}


def _clutter(middle: np.ndarray, along: float, rng: np.random.Generator) -> list[_Solid]:
    """Boxes, circuit boards, tools, cables; some of the long thin ones are parallel to the antenna."""
    metal = {"type": "roughconductor", "material": "Cr", "alpha": 0.2}
    things: list[_Solid] = []

    def spot(reach: float = 190.0) -> np.ndarray:
        return middle + rng.uniform(-reach, reach, 2)

    for _ in range(9):
        size = rng.uniform((15, 15, 5), (90, 70, 40))
        things.append(_box([*spot(), size[2] / 2], size, rng.uniform(0, np.pi), _matt(_colour(rng))))
    for _ in range(4):
        at, angle = spot(140.0), rng.uniform(0, np.pi)
        turn = Rotation.from_euler("z", angle).as_matrix()[:2, :2]
        things.append(_box([*at, 4.0], (90, 60, 1.6), angle, _matt(_rgb(0.03, rng.uniform(0.15, 0.3), 0.07))))
        for _ in range(12):
            chip = at + turn @ rng.uniform((-38, -24), (38, 24))
            look = metal if rng.uniform() < 0.3 else _matt(_rgb(rng.choice([0.03, 0.6])))
            things.append(_box([*chip, 5.8], (*rng.uniform(2, 14, 2), 2.0), angle, look))
    for look, thick in ((metal, 6.0), (metal, 1.0), (_matt(_colour(rng)), 2.0)):
        # a rod, a steel rule, a stick, within 15° of the antenna
        long = (rng.uniform(120, 220), 25.0 if thick == 1.0 else thick, thick)
        things.append(_box([*spot(70.0), thick / 2 + 8.0], long, along + rng.uniform(-0.26, 0.26), look))
    for number in range(5):
        angle = along + (rng.uniform(-0.2, 0.2) if number < 3 else rng.uniform(-1.5, 1.5))
        radius = float(rng.choice([0.4, 0.8, 1.5, 2.5]))
        t = np.linspace(-1.0, 1.0, 40)
        sway = rng.normal(0.0, 9.0) * np.sin(t * rng.uniform(1, 4) + rng.uniform(0, 6))
        path = np.stack([260.0 * t, sway, np.full(40, 12.0 + radius)], axis=1)
        path = path @ Rotation.from_euler("z", angle).as_matrix().T
        path[:, :2] += spot(70.0)
        look = metal if rng.uniform() < 0.3 else _matt(_colour(rng))
        things.append((tube_mesh(t * 260.0, path, radius, 4.0), look))
    return things


def _noise(rng: np.random.Generator, columns: int, rows: int) -> np.ndarray:
    """(texels, texels) smooth random values of standard deviation about 1, with `columns` × `rows` hills."""
    coarse = rng.standard_normal((rows, columns)).astype(np.float32)
    return cv2.resize(coarse, (TRACE.texels, TRACE.texels), interpolation=cv2.INTER_CUBIC)


def _coloured(grey: np.ndarray, colour: Any) -> np.ndarray:
    return np.clip(grey[..., None] * np.asarray(colour), 0.01, 0.95)


def _plain(rng: np.random.Generator) -> np.ndarray:
    grain = 0.04 * _noise(rng, 30, 30) + 0.03 * _noise(rng, TRACE.texels // 2, TRACE.texels // 2)
    return _coloured(0.3 * (1.0 + grain), (0.97, 1.0, 1.04))


def _wood(rng: np.random.Generator) -> np.ndarray:
    grain = 0.5 * _noise(rng, 6, 400) + 0.3 * _noise(rng, 20, 900)
    rings = np.sin(2 * np.pi * (14 * np.linspace(0, 1, TRACE.texels)[:, None] + 0.9 * _noise(rng, 4, 7)))
    return _coloured(0.5 * (1.0 + 0.14 * rings + 0.2 * grain), (1.0, 0.72, 0.45))


def _cloth(rng: np.random.Generator) -> np.ndarray:
    x = np.arange(TRACE.texels)
    weave = 0.25 * np.sign(np.sin(x / 2.5))[:, None] * np.sign(np.sin(x / 2.5))
    stripes = np.where((x // 60) % 4 == 0, 1.7, 1.0) * np.where((x // 45) % 5 == 1, 0.5, 1.0)[:, None]
    return _coloured(0.28 * stripes * (1.0 + weave + 0.15 * _noise(rng, 300, 300)), (0.6, 0.8, 1.1))


def _patchwork(rng: np.random.Generator) -> np.ndarray:
    cells = cv2.resize(
        rng.uniform(0.15, 0.95, (40, 40, 3)).astype(np.float32),
        (TRACE.texels, TRACE.texels),
        interpolation=cv2.INTER_NEAREST,
    )
    return np.clip(cells * (1.0 + 0.08 * _noise(rng, 500, 500))[..., None], 0.02, 0.95)
