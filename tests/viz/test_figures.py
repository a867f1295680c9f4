"""Figures of the reports: what is drawn lies where its value is, and any number of frames fits."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from estimator.table.contacts import ContactTable
from viz.figures.contacts import SLIDING, contact_maps, friction_cone, indentation
from viz.figures.drawing import TEAL, svg
from viz.figures.time import TimeAxis, curve, lanes, signals

from .estimates import STIFFNESS_N_M, object_estimate

STATUS = {"ok": "#00ff00", "failed": "#ff0000"}


def marks(axes: Axes, label: str, colour: str | None = None) -> list[np.ndarray]:
    """Corners (K, 2) of what was drawn under a label, in a colour if one is given."""
    found = [patch for patch in axes.patches if patch.get_label() == label]
    paths = [p for p in found if colour is None or colour in (to_hex(p.get_edgecolor()), to_hex(p.get_facecolor()))]
    return [patch.get_path().vertices for patch in paths]


def points(axes: Axes, colour: str) -> np.ndarray:
    """(N, 2) the dots of a colour."""
    return np.concatenate([found[::2] for found in marks(axes, "dots", colour)] or [np.zeros((0, 2))])


def sound(axes: Axes) -> str:
    """The figure as SVG, well-formed, without a NaN, nothing loaded from elsewhere."""
    text = str(svg(axes))
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


def test_one_bad_frame_of_very_many_is_still_seen() -> None:
    label = ["ok"] * 50_000
    label[31_234] = "failed"
    axes = lanes(clock(50_000, 1 / 30), "status", label, STATUS)
    (bad,) = marks(axes, "failed")[0].reshape(-1, 5, 2)
    assert np.ptp(bad[:, 1]) * 17 > 1.0, "higher than a pixel"
    assert len(marks(axes, "ok")[0]) < 50 * 5


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
    slopes = [line.get_ydata()[1] / line.get_xdata()[1] for line in axes.lines if line.get_color() == TEAL]
    np.testing.assert_allclose(sorted(slopes), [-0.3, 0.3])
    rim = np.concatenate(marks(axes, "band"))
    rim = rim[rim[:, 0] > 0]
    np.testing.assert_allclose(np.unique(np.round(rim[:, 1] / rim[:, 0], 9)), [-0.35, -0.25, 0.25, 0.35])


@pytest.mark.parametrize("determined", [True, False])
def test_indentations_have_the_slope_of_the_compliance(table: ContactTable, determined: bool) -> None:
    surface = object_estimate(table, determined=determined).surface
    axes = indentation(surface, table.picked(surface.touched_row), 0.0, 1 / STIFFNESS_N_M)
    x, y = points(axes, SLIDING).T
    np.testing.assert_allclose(x, 1e3 * np.linalg.norm(table.force_world_N[surface.touched_row], axis=1))
    np.testing.assert_allclose(y, x / STIFFNESS_N_M)
    fit = [line for line in axes.lines if line.get_label() == "fit"]
    assert len(fit) == determined
    if fit:
        np.testing.assert_allclose(np.interp(x, fit[0].get_xdata(), fit[0].get_ydata()), y)


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
    assert np.ptp(above.get_xlim()) == pytest.approx(np.ptp(above.get_ylim()))
    box = above.get_window_extent()
    assert box.width == pytest.approx(box.height)
    dots = np.concatenate([found[::2] for found in marks(above, "dots")])
    np.testing.assert_allclose(dots, 1e3 * points_m[:, :2])
    if np.isnan(variance):
        assert not marks(above, "ellipses")
    else:
        # small ones are enlarged by what the key says
        assert (factor > 1) == (variance < 1e-6)
        size = 1e3 * factor * np.sqrt(variance) * np.array([8.0, 4.0])
        np.testing.assert_allclose(np.ptp(marks(above, "ellipses")[0][:25], axis=0), size, rtol=0.01)
    # opposite triangles turn the same way: none cuts a hole into the other
    for face in marks(above, "object")[0].reshape(-1, 3, 2):
        a, b = face[1] - face[0], face[2] - face[0]
        assert a[0] * b[1] - a[1] * b[0] >= 0
