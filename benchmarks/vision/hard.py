"""The hardships that real pictures bring, one by one and mixed at random, and pictures with no antenna in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from .scenes import PLAIN, Bend, Block, Shot, Twin, path_px

Rng = np.random.Generator
Size = tuple[int, int]


def good(rng: Rng, size: Size) -> Shot:
    """In focus, even light, plain background; any width from 2 to 8 px, any moderate bend."""
    width, height = size
    length = float(rng.uniform(0.7, 0.85) * width)
    bend = Bend(
        clamp_px=(0.07 * width + rng.uniform(0, 1), height * rng.uniform(0.4, 0.6)),
        heading_rad=float(rng.uniform(-0.1, 0.1)),
        length_px=length,
        turn_rad=float(np.clip(rng.normal(0.0, 0.35), -0.6, 0.6)),
        contact=float(rng.uniform(0.3, 1.0)),
        force_angle_rad=float(rng.uniform(-0.3, 0.3)),
        sag=float(rng.uniform(0.0, 0.015)),
        shorter=float(rng.uniform(0.97, 1.0)),
    )
    spec = replace(PLAIN, blur_px=float(rng.uniform(0.6, 1.0)), antenna=float(rng.uniform(0.5, 0.9)))
    return Shot(size, bend, float(rng.uniform(2.0, 8.0)), spec)


def _motion(rng: Rng, shot: Shot) -> Shot:
    angle, length = rng.uniform(0, np.pi), rng.uniform(3.0, 8.0)
    return replace(shot, smear_px=(float(length * np.cos(angle)), float(length * np.sin(angle))))


def _highlights(rng: Rng, shot: Shot) -> Shot:
    """A glint along the antenna, off its middle, and one flank brighter."""
    spec = replace(shot.spec, antenna=0.5, shading_asymmetry=float(rng.uniform(-0.1, 0.1)))
    return replace(shot, spec=spec, glint=(float(rng.uniform(0.2, 0.6)), float(rng.uniform(-0.3, 0.3))))


def _clutter(rng: Rng, shot: Shot) -> Shot:
    """Texture, soft shapes, straight edges and bars of any width behind it."""
    return replace(shot, clutter=_background(rng, shot.size, float(rng.uniform(0.15, 0.4))))


def _twin(rng: Rng, shot: Shot) -> Shot:
    """A shadow or a fainter reflection beside it."""
    strength = float(rng.uniform(-0.6, -0.3) if rng.uniform() < 0.5 else rng.uniform(0.2, 0.5))
    aside = float(rng.choice([-1, 1]) * (shot.width_px + rng.uniform(2.0, 20.0)))
    return replace(shot, twins=(Twin(aside, float(rng.uniform(-0.05, 0.05)), strength, float(rng.uniform(0.5, 2.5))),))


def _hidden(rng: Rng, shot: Shot) -> Shot:
    """An object in front, darker or brighter than the background, that hides up to 40 % of the antenna."""
    bend = _bend(shot)
    path = path_px(bend)
    share = rng.uniform(0.1, 0.4)
    middle = rng.uniform(0.25 + 0.5 * share, 1.0 - 0.5 * share)
    at = path[int(middle * (len(path) - 1))]
    ends = path[[int((middle - 0.1) * (len(path) - 1)), min(int((middle + 0.1) * len(path)), len(path) - 1)]]
    turn = float(np.arctan2(*(ends[1] - ends[0])[::-1]) + rng.uniform(-0.3, 0.3))
    half = (0.5 * share * bend.length_px * 0.95, float(rng.uniform(0.1, 0.25) * shot.size[1]))
    block = Block((float(at[0]), float(at[1])), half, turn, float(rng.uniform(0.03, 0.6)))
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
    "defocus": lambda rng, shot: replace(shot, defocus_px=float(rng.uniform(2.0, 5.0))),
    # by up to 8 px in any direction during the exposure
    "motion blur": _motion,
    # a sensor at its highest gain: 8 to 20 grey levels of noise
    "sensor noise": lambda rng, shot: _light(shot, read_noise=rng.uniform(8.0, 20.0), electrons_per_grey=2.0),
    "highlights": _highlights,
    "clutter": _clutter,
    "shadow or reflection": _twin,
    "hidden up to 40 %": _hidden,
    "1.5 to 2 px wide": lambda rng, shot: replace(shot, width_px=float(rng.uniform(1.5, 2.0))),
    "8 to 20 px wide": lambda rng, shot: replace(shot, width_px=float(rng.uniform(8.0, 20.0))),
    "steep bends": _steep,
    # longer than the picture: its tip is outside
    "leaving the picture": lambda rng, shot: replace(
        shot, bend=replace(_bend(shot), length_px=float(rng.uniform(1.05, 1.4) * shot.size[0]))
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
    width, height = size
    canvas = np.zeros((height, width), np.float32)
    for cells, weight in ((5, 0.4), (14, 0.2), (60, 0.1)):
        coarse = rng.standard_normal((cells, cells)).astype(np.float32)
        canvas += weight * cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    for _ in range(int(rng.integers(3, 10))):
        canvas += np.float32(rng.uniform(-0.8, 0.8)) * _shape(rng, size)
    for _ in range(int(rng.integers(0, 5))):
        canvas += np.float32(rng.uniform(-0.8, 0.8)) * _bar(rng, size)
    return np.clip(0.2 * (1.0 + 2.0 * contrast * canvas), 0.01, 0.9).astype(np.float32)


def _shape(rng: Rng, size: Size) -> np.ndarray:
    one = np.zeros(size[::-1], np.float32)
    centre, span = rng.uniform((0, 0), size), rng.uniform(0.05, 0.5, 2) * size[0]
    if rng.uniform() < 0.3:
        cv2.circle(one, centre.astype(int).tolist(), int(span[0] / 2), 1.0, -1)
    else:
        corners = cv2.boxPoints((centre.tolist(), span.tolist(), float(rng.uniform(0, 180))))
        cv2.fillConvexPoly(one, np.round(corners).astype(np.int32), 1.0)
    return cv2.GaussianBlur(one, (0, 0), float(rng.choice([0.5, 1.0, 3.0])))


def _bar(rng: Rng, size: Size) -> np.ndarray:
    mask = np.zeros(size[::-1], np.uint8)
    ends = np.round(16 * rng.uniform((-20, -20), np.array(size) + 20, (2, 2))).astype(int)
    cv2.line(mask, ends[0].tolist(), ends[1].tolist(), 255, int(rng.integers(1, 16)), cv2.LINE_AA, 4)
    return cv2.GaussianBlur(mask.astype(np.float32) / 255.0, (0, 0), 0.6)
