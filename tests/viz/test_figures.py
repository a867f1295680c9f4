"""Figures of the reports: what is drawn lies where its value is, and any number of frames fits."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace
from typing import Any

import numpy as np

from viz.figures.contacts import friction_cone
from viz.figures.drawing import Plot
from viz.figures.settings import STYLE
from viz.figures.time import TimeAxis


def marks(axes: Plot, name: str, colour: str = "") -> list[np.ndarray]:
    """(N, K, 2) of the marks of a name, in a colour if one is named."""
    found = [mark for mark in axes.marks if mark.name == name]
    return [mark.points for mark in found if not colour or colour in (mark.stroke[:7], mark.fill[:7])]


def points(axes: Plot, colour: str = "") -> np.ndarray:
    """(N, 2) the dots of a colour."""
    return np.concatenate([found[:, 0] for found in marks(axes, "dots", colour)] or [np.zeros((0, 2))])


def sound(axes: Plot) -> str:
    """The figure as SVG, well-formed, without a NaN, nothing loaded from elsewhere."""
    text = str(axes.svg())
    ElementTree.fromstring(text.replace("xlink:href", "href"))
    assert not re.search(r"""nan|(src|href)="(?!#|data:)|url\((?!#)""", text)
    return text


def clock(number: int, step_s: float = 0.1, start_s: float = 0.0) -> TimeAxis:
    return TimeAxis(start_s + step_s * np.arange(number))


def test_the_cone_has_the_slope_that_it_says() -> None:
    """Two contacts slide on the rim of a cone of μ = 0.3, one sticks inside it."""
    force, alpha = np.outer([0.01, 0.02, 0.03], [0.0, 1.0, 0.0]), np.arctan(0.3)
    friction: Any = SimpleNamespace(
        determined=True,
        mu=0.3,
        interval=np.array([0.25, 0.35]),
        lateral_rad=np.array([alpha, -alpha, 0.1 * alpha]),
        lateral_std_rad=np.full(3, 0.01),
        used_as=["sliding", "sliding", "sticking"],
    )
    axes = friction_cone(friction, force, 0.3)
    assert "α = 16.7°, μ = 0.3" in sound(axes)
    slides = points(axes, STYLE.sliding)
    np.testing.assert_allclose(slides[:, 1] / slides[:, 0], [0.3, -0.3])
    np.testing.assert_allclose(np.linalg.norm(slides, axis=1), [10, 20])
    slopes = [ends[0, 1, 1] / ends[0, 1, 0] for ends in marks(axes, "cone", STYLE.teal)]
    np.testing.assert_allclose(sorted(slopes), [-0.3, 0.3])
    rim = np.concatenate(marks(axes, "band")).reshape(-1, 2)
    rim = rim[rim[:, 0] > 0]
    np.testing.assert_allclose(np.unique(np.round(rim[:, 1] / rim[:, 0], 9)), [-0.35, -0.25, 0.25, 0.35])
