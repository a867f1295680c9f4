"""Every system of the paper's family by its name: what it needs, what it assumes, and how it answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vbaa_calib.core.errors import InputError

from .press import Answer, Press
from .rotation import active_antenna, active_antenna_3d
from .vibration import dynamic_active_antenna
from .vision import vbaa_2d, vbaa_2d_pushing, vbaa_3d_camera_a, vbaa_3d_camera_b

NEEDS = {
    "turns": "the base's turns since first contact",
    "moment_y": "a moment sensor about y",
    "moment_z": "a moment sensor about z",
    "centreline": "the antenna's centreline on plane C",
    "ring": "a ring-down of the moment, and the wire's mass",
}


@dataclass(frozen=True)
class Method:
    """One system.

    Attributes
    ----------
    solve : from a press to its reading.
    needs : of `NEEDS`; of a tuple inside, any one is enough.
    assumes : in words, beside the wire's uniformity.
    source : the paper's reference numbers, or its sections.
    """

    solve: Callable[[Press], Answer]
    needs: tuple[str | tuple[str, ...], ...]
    assumes: str
    source: str


METHODS = {
    "Active Antenna": Method(
        active_antenna, ("turns", ("moment_y", "moment_z")), "rigid object, no slip, small turns", "[10]–[12]"
    ),
    "3D Active Antenna": Method(
        active_antenna_3d,
        ("turns", "moment_y", "moment_z"),
        "rigid object, pushed along its normal, small turns",
        "[13], [14]",
    ),
    "Dynamic Active Antenna": Method(
        dynamic_active_antenna,
        ("ring",),
        "a contact that holds while the antenna rings in its first mode",
        "[15], [16]",
    ),
    "2D-VBAA": Method(vbaa_2d, ("centreline",), "bent within plane C, small deflections, parallel rays", "[1], [17]"),
    "2D-VBAA, pushing": Method(
        vbaa_2d_pushing,
        ("centreline", "turns"),
        "pushed along the object's normal within plane C, a linear spring",
        "[1], [17]",
    ),
    "3D-VBAA, camera A": Method(
        vbaa_3d_camera_a, ("centreline", "moment_y"), "small deflections, parallel rays square on plane C", "section 2"
    ),
    "3D-VBAA, camera B": Method(
        vbaa_3d_camera_b, ("centreline", "moment_y"), "small deflections, parallel rays inclined by ϕ", "section 4"
    ),
}


def run_method(name: str, press: Press) -> Answer:
    """What the method makes of the press; what it lacks is its reason for saying nothing.

    Raises InputError for an unknown name.
    """
    if name not in METHODS:
        raise InputError(f"no method {name!r}", remedy=f"one of {', '.join(METHODS)}")
    method, has = METHODS[name], press.has
    lacking = [
        " or ".join(NEEDS[each] for each in _any_of(need))
        for need in method.needs
        if not any(each in has for each in _any_of(need))
    ]
    return Answer(reason=f"needs {' and '.join(lacking)}") if lacking else method.solve(press)


def _any_of(need: str | tuple[str, ...]) -> tuple[str, ...]:
    return (need,) if isinstance(need, str) else need
