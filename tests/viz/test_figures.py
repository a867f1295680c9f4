"""Figures of the reports: what is drawn lies where its value is, and any number of frames fits."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.table.contacts import ContactTable
from viz.figures.contacts import SLIDING, contact_maps, friction_cone, indentation
from viz.figures.drawing import SLATE, TEAL, Plot
from viz.figures.time import TimeAxis, curve, signals

from .estimates import STIFFNESS_N_M, object_estimate


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


@pytest.mark.parametrize("value", [np.full(4, np.nan), np.full(4, 3.0), np.zeros(4)])
def test_a_curve_of_nothing_or_of_one_value_is_still_a_picture(value: np.ndarray) -> None:
    axes = curve(clock(4), "force, mN", value, np.full(4, np.nan))
    assert len(points(axes, TEAL)) == np.isfinite(value).sum()
    sound(axes)
    sound(signals(clock(4), "slip, mm/s", [("a", "#000000", value)], np.full(4, np.nan), "noise"))


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
    slides = points(axes, SLIDING)
    np.testing.assert_allclose(slides[:, 1] / slides[:, 0], [0.3, -0.3])
    np.testing.assert_allclose(np.linalg.norm(slides, axis=1), [10, 20])
    slopes = [ends[0, 1, 1] / ends[0, 1, 0] for ends in marks(axes, "cone", TEAL)]
    np.testing.assert_allclose(sorted(slopes), [-0.3, 0.3])
    rim = np.concatenate(marks(axes, "band")).reshape(-1, 2)
    rim = rim[rim[:, 0] > 0]
    np.testing.assert_allclose(np.unique(np.round(rim[:, 1] / rim[:, 0], 9)), [-0.35, -0.25, 0.25, 0.35])


@pytest.mark.parametrize("determined", [True, False])
def test_indentations_have_the_slope_of_the_compliance(table: ContactTable, determined: bool) -> None:
    surface = object_estimate(table, determined=determined).surface
    axes = indentation(surface, table.picked(surface.touched_row), 0.0, 1 / STIFFNESS_N_M)
    x, y = points(axes, SLIDING).T
    np.testing.assert_allclose(x, 1e3 * np.linalg.norm(table.force_world_N[surface.touched_row], axis=1))
    np.testing.assert_allclose(y, x / STIFFNESS_N_M)
    fit = marks(axes, "fit")
    assert len(fit) == determined
    if fit:
        np.testing.assert_allclose(np.interp(x, *fit[0][0].T), y)


def contacts_at(points_m: np.ndarray, variance: float, table: ContactTable) -> ContactTable:
    covariance = np.tile(variance * np.diag([4.0, 1.0, 1.0]), (len(points_m), 1, 1))
    return replace(table.picked(slice(len(points_m))), point_world_m=points_m, covariance_world_m2=covariance)


@pytest.mark.parametrize("variance", [1e-6, 1e-8, np.nan])
def test_a_map_of_equal_scales(table: ContactTable, variance: float) -> None:
    points_m = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.1, 0.05, 0.1]])
    surface: Any = SimpleNamespace(
        points_m=points_m, triangles=np.array([[0, 1, 2], [0, 2, 1]]), lines=np.array([[0, 1]])
    )
    (above, *_), factor = contact_maps(contacts_at(points_m, variance, table), surface, points_m[:1])
    sound(above)
    assert np.ptp(above.x) == pytest.approx(np.ptp(above.y))
    assert above.inner[0] == pytest.approx(above.inner[1])
    np.testing.assert_allclose(points(above), 1e3 * points_m[:, :2])
    if np.isnan(variance):
        assert not marks(above, "ellipses")
    else:
        # small ones are enlarged by what the key says
        assert (factor > 1) == (variance < 1e-6)
        size = 1e3 * factor * np.sqrt(variance) * np.array([8.0, 4.0])
        middle, *ends = marks(above, "ellipses")[0][0]
        halves = ends - middle
        np.testing.assert_allclose(2 * np.linalg.norm(halves, axis=0), size, rtol=0.01)
    # opposite triangles turn the same way: none cuts a hole into the other
    for face in marks(above, "object", SLATE)[0]:
        a, b = face[1] - face[0], face[2] - face[0]
        assert a[0] * b[1] - a[1] * b[0] >= 0
