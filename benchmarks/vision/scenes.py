"""Pictures of antennas under every hardship, with the truth beside them; drawn by the simulator's pieces alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

import cv2
import numpy as np
from scipy.spatial import cKDTree

from vbaa_calib.simulate.render.antenna import Tube, tube_patches
from vbaa_calib.simulate.render.picture import ImagePatch, Studio, digitise, expose
from vbaa_calib.simulate.scene.lens import Lens, RayMap
from vbaa_calib.simulate.scene.scene import PictureSpec

STEP_PX = 0.4
"""Spacing of a path's points."""


@dataclass(frozen=True)
class Bend:
    """How an antenna lies in the picture.

    clamp_px : (u, v) of the clamp.
    heading_rad : direction at the clamp, from u towards v.
    length_px : of the whole antenna.
    turn_rad : by how much its direction changes in all.
    contact : where the force acts, as a fraction of the length.
    force_angle_rad : angle of the force to the clamp's normal.
    sag : bow of the free antenna, its sagitta as a fraction of the length.
    shorter : foreshortening along the heading by leaving the plane, 1 for none.
    """

    clamp_px: tuple[float, float]
    heading_rad: float
    length_px: float
    turn_rad: float = 0.0
    contact: float = 0.7
    force_angle_rad: float = 0.0
    sag: float = 0.0
    shorter: float = 1.0


def _cantilever(turn_rad: float, contact: float, force_angle_rad: float, count: int) -> np.ndarray:
    """(count,) direction along a cantilever of length one: an elastica whose moment is force times lever arm."""
    share = np.linspace(0.0, 1.0, count)
    touched = share <= contact
    heading = turn_rad * np.where(touched, 1.0 - (1.0 - share / contact) ** 2, 1.0)
    force = np.array([-np.sin(force_angle_rad), np.cos(force_angle_rad)])
    for _ in range(25):
        points = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0) / count
        arm = points[touched][-1] - points
        curvature = np.where(touched, np.maximum(arm @ np.array([force[1], -force[0]]), 0.0), 0.0)
        turned = np.cumsum(curvature)
        heading = 0.5 * heading + 0.5 * turn_rad * turned / max(turned[-1], 1e-12)
    return heading


def path_px(bend: Bend) -> np.ndarray:
    """(K, 2) the antenna from clamp to tip, a point every `STEP_PX`."""
    count = max(int(bend.length_px / STEP_PX), 20)
    share = np.linspace(0.0, 1.0, count)
    heading = _cantilever(bend.turn_rad, bend.contact, bend.force_angle_rad, count) + 4.0 * bend.sag * share
    step = bend.length_px / (count - 1) * np.stack([bend.shorter * np.cos(heading), np.sin(heading)], axis=1)
    local = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    cos, sin = np.cos(bend.heading_rad), np.sin(bend.heading_rad)
    return np.array(bend.clamp_px) + local @ np.array([[cos, sin], [-sin, cos]])


def normals(path: np.ndarray) -> np.ndarray:
    """(K, 2) unit normals of a dense path."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def aside_px(path: np.ndarray, points_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) signed distance of points from a dense path, and the index (N,) of the nearest point of the path."""
    nearest = cKDTree(path).query(points_px)[1] if len(points_px) else np.empty(0, int)
    offset = points_px - path[nearest]
    across = normals(path)[nearest]
    signed = (offset * across).sum(axis=1)
    past = np.abs((offset * across[:, ::-1] * [1.0, -1.0]).sum(axis=1)) > 2.0
    # beyond an end of the path the distance across means nothing
    return np.where(past, np.hypot(*offset.T), signed), nearest


PLAIN = PictureSpec(
    blur_px=0.8,
    read_noise=1.2,
    electrons_per_grey=40.0,
    vignette=0.0,
    gradient=0.0,
    background=0.2,
    clutter=0.0,
    antenna=0.8,
    object=0.4,
    shading_asymmetry=0.0,
)
"""A good picture: bright on dark, in focus, even light."""


@dataclass(frozen=True)
class Block:
    """A rectangle that hides what is behind it: middle and half sides in px, its turn, its brightness."""

    middle_px: tuple[float, float]
    half_px: tuple[float, float]
    turn_rad: float
    brightness: float

    def holds(self, points_px: np.ndarray) -> np.ndarray:
        """Whether points (..., 2) are behind it."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        local = (points_px - np.array(self.middle_px)) @ np.array([[cos, -sin], [sin, cos]])
        return (np.abs(local) <= np.array(self.half_px)).all(axis=-1)


@dataclass(frozen=True)
class Twin:
    """A shadow (strength below zero) or reflection beside the antenna: its shift and turn about the clamp."""

    aside_px: float
    turn_rad: float
    strength: float
    blur_px: float


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture to be drawn.

    size : (width, height), px.
    bend, width_px : the antenna; `bend` None draws none.
    clutter : (height, width) brightness of what lies behind, or None for a plain background.
    blocks, twins : what hides it, what runs beside it.
    glint : brightness of a highlight along it, and how far off the middle, as a fraction of the half width.
    smear_px : (u, v) of the motion during the exposure.
    defocus_px : radius of the disc of confusion.
    dark : the negative: dark antenna on light ground.
    """

    size: tuple[int, int]
    bend: Bend | None
    width_px: float
    spec: PictureSpec = PLAIN
    clutter: np.ndarray | None = None
    blocks: tuple[Block, ...] = ()
    twins: tuple[Twin, ...] = ()
    glint: tuple[float, float] = (0.0, 0.0)
    smear_px: tuple[float, float] = (0.0, 0.0)
    defocus_px: float = 0.0
    dark: bool = False


@dataclass(frozen=True, eq=False)
class Truth:
    """What a drawn picture shows: the path (K, 2) from clamp to tip, and where (K,) it is inside and not hidden."""

    path_px: np.ndarray
    visible: np.ndarray = field(repr=False)


def truth(shot: Shot) -> Truth:
    """Where the antenna of a shot is."""
    path = np.empty((0, 2)) if shot.bend is None else path_px(shot.bend)
    outside = np.any((path < 0) | (path > np.array(shot.size) - 1), axis=1)
    return Truth(path, ~np.any([outside, *(block.holds(path) for block in shot.blocks)], axis=0))


def light(shot: Shot, aside_px: float = 0.0, antenna: bool = True) -> np.ndarray:
    """(H, W) grey levels without noise; `aside_px` moves the antenna along its normal, `antenna` leaves it out."""
    place = bare_studio(Lens("opencv", shot.size, np.eye(3), np.zeros(0)), shot.spec)
    canvas = np.full(shot.size[::-1], shot.spec.background, np.float32) if shot.clutter is None else shot.clutter
    path = None if shot.bend is None else path_px(shot.bend)
    if path is not None:
        for twin in shot.twins:
            canvas = _with_twin(canvas, shot, path, twin)
    for block in shot.blocks:
        canvas = _with_block(canvas, block)
    seen = _antenna_patches(place, shot, path + aside_px * normals(path)) if antenna and path is not None else []
    grey = expose(place, canvas, seen)
    grey = _smeared(grey, shot.smear_px) if any(shot.smear_px) else grey
    grey = _defocused(grey, shot.defocus_px) if shot.defocus_px > 0 else grey
    return 255.0 - grey if shot.dark else grey


def photograph(shot: Shot, rng: np.random.Generator) -> np.ndarray:
    """(H, W) uint8 with noise."""
    return digitise(shot.spec, light(shot), rng)


def variance(spec: PictureSpec, grey: np.ndarray) -> np.ndarray:
    """(H, W) variance of every pixel: shot noise, read noise and rounding."""
    return np.maximum(grey, 0.0) / spec.electrons_per_grey + spec.read_noise**2 + 1.0 / 12.0


def bare_studio(lens: Lens, spec: PictureSpec) -> Studio:
    """Light without surroundings or a bench: nothing lies behind."""
    width, height = lens.image_size
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, width), np.linspace(-1.0, 1.0, height))
    level = (1.0 - spec.vignette * (u**2 + v**2) / 2) * (1.0 - spec.gradient * (0.5 + 0.35 * u - 0.15 * v))
    return Studio(spec, RayMap(lens, np.empty((0, 0, 2))), level.astype(np.float32), np.empty((0, 0), np.float32))


def _antenna_patches(place: Studio, shot: Shot, path: np.ndarray) -> list[ImagePatch]:
    def obstacle(points: np.ndarray) -> np.ndarray:
        return np.where(np.any([block.holds(points) for block in shot.blocks], axis=0), 0.0, np.inf)

    def drawn(line: np.ndarray, half_px: float, brightness: float, asymmetry: float = 0.0) -> list[ImagePatch]:
        across, ones = normals(line), np.ones(len(line))
        tube = Tube(line, across[:, ::-1] * [1.0, -1.0], across, half_px * ones, ones, ones)
        return tube_patches(place, tube, brightness, asymmetry, obstacle if shot.blocks else None)

    half, (glint, aside) = 0.5 * shot.width_px, shot.glint
    body = drawn(path, half, shot.spec.antenna, shot.spec.shading_asymmetry)
    spark = drawn(path + aside * half * normals(path), 0.3 * half, glint) if glint > 0 else []
    # the glint is light that is added, whatever is behind it
    return body + [replace(patch, alpha=np.zeros_like(patch.alpha)) for patch in spark]


def _with_block(canvas: np.ndarray, block: Block) -> np.ndarray:
    pixels = np.stack(np.meshgrid(np.arange(canvas.shape[1]), np.arange(canvas.shape[0])), axis=-1)
    share = np.zeros(canvas.shape, np.float32)
    for shift in product((-1.0 / 3.0, 0.0, 1.0 / 3.0), repeat=2):
        share += block.holds(pixels + shift) / np.float32(9.0)
    return canvas * (1.0 - share) + np.float32(block.brightness) * share


def _with_twin(canvas: np.ndarray, shot: Shot, path: np.ndarray, twin: Twin) -> np.ndarray:
    cos, sin = np.cos(twin.turn_rad), np.sin(twin.turn_rad)
    moved = path[0] + (path - path[0]) @ np.array([[cos, sin], [-sin, cos]]) + twin.aside_px * normals(path)
    mask = np.zeros(canvas.shape, np.uint8)
    points = np.round(16 * moved[:: max(1, len(moved) // 200)]).astype(np.int32).reshape(-1, 1, 2)
    thickness = max(1, round(shot.width_px))
    cv2.polylines(mask, [points], False, 255, thickness, cv2.LINE_AA, 4)
    # its smooth edges make the line about a pixel broader than asked for
    level = min(shot.width_px / (thickness + 1.0), 1.0) / 255.0
    share = level * cv2.GaussianBlur(mask.astype(np.float32), (0, 0), max(twin.blur_px, 0.3))
    if twin.strength < 0:
        return canvas * (1.0 + np.float32(twin.strength) * share)
    return canvas + np.float32(twin.strength * shot.spec.antenna) * share


def _smeared(grey: np.ndarray, smear_px: tuple[float, float]) -> np.ndarray:
    """Motion at an even speed: the mean of shifted copies, as many to one side as to the other."""
    count, total = 2 * int(np.ceil(np.hypot(*smear_px))) + 1, np.zeros_like(grey)
    for share in np.linspace(-0.5, 0.5, count):
        shift = np.array([[1.0, 0.0, share * smear_px[0]], [0.0, 1.0, share * smear_px[1]]])
        total += cv2.warpAffine(grey, shift, grey.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return total / count


def _defocused(grey: np.ndarray, radius_px: float) -> np.ndarray:
    reach = int(np.ceil(radius_px)) + 1
    fine = (np.arange(9 * (2 * reach + 1)) + 0.5) / 9.0 - 0.5 - reach
    disc = (np.hypot(fine[:, None], fine[None]) <= radius_px).astype(np.float32)
    kernel = disc.reshape(2 * reach + 1, 9, 2 * reach + 1, 9).mean(axis=(1, 3))
    return cv2.filter2D(grey, cv2.CV_32F, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)


Rng = np.random.Generator
Size = tuple[int, int]


def good(rng: Rng, size: Size) -> Shot:
    """In focus, even light, plain background; any width from 2 to 8 px, any moderate bend."""
    length = rng.uniform(0.7, 0.85) * size[0]
    bend = Bend(
        clamp_px=(0.07 * size[0] + rng.uniform(0, 1), size[1] * rng.uniform(0.4, 0.6)),
        heading_rad=rng.uniform(-0.1, 0.1),
        length_px=length,
        turn_rad=float(np.clip(rng.normal(0.0, 0.35), -0.6, 0.6)),
        contact=rng.uniform(0.3, 1.0),
        force_angle_rad=rng.uniform(-0.3, 0.3),
        sag=rng.uniform(0.0, 0.015),
        shorter=rng.uniform(0.97, 1.0),
    )
    spec = replace(PLAIN, blur_px=rng.uniform(0.6, 1.0), antenna=rng.uniform(0.5, 0.9))
    return Shot(size, bend, rng.uniform(2.0, 8.0), spec)


def _motion(rng: Rng, shot: Shot) -> Shot:
    angle, length = rng.uniform(0, np.pi), rng.uniform(3.0, 8.0)
    return replace(shot, smear_px=(length * np.cos(angle), length * np.sin(angle)))


def _highlights(rng: Rng, shot: Shot) -> Shot:
    """A glint along the antenna, off its middle, and one flank brighter."""
    spec = replace(shot.spec, antenna=0.5, shading_asymmetry=rng.uniform(-0.1, 0.1))
    return replace(shot, spec=spec, glint=(rng.uniform(0.2, 0.6), rng.uniform(-0.3, 0.3)))


def _clutter(rng: Rng, shot: Shot) -> Shot:
    """Texture, soft shapes, straight edges and bars of any width behind it."""
    return replace(shot, clutter=_background(rng, shot.size, rng.uniform(0.15, 0.4)))


def _twin(rng: Rng, shot: Shot) -> Shot:
    """A shadow or a fainter reflection beside it."""
    strength = rng.uniform(-0.6, -0.3) if rng.uniform() < 0.5 else rng.uniform(0.2, 0.5)
    aside = float(rng.choice([-1, 1]) * (shot.width_px + rng.uniform(2.0, 20.0)))
    return replace(shot, twins=(Twin(aside, rng.uniform(-0.05, 0.05), strength, rng.uniform(0.5, 2.5)),))


def _hidden(rng: Rng, shot: Shot) -> Shot:
    """An object in front, darker or brighter than the background, that hides up to 40 % of the antenna."""
    bend = _bend(shot)
    path, share = path_px(bend), rng.uniform(0.1, 0.4)
    middle = rng.uniform(0.25 + 0.5 * share, 1.0 - 0.5 * share)
    at = path[int(middle * (len(path) - 1))]
    ends = path[[int((middle - 0.1) * (len(path) - 1)), min(int((middle + 0.1) * len(path)), len(path) - 1)]]
    turn = float(np.arctan2(*(ends[1] - ends[0])[::-1]) + rng.uniform(-0.3, 0.3))
    half = (0.5 * share * bend.length_px * 0.95, float(rng.uniform(0.1, 0.25) * shot.size[1]))
    block = Block((float(at[0]), float(at[1])), half, turn, rng.uniform(0.03, 0.6))
    return replace(shot, blocks=(*shot.blocks, block))


def _steep(rng: Rng, shot: Shot) -> Shot:
    """Turned by 35 to 75 degrees in all."""
    turn = float(rng.choice([-1, 1]) * rng.uniform(0.6, 1.3))
    return replace(shot, bend=replace(_bend(shot), turn_rad=turn, length_px=0.85 * _bend(shot).length_px))


def _bend(shot: Shot) -> Bend:
    assert shot.bend is not None
    return shot.bend


def _light(shot: Shot, **how: float) -> Shot:
    return replace(shot, spec=replace(shot.spec, **how))


HARDSHIPS: dict[str, Callable[[Rng, Shot], Shot]] = {
    # dark corners and one side in the dark
    "uneven light": lambda rng, shot: _light(shot, vignette=rng.uniform(0.3, 0.7), gradient=rng.uniform(0.3, 0.7)),
    # a disc of confusion of 2 to 5 px radius
    "defocus": lambda rng, shot: replace(shot, defocus_px=rng.uniform(2.0, 5.0)),
    # by up to 8 px in any direction during the exposure
    "motion blur": _motion,
    # a sensor at its highest gain: 8 to 20 grey levels of noise
    "sensor noise": lambda rng, shot: _light(shot, read_noise=rng.uniform(8.0, 20.0), electrons_per_grey=2.0),
    "highlights": _highlights,
    "clutter": _clutter,
    "shadow or reflection": _twin,
    "hidden up to 40 %": _hidden,
    "1.5 to 2 px wide": lambda rng, shot: replace(shot, width_px=rng.uniform(1.5, 2.0)),
    "8 to 20 px wide": lambda rng, shot: replace(shot, width_px=rng.uniform(8.0, 20.0)),
    "steep bends": _steep,
    # longer than the picture: its tip is outside
    "leaving the picture": lambda rng, shot: replace(
        shot, bend=replace(_bend(shot), length_px=rng.uniform(1.05, 1.4) * shot.size[0])
    ),
    "dark on light": lambda rng, shot: replace(shot, dark=True),
}
"""Name → what makes a good picture hard."""


def mixed(rng: Rng, size: Size, empty: bool = False) -> Shot:
    """Two to four hardships at once; `empty`: the same picture with no antenna, its object and clutter still there."""
    shot = good(rng, size)
    names = rng.choice(list(HARDSHIPS), size=int(rng.integers(2, 5)), replace=False)
    for name in names:
        shot = HARDSHIPS[str(name)](rng, shot)
    if empty and rng.uniform() < 0.7:
        shot = _clutter(rng, shot)
    return replace(shot, bend=None, twins=(), glint=(0.0, 0.0)) if empty else shot


def _background(rng: Rng, size: Size, contrast: float) -> np.ndarray:
    """(H, W) float32 brightness: clouds, texture, soft shapes, straight edges, bars."""
    canvas = np.zeros(size[::-1], np.float32)
    for cells, weight in ((5, 0.4), (14, 0.2), (60, 0.1)):
        coarse = rng.standard_normal((cells, cells)).astype(np.float32)
        canvas += weight * cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    for drawn, fewest, most in ((_shape, 3, 10), (_bar, 0, 5)):
        for _ in range(rng.integers(fewest, most)):
            canvas += np.float32(rng.uniform(-0.8, 0.8)) * drawn(rng, size)
    return np.clip(0.2 * (1.0 + 2.0 * contrast * canvas), 0.01, 0.9).astype(np.float32)


def _shape(rng: Rng, size: Size) -> np.ndarray:
    one = np.zeros(size[::-1], np.float32)
    centre, span = rng.uniform((0, 0), size), rng.uniform(0.05, 0.5, 2) * size[0]
    if rng.uniform() < 0.3:
        cv2.circle(one, centre.astype(int).tolist(), int(span[0] / 2), 1.0, -1)
    else:
        corners = cv2.boxPoints((centre.tolist(), span.tolist(), rng.uniform(0, 180)))
        cv2.fillConvexPoly(one, np.round(corners).astype(np.int32), 1.0)
    return cv2.GaussianBlur(one, (0, 0), float(rng.choice([0.5, 1.0, 3.0])))


def _bar(rng: Rng, size: Size) -> np.ndarray:
    mask = np.zeros(size[::-1], np.uint8)
    begin, end = np.round(16 * rng.uniform((-20, -20), np.array(size) + 20, (2, 2))).astype(int).tolist()
    cv2.line(mask, begin, end, 255, int(rng.integers(1, 16)), cv2.LINE_AA, 4)
    return cv2.GaussianBlur(mask.astype(np.float32) / 255.0, (0, 0), 0.6)
