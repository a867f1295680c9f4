"""The rig's surroundings: bench, clutter and lights, as mitsuba's dictionaries. Millimetres, the bench is z = 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.simulate.render.meshes import Triangles, tube_mesh

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


def rgb(*value: float) -> _Thing:
    """A colour; of one number a grey."""
    return {"type": "rgb", "value": list(value) if len(value) == 3 else 3 * [float(value[0])]}


def placed(middle: Any, turn: np.ndarray | None = None, scale: Any = (1.0, 1.0, 1.0)) -> np.ndarray:
    """(4, 4) scale, then turn (3, 3), then shift."""
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if turn is None else turn) @ np.diag(np.asarray(scale, float))
    matrix[:3, 3] = middle
    return matrix


def facing(middle: Any, target: Any) -> np.ndarray:
    """(3, 3) rotation with z from `middle` to `target`."""
    z = np.asarray(target, float) - np.asarray(middle, float)
    z /= np.linalg.norm(z)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def matt(colour: _Thing) -> _Thing:
    """A surface without gloss: a colour or a texture."""
    return {"type": "diffuse", "reflectance": colour}


def picture_of(texture: np.ndarray) -> _Thing:
    """A texture (rows, columns, 3) of linear brightness."""
    return {"type": "bitmap", "data": texture.astype(np.float32), "raw": True, "wrap_mode": "mirror"}


# --- antenna


def antenna_surface(material: str, paint: Sequence[float]) -> _Thing | None:
    """What the antenna is made of, with the reflectance of its paint; None: it is not there."""
    if material == "none":
        return None
    metal = {"type": "roughconductor", "material": "Cr", "distribution": "ggx"}
    if material == "steel":
        return metal | {"alpha": 0.16}
    if material == "nitinol":
        # a dark oxide over a duller metal
        oxide = matt(rgb(0.07, 0.06, 0.055))
        dull = metal | {"alpha": 0.28, "specular_reflectance": rgb(0.62, 0.57, 0.52)}
        return {"type": "blendbsdf", "weight": 0.4, "a": dull, "b": oxide}
    if material == "nylon":
        # milky: most of the light passes, some is scattered where it enters
        clear = {"type": "roughdielectric", "alpha": 0.08, "int_ior": 1.53, "ext_ior": 1.0}
        return {"type": "blendbsdf", "weight": 0.3, "a": clear, "b": matt(rgb(0.8))}
    if material == "clear":
        # a fishing line: it shows what lies behind, bent, and highlights
        return {"type": "roughdielectric", "alpha": 0.03, "int_ior": 1.53, "ext_ior": 1.0}
    if material == "rubber":
        return {"type": "roughplastic", "alpha": 0.4, "diffuse_reflectance": rgb(0.025)}
    return {"type": "roughplastic", "alpha": 0.2, "diffuse_reflectance": rgb(*paint)}


# --- light


def lights(kind: str) -> dict[str, _Thing]:
    """Soft boxes, one small lamp from above or low from the side, or a room with a window."""

    def panel(middle: tuple[float, float, float], half: tuple[float, float], radiance: float) -> _Thing:
        matrix = placed(middle, facing(middle, (60.0, 0.0, 150.0)), (*half, 1.0))
        return {"type": "rectangle", "to_world": matrix, "emitter": {"type": "area", "radiance": rgb(radiance)}}

    def room(radiance: float) -> _Thing:
        return {"type": "constant", "radiance": rgb(radiance)}

    if kind == "lamp":
        return {"lamp": panel((-220.0, 330.0, 650.0), (25.0, 25.0), 200.0), "room": room(0.25)}
    if kind == "side":
        return {"lamp": panel((90.0, 420.0, 560.0), (14.0, 14.0), 640.0), "room": room(0.15)}
    if kind == "daylight":
        return {"window": panel((200.0, 1400.0, 900.0), (600.0, 450.0), 6.0), "room": room(0.8)}
    left, right = (-320.0, 420.0, 700.0), (380.0, -460.0, 620.0)
    return {"left": panel(left, (150.0, 150.0), 10.0), "right": panel(right, (110.0, 150.0), 7.0), "room": room(0.12)}


# --- bench


def bench(
    kind: str, roughness: float | None, middle: np.ndarray, along: float, rng: np.random.Generator
) -> dict[str, _Solid]:
    """The bench and what lies on it: matt, which is quick to trace, but for metal.

    roughness : of a gloss on the bench itself; None: none. middle : (2,) under the middle of the antenna.
    along : direction of the antenna at rest, rad from x.
    """

    def finish(colour: _Thing) -> _Thing:
        if roughness is None:
            return matt(colour)
        return {"type": "roughplastic", "alpha": roughness, "diffuse_reflectance": colour}

    turn = Rotation.from_euler("z", along + rng.uniform(-0.6, 0.6)).as_matrix()
    top = placed([*middle, 0.0], turn, (TRACE.textured_mm / 2, TRACE.textured_mm / 2, 1.0))
    texture = {"wood": _wood, "cloth": _cloth, "patchwork": _patchwork}.get(kind, _plain)(rng)
    things: dict[str, _Solid] = {
        "top": {"type": "rectangle", "to_world": top, "bsdf": finish(picture_of(texture))},
        "around": {
            "type": "rectangle",
            "to_world": placed([*middle, -1.0], scale=(TRACE.bench_mm / 2, TRACE.bench_mm / 2, 1.0)),
            "bsdf": finish(rgb(*texture.mean(axis=(0, 1)))),
        },
    }
    if kind == "cluttered":
        for number, thing in enumerate(_clutter(middle, along, rng)):
            things[f"thing_{number}"] = thing
    return things


def _colour(rng: np.random.Generator) -> _Thing:
    return rgb(*np.clip(rng.uniform(0.05, 0.85) * rng.uniform(0.4, 1.2, 3), 0.02, 0.9))


def _box(middle: Any, size: Any, angle: float, surface: _Thing) -> _Thing:
    turn = Rotation.from_euler("z", angle).as_matrix()
    return {"type": "cube", "to_world": placed(middle, turn, np.asarray(size) / 2), "bsdf": surface}


def _clutter(middle: np.ndarray, along: float, rng: np.random.Generator) -> list[_Solid]:
    """Boxes, circuit boards, tools, cables: some of the long thin ones run with the antenna."""
    metal = {"type": "roughconductor", "material": "Cr", "alpha": 0.2}
    things: list[_Solid] = []

    def spot(reach: float = 190.0) -> np.ndarray:
        return middle + rng.uniform(-reach, reach, 2)

    for _ in range(9):
        size = rng.uniform((15, 15, 5), (90, 70, 40))
        things.append(_box([*spot(), size[2] / 2], size, rng.uniform(0, np.pi), matt(_colour(rng))))
    for _ in range(4):
        at, angle = spot(140.0), rng.uniform(0, np.pi)
        turn = Rotation.from_euler("z", angle).as_matrix()[:2, :2]
        things.append(_box([*at, 4.0], (90, 60, 1.6), angle, matt(rgb(0.03, rng.uniform(0.15, 0.3), 0.07))))
        for _ in range(12):
            chip = at + turn @ rng.uniform((-38, -24), (38, 24))
            look = metal if rng.uniform() < 0.3 else matt(rgb(rng.choice([0.03, 0.6])))
            things.append(_box([*chip, 5.8], (*rng.uniform(2, 14, 2), 2.0), angle, look))
    for look, thick in ((metal, 6.0), (metal, 1.0), (matt(_colour(rng)), 2.0)):
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
        look = metal if rng.uniform() < 0.3 else matt(_colour(rng))
        things.append((tube_mesh(t * 260.0, path, radius, 4.0), look))
    return things


def _noise(rng: np.random.Generator, columns: int, rows: int) -> np.ndarray:
    """(texels, texels) smooth random values of standard deviation about 1, so many hills across and down."""
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
