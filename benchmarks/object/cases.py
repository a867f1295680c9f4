"""Objects of the benchmark, and the strokes along them: about two hundred contacts each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.estimator.setup import ACROSS, Setup
from vbaa_calib.simulate.scene.bumps import Bump
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Sweep

SETUP = Setup("brown", 0.5, ACROSS, swing_m=0.06, real=True)
"""Camera inclined by 30° across the antenna; weight, bow and a clamp that is off."""
RIGID, SOFT, SOFTER = np.inf, 1000.0, 250.0
"""N/m. Forces up to 0.1 N press a tenth of a millimetre into the soft ones, four tenths into the softer."""
CENTRE = np.array([0.15, 0.0, 0.0])
_BESIDE = CENTRE + np.array([0.0, 0.02, 0.0])


@dataclass(frozen=True)
class Case:
    """An object and how it is stroked: `make` takes stiffness in N/m and friction."""

    name: str
    make: Callable[[float, float], TouchObject]
    strokes: Sequence[Sweep]


def _unit(*direction: float) -> np.ndarray:
    return np.array(direction) / np.linalg.norm(direction)


AXIS = _unit(0.2, 0.15, 0.95)
_INTO_BOX = np.cross(AXIS, _unit(*np.cross((0.3, 1.0, 0.0), AXIS)))
BUMPS = (
    Bump(_unit(-0.3, 1.0, 0.2), 3e-3, 12e-3),
    Bump(_unit(-0.3, -1.0, -0.2), 3e-3, 12e-3),
    Bump(_unit(-0.3, 0.1, 1.0), 2e-3, 10e-3),
    Bump(_unit(0.2, -1.0, 0.6), -2e-3, 12e-3),
)


def _sweep(
    press: str,
    toward: int,
    push_deg: tuple[float, float],
    sweep_deg: tuple[float, float],
    frames: int,
    swells: float = 3.0,
) -> Sweep:
    low, high = np.radians(push_deg)
    first, last = np.radians(sweep_deg)
    return Sweep(
        press, toward, frames, 3, np.radians(1.5), (float(low), float(high)), swells, (float(first), float(last))
    )


def _there_and_back(
    press: str, toward: int, push_deg: tuple[float, float], reach_deg: tuple[float, float]
) -> list[Sweep]:
    """Two strokes, the second the other way and with its pushes between those of the first."""
    back = (reach_deg[1], reach_deg[0])
    return [_sweep(press, toward, push_deg, reach_deg, 21), _sweep(press, toward, push_deg, back, 21, 2.5)]


_LINE = [
    stroke
    for toward in (1, -1)
    for push in ((1.5, 6.0), (3.0, 9.0))
    for stroke in _there_and_back("pan", toward, push, (-12.0, 12.0))
]
_EDGE = [
    stroke
    for push in ((1.5, 5.0), (2.5, 7.0), (4.0, 9.0), (3.0, 6.0))
    for stroke in _there_and_back("pan", 1, push, (-12.0, 12.0))
]
_ROUND = [
    stroke
    for press in ("pan", "tilt")
    for toward in (1, -1)
    for stroke in _there_and_back(press, toward, (1.5, 5.0), (-4.0, 4.0))
]
CASES = (
    Case("cylinder", lambda stiffness, mu: TouchObject("cylinder", CENTRE, AXIS, 0.02, 0.08, stiffness, mu), _LINE),
    Case("sphere", lambda stiffness, mu: TouchObject("sphere", CENTRE, AXIS, 0.03, 1.0, stiffness, mu), _ROUND),
    Case(
        "box edge",
        lambda k, mu: TouchObject("box_edge", _BESIDE, AXIS, 3e-3, 0.08, k, mu, _INTO_BOX),
        _EDGE,
    ),
    Case("free form", lambda k, mu: TouchObject("freeform", CENTRE, AXIS, 0.028, 1.0, k, mu, bumps=BUMPS), _ROUND),
)
