"""The object of a scene file."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from .bumps import Bump
from .fields import Section
from .objects import LINES, SHAPES, WEDGES, TouchObject


def read_object(section: Section) -> TouchObject:
    """From the section `object`. Raises InputError naming the key that is wrong."""
    section.only(
        *("shape", "center_world_m", "axis_world", "wedge_world", "radius_m", "half_length_m", "stiffness_N_m"),
        *("friction", "bumps"),
    )
    shape = section.choice("shape", SHAPES)
    axis = section.direction("axis_world") if shape in LINES else np.array([0.0, 0.0, 1.0])
    rigid = not section.has("stiffness_N_m")
    if section.has("bumps") and shape != "freeform":
        raise section.wrong("bumps", f"do not go with a {shape}", "take the shape freeform")
    return TouchObject(
        shape=shape,
        center_world_m=section.array("center_world_m", (3,)),
        axis_world=axis,
        radius_m=section.number("radius_m", 1e-6, 1.0),
        half_length_m=section.number("half_length_m", 1e-3, 10.0, 0.1),
        stiffness_N_m=float("inf") if rigid else section.number("stiffness_N_m", 1e-3, 1e12),
        friction=section.number("friction", 0.0, 2.0, 0.0),
        wedge_world=_wedge(section, axis) if shape in WEDGES else np.array([1.0, 0.0, 0.0]),
        bumps=tuple(_bump(entry) for entry in section.sections("bumps")) if shape == "freeform" else (),
    )


def _wedge(section: Section, axis: np.ndarray) -> np.ndarray:
    wedge = section.direction("wedge_world")
    wedge = wedge - axis * (axis @ wedge)
    if np.linalg.norm(wedge) < 0.1:
        raise section.wrong("wedge_world", "runs along the edge", "a direction from the edge into the body is needed")
    return np.asarray(wedge / np.linalg.norm(wedge))


def _bump(section: Section) -> Bump:
    section.only("direction_world", "height_m", "width_m")
    height = section.number("height_m", -0.5, 0.5)
    try:
        return Bump(section.direction("direction_world"), height, section.number("width_m", 1e-4, 1.0))
    except InputError as error:
        raise section.wrong("height_m", f"does not fit: {error.what}", error.remedy or "make it flatter") from None
