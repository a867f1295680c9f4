"""The cells of the comparison: rigs held, and families of rigs that are drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from benchmarks.board_faults import FAULTS
from benchmarks.boards import BOARD, FISHEYE, HD, SQUARE, TALL, VGA, WIDE, Rig, rigs
from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.models import is_monotonic

_GROSS_PX = (3.0, 100.0)
_SMALL, _LARGE = BoardSpec(5, 4, 0.03, 0.022), BoardSpec(14, 10, 0.0125, 0.009)
_SIZES = (VGA, (1024, 768), HD, TALL, (1920, 1080), SQUARE)
_SPOILT_EVERY = 3
"""Of the rigs drawn, every third has outliers."""


@cache
def cells() -> dict[str, Callable[[int], Rig]]:
    """Rows of the table: name → a rig for each seed, mostly the same.

    The published rigs, then what is wrong with corners, board, print and noise, then rigs drawn.
    """
    plain, _, wide, *_ = published = rigs()
    fisheye = Rig("fisheye f 420, 20 views", "fisheye", TALL, FISHEYE, 20)
    gross = replace(plain, outlier_px=_GROSS_PX)
    held = [
        *published,
        fisheye,
        *(replace(gross, name=f"f 900, {100 * share:.0f} % gross", outliers=share) for share in _SHARES),
        *(replace(gross, name=f"f 900, 5 % {kind}", outliers=0.05, faults=kind) for kind in FAULTS[1:]),
        replace(gross, name="f 900, 5 % gross, bowed 0.5 mm", outliers=0.05, sagittas_m=(5e-4, 0.0)),
        replace(wide, name="wide, 10 % gross", outliers=0.1, outlier_px=_GROSS_PX),
        replace(fisheye, name="fisheye, 5 % gross", outliers=0.05, outlier_px=_GROSS_PX),
        replace(gross, name="f 900, board half as large, 5 % gross", outliers=0.05, fill=0.5),
        replace(gross, name="f 900, 5x4 squares, 5 % gross", outliers=0.05, spec=_SMALL),
        replace(gross, name="f 900, 14x10 squares, 5 % marker", outliers=0.05, spec=_LARGE, faults="marker"),
        replace(plain, name="f 900, 3 views", views=3),
        replace(plain, name="f 900, 5 views", views=5),
        replace(gross, name="f 900, 5 views, 5 % gross", views=5, outliers=0.05),
        replace(gross, name="f 900, 40 views, 10 % gross", views=40, outliers=0.1),
        replace(plain, name="f 900, 8 views, bowed 0.5 mm", views=8, sagittas_m=(5e-4, 0.0)),
        replace(plain, name="f 900, bowed 1 mm, twisted 0.5 mm", sagittas_m=(1e-3, -3e-4), twist_m=5e-4),
        replace(plain, name="f 900, print 1 % too wide", stretch=(0.01, 0.0)),
        replace(gross, name="f 900, print 2 % too high, sheared, 2 % gross", **_SKEWED),
        replace(plain, name="f 900, noise 0.05 px", noise_px=0.05),
        replace(plain, name="f 900, noise 0.5 px", noise_px=0.5),
        replace(plain, name="f 900, long tails", tails=3.0),
        replace(plain, name="f 900, views blurred", blur=0.8),
        replace(plain, name="f 900, board moving by 1 px", motion_px=1.0),
    ]
    every: dict[str, Callable[[int], Rig]] = {rig.name: partial(lambda rig, _: rig, rig) for rig in held}
    return every | {f"drawn: {name}": partial(_drawn, family) for name, family in FAMILIES.items()}


_SKEWED: dict[str, Any] = {"stretch": (0.0, 0.02), "shear": 3e-3, "outliers": 0.02}
_SHARES = (0.01, 0.02, 0.05, 0.1, 0.2)


Rng = np.random.Generator
Size = tuple[int, int]


def _core(size: Size, focal_px: float, rng: Rng) -> list[float]:
    """fx, fy, cx, cy: pixels nearly square, the axis within 2 % of the picture's middle."""
    middle = np.array(size) / 2.0 - 0.5 + rng.uniform(-0.02, 0.02, 2) * max(size)
    return [focal_px, focal_px * (1.0 + rng.normal(0.0, 2e-3)), *middle]


def _mild(size: Size, rng: Rng) -> tuple[str, list[float]]:
    k1 = rng.uniform(-0.25, -0.05)
    k2 = rng.uniform(0.2, 1.2) * k1**2 + rng.normal(0.0, 5e-3)
    lens = [k1, k2, *rng.normal(0.0, 4e-4, 2), rng.normal(0.0, 0.01)]
    return "opencv5", [*_core(size, rng.uniform(0.65, 0.9) * size[0], rng), *lens]


def _long(size: Size, rng: Rng) -> tuple[str, list[float]]:
    lens = [rng.uniform(-0.2, 0.05), rng.normal(0.0, 0.2), *rng.normal(0.0, 4e-4, 2), 0.0]
    return "opencv5", [*_core(size, rng.uniform(1.2, 3.0) * size[0], rng), *lens]


def _wide(size: Size, rng: Rng) -> tuple[str, list[float]]:
    # in both polynomials much the same, as fits of real wide lenses have it
    lens = WIDE[4:] * rng.uniform(0.85, 1.15, 8)
    lens[2:4] = rng.normal(0.0, 4e-4, 2)
    return "rational", [*_core(size, rng.uniform(0.42, 0.55) * size[0], rng), *lens]


def _fisheye(size: Size, rng: Rng) -> tuple[str, list[float]]:
    focal = 0.5 * np.hypot(*size) / np.radians(rng.uniform(60.0, 75.0))
    return "fisheye", [*_core(size, focal, rng), *rng.normal(0.0, [0.04, 0.015, 5e-3, 1e-3])]


def _radial(size: Size, rng: Rng) -> tuple[str, list[float]]:
    lens = [0.0, 0.0] if rng.random() < 0.3 else [rng.uniform(-0.2, 0.1), rng.normal(0.0, 0.02)]
    return "radial", [*_core(size, rng.uniform(0.6, 1.5) * size[0], rng), *lens, 0.0, 0.0]


Family = Callable[[Size, Rng], tuple[str, list[float]]]
"""A picture's size → a lens drawn: its model and intrinsics (4 + k)."""
FAMILIES: dict[str, Family] = {
    "mild barrel": _mild,
    "long": _long,
    "wide rational": _wide,
    "fisheye": _fisheye,
    "radial or plain": _radial,
}


def _drawn(family: Family, seed: int) -> Rig:
    """A rig of the family: lens, board, print, noise, number of views; every third has outliers of any kind."""
    rng = np.random.default_rng([seed, 20])
    for _ in range(100):
        size = _SIZES[rng.integers(len(_SIZES))]
        model, intrinsics = family(size, rng)
        rig = Rig("", model, size, np.array(intrinsics), int(rng.integers(8, 41)))
        if is_monotonic(rig.model, rig.intrinsics, size):
            break
    spoilt = seed % _SPOILT_EVERY == _SPOILT_EVERY - 1
    return replace(
        rig,
        name=f"{rig.lens} f {rig.intrinsics[0]:.0f}, {rig.image_size[0]}x{rig.image_size[1]}, {rig.views} views",
        spec=(BOARD, BOARD, _SMALL, _LARGE)[rng.integers(4)],
        fill=float(rng.uniform(0.5, 1.0)),
        noise_px=float(np.exp(rng.uniform(np.log(0.05), np.log(0.5)))),
        blur=float(rng.choice([0.0, 0.4])),
        tails=float(rng.choice([np.inf, 4.0])),
        sagittas_m=tuple(rng.normal(0.0, 2.5e-4, 2).tolist()),
        twist_m=float(rng.normal(0.0, 2e-4)),
        stretch=tuple(rng.normal(0.0, 1e-3, 2).tolist()),
        outliers=float(np.exp(rng.uniform(np.log(0.01), np.log(0.2)))) if spoilt else 0.0,
        faults=FAULTS[0 if rng.random() < 0.5 else rng.integers(1, len(FAULTS))],
        outlier_px=_GROSS_PX,
    )
