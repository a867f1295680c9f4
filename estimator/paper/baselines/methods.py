"""Every system of the paper's family by its name: what it needs, and how it answers."""

from __future__ import annotations

from collections.abc import Callable

from vbaa_calib.core.arrays import gate
from vbaa_calib.core.errors import InputError

from .moment import active_antenna, active_antenna_3d, dynamic_active_antenna
from .press import Answer, Press
from .vision import vbaa_2d, vbaa_2d_pushing, vbaa_3d_camera_a, vbaa_3d_camera_b

_NEEDS = {
    "turns": "the base's turns since first contact",
    "moment_y": "a moment sensor about y",
    "moment_z": "a moment sensor about z",
    "centreline": "the antenna's centreline on plane C",
    "ring": "a ring-down of the moment, and the wire's mass",
}
METHODS: dict[str, tuple[Callable[[Press], Answer], str]] = {
    "Active Antenna": (active_antenna, "turns moment_y|moment_z"),
    "3D Active Antenna": (active_antenna_3d, "turns moment_y moment_z"),
    "Dynamic Active Antenna": (dynamic_active_antenna, "ring"),
    "2D-VBAA": (vbaa_2d, "centreline"),
    "2D-VBAA, pushing": (vbaa_2d_pushing, "centreline turns"),
    "3D-VBAA, camera A": (vbaa_3d_camera_a, "centreline moment_y"),
    "3D-VBAA, camera B": (vbaa_3d_camera_b, "centreline moment_y"),
}
"""How each answers, and which of `_NEEDS` it needs; of those joined by | any one is enough."""


@gate
def run_method(name: str, press: Press) -> Answer:
    """What the method makes of the press; what it lacks is its reason for saying nothing.

    Raises InputError for an unknown name.
    """
    if name not in METHODS:
        raise InputError(f"no method {name!r}", remedy=f"one of {', '.join(METHODS)}")
    solve, needs = METHODS[name]
    any_of = [need.split("|") for need in needs.split()]
    lacking = [" or ".join(_NEEDS[each] for each in need) for need in any_of if press.has.isdisjoint(need)]
    return Answer(reason=f"needs {' and '.join(lacking)}") if lacking else solve(press)
