"""Figures of the reports: what is drawn lies where its value is, and any number of frames fits."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from viz.figures.check import contour_levels, coverage, heat_map, residual_arrows
from viz.figures.contacts import (
    SLIDING,
    VIEWS,
    ConeData,
    IndentationData,
    MapData,
    contact_map,
    forces_across,
    friction_cone,
    indentation,
)
from viz.figures.drawing import TEAL, band, bars, ellipses, new_axes, svg, time_colours
from viz.figures.time import TimeAxis, curve, lanes, signals
from viz.scene.readable import thinned

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
    return TimeAxis.of(start_s + step_s * np.arange(number))


def test_a_figure_is_the_same_every_time_and_says_its_tips_escaped() -> None:
    value = np.arange(5.0)
    texts = []
    for _ in range(2):
        axes = TimeAxis.of(value, [(2.0, "<touch> & go")])
        texts.append(axes.svg(curve(axes, "force, mN", value, value)))
    assert texts[0] == texts[1]
    assert "<title>&lt;touch&gt; &amp; go</title>" in texts[0]
    assert ">force, mN</text>" in texts[0]


def test_an_ellipse_has_two_standard_deviations() -> None:
    axes, up = new_axes("e"), np.array([1.0, 1.0]) / np.sqrt(2)
    covariance = 1e-2 * np.outer(up, up) + 1e-4 * np.eye(2)
    ellipses(axes, np.array([[0.5, 0.5]]), covariance[None], time_colours(np.zeros(1)))
    (outline,) = marks(axes, "ellipses")
    off = outline - [0.5, 0.5]
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", off, np.linalg.inv(covariance), off), 4.0)


def test_bars_and_bands_are_cut_at_the_edge() -> None:
    axes = new_axes("b", y=(-1.0, 2.0))
    far = np.full(2, 1e9)
    bars(axes, np.arange(2.0), -far, far, "#000000")
    band(axes, np.arange(2.0), -far, far, "#000000")
    for found in (*marks(axes, "bars"), *marks(axes, "band")):
        assert (found[:, 1].min(), found[:, 1].max()) == (-1.0, 2.0)


@pytest.mark.parametrize(("number", "most"), [(0, 5), (1, 5), (5, 5), (50_000, 300)])
def test_thinning_keeps_both_ends(number: int, most: int) -> None:
    found = thinned(np.arange(number), most)
    assert len(found) == min(number, most)
    assert found.tolist() == sorted(set(found.tolist()))
    if number:
        assert (found[0], found[-1]) == (0, number - 1)


def test_a_curve_puts_points_and_band_where_its_values_are() -> None:
    value, std = np.array([1.0, 2.0, np.nan, 4.0, np.nan, 3.0]), np.full(6, 0.1)
    std[3] = 1e6
    axes = curve(clock(6), "force, mN", value, std, value + 0.05)
    known = np.isfinite(value)
    np.testing.assert_allclose(points(axes, TEAL), np.column_stack([0.1 * np.arange(6), value])[known])
    low, high = axes.get_ylim()
    assert high - low < 6, "the band of one frame that is hardly known does not flatten the others"
    first = marks(axes, "band")[0]
    assert 0.8 in np.round(first[:, 1], 9)
    assert (first[:, 1] <= high).all()
    sound(axes)


@pytest.mark.parametrize("value", [np.full(4, np.nan), np.full(4, 3.0), np.zeros(4)])
def test_a_curve_of_nothing_or_of_one_value_is_still_a_picture(value: np.ndarray) -> None:
    axes = curve(clock(4), "force, mN", value, np.full(4, np.nan))
    assert len(points(axes, TEAL)) == np.isfinite(value).sum()
    sound(axes)
    sound(signals(clock(4), "slip, mm/s", [("a", "#000000", value)], np.full(4, np.nan), "noise"))


def test_one_frame_is_enough() -> None:
    sound(curve(clock(1), "force, mN", np.array([1.0]), np.array([0.1])))
    sound(lanes(clock(1), "status", ["ok"], STATUS))
    assert TimeAxis.of(np.array([3.0, 3.0])).step_s == 1.0


def test_times_since_1970_count_from_the_first_frame() -> None:
    assert clock(3).label == "time, s"
    late = clock(3, start_s=1.7e9)
    assert late.label == "time after 1700000000 s, s"
    np.testing.assert_allclose(late.time_s, [0.0, 0.1, 0.2], atol=1e-6)


def test_columns_keep_the_extremes_of_every_number_of_frames() -> None:
    rng = np.random.default_rng(1)
    time_s, value = np.sort(rng.uniform(0, 10, 20_000)), rng.normal(size=20_000)
    x, low, middle, high = TimeAxis.of(time_s).gathered(time_s, value, value)
    assert len(x) <= 960
    assert (low.min(), high.max()) == (value.min(), value.max())
    assert ((low <= middle) & (middle <= high)).all()
    assert np.median(np.abs(middle)) < 0.4
    assert len(sound(curve(TimeAxis.of(time_s), "x", value, np.ones(20_000), value))) < 3e5


def test_a_gap_in_time_breaks_the_band() -> None:
    time_s = np.concatenate([np.arange(5), 100 + np.arange(5)]) * 0.1
    assert len(marks(curve(TimeAxis.of(time_s), "l, mm", np.ones(10), np.ones(10)), "band")) == 2


def test_lanes_show_every_label_with_its_count() -> None:
    axes = lanes(clock(4), "status", ["ok", "failed", "ok", "ok"], STATUS)
    assert [text.get_text() for text in axes.get_yticklabels()] == ["ok (3)", "failed (1)"]
    boxes = {name: marks(axes, name)[0].reshape(-1, 5, 2) for name in STATUS}
    width = {name: float(np.ptp(found[..., 0], axis=1).sum()) for name, found in boxes.items()}
    assert width["ok"] == pytest.approx(3 * width["failed"])


def test_one_bad_frame_of_very_many_is_still_seen() -> None:
    label = ["ok"] * 50_000
    label[31_234] = "failed"
    axes = lanes(clock(50_000, 1 / 30), "status", label, STATUS)
    (bad,) = marks(axes, "failed")[0].reshape(-1, 5, 2)
    assert np.ptp(bad[:, 1]) * 17 > 1.0, "higher than a pixel"
    assert len(marks(axes, "ok")[0]) < 50 * 5


def test_the_cone_has_the_slope_that_it_says() -> None:
    data = ConeData(
        normal_N=np.array([0.01, 0.02, 0.03, np.nan]),
        tangential_N=np.array([0.003, -0.006, 0.001, 0.01]),
        tangential_std_N=np.full(4, 1e-4),
        used_as=np.array(["sliding", "sliding", "sticking", "unused"]),
        mu=0.3,
        interval=(0.25, 0.35),
        true_mu=0.3,
    )
    axes = friction_cone(data)
    assert "α = 16.7°, μ = 0.3" in sound(axes)
    np.testing.assert_allclose(points(axes, SLIDING), [[10, 3], [20, -6]])
    slopes = [line.get_ydata()[1] / line.get_xdata()[1] for line in axes.lines if line.get_color() == TEAL]
    np.testing.assert_allclose(sorted(slopes), [-0.3, 0.3])
    rim = np.concatenate(marks(axes, "band"))
    np.testing.assert_allclose(
        np.unique(np.round(rim[rim[:, 0] > 0] @ np.diag([0, 1 / rim[:, 0].max()]), 9)[:, 1]), [-0.35, -0.25, 0.25, 0.35]
    )


@pytest.mark.parametrize("number", [0, 3])
def test_no_cone_is_drawn_where_friction_is_undetermined(number: int) -> None:
    nothing = np.zeros(number)
    axes = friction_cone(ConeData(nothing, nothing, nothing, np.full(number, "unused"), np.nan, (0.0, np.inf)))
    assert "μ" not in sound(axes)
    assert not marks(axes, "band")


def test_indentations_have_the_slope_of_the_compliance() -> None:
    force = np.linspace(0.01, 0.1, 8)
    axes = indentation(IndentationData(force, force / 250, np.full(8, 1e-5), 1 / 250, 1e-4, 1 / 250))
    x, y = points(axes, SLIDING).T
    np.testing.assert_allclose(x, 1e3 * force)
    fit = next(line for line in axes.lines if line.get_label() == "fit")
    np.testing.assert_allclose(np.interp(x, fit.get_xdata(), fit.get_ydata()), y)
    bare = sound(indentation(IndentationData(force, force / 250, np.full(8, np.nan), np.nan, np.nan)))
    assert "fit" not in bare


def map_of(points_m: np.ndarray, covariance: np.ndarray) -> MapData:
    return MapData(
        points_m,
        np.tile(covariance, (len(points_m), 1, 1)),
        np.arange(float(len(points_m))),
        points_m,
        np.array([[0, 1]]),
        np.array([[0, 1, 2], [0, 2, 1]]),
        points_m[:1],
    )


def test_a_map_of_equal_scales() -> None:
    data = map_of(np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.1, 0.05, 0.1]]), np.diag([4e-6, 1e-6, 1e-6]))
    above = contact_map(data, VIEWS[0])
    sound(above)
    assert np.ptp(above.get_xlim()) == pytest.approx(np.ptp(above.get_ylim()))
    box = above.get_window_extent()
    assert box.width == pytest.approx(box.height)
    dots = np.concatenate([found[::2] for found in marks(above, "dots")])
    np.testing.assert_allclose(dots, 1e3 * data.points_m[:, :2])
    assert data.enlargement == 1
    outline = marks(above, "ellipses")[0]
    np.testing.assert_allclose(np.ptp(outline[:25], axis=0), [8.0, 4.0], rtol=0.01)
    # opposite triangles turn the same way: none cuts a hole into the other
    for face in marks(above, "object")[0].reshape(-1, 3, 2):
        a, b = face[1] - face[0], face[2] - face[0]
        assert a[0] * b[1] - a[1] * b[0] >= 0


def test_small_ellipses_are_enlarged_by_what_the_key_says() -> None:
    data = map_of(np.array([[0.1, 0, 0], [0.2, 0, 0], [0.1, 0.01, 0]]), 1e-8 * np.eye(3))
    assert data.enlargement > 1
    outline = marks(contact_map(data, VIEWS[0]), "ellipses")[0]
    np.testing.assert_allclose(np.ptp(outline[:25], axis=0), 0.4 * data.enlargement, rtol=0.01)
    unknown = map_of(data.points_m, np.full((3, 3), np.nan))
    assert not marks(contact_map(unknown, VIEWS[0]), "ellipses")


def test_forces_across_the_antenna_lie_in_their_quadrant() -> None:
    force = np.array([[50.0, -10.0], [-40.0, 20.0]])
    axes = forces_across(force, np.full((2, 2), np.nan), np.arange(2.0))
    sound(axes)
    dots = np.concatenate([found[::2] for found in marks(axes, "dots")])
    np.testing.assert_allclose(dots, [*force, [0, 0]])
    box = axes.get_window_extent()
    assert box.width == pytest.approx(box.height)


@pytest.mark.parametrize(("low", "high"), [(0.065, 0.091), (0.005, 0.07), (1e-3, 40.0), (0.5, 0.5), (0.0, 1.0)])
def test_contour_levels_are_few_and_inside(low: float, high: float) -> None:
    found = contour_levels(low, high)
    assert all(low < level < high for level in found)
    assert len(found) <= 7
    assert bool(found) == (0 < low < high)


def test_a_map_of_nothing_is_still_a_picture() -> None:
    data = {"columns_px": [0, 1, 2], "rows_px": [0, 1], "unit": "mm", "has_ray": [[True, False, True]] * 2}
    assert "stroke-dasharray" in sound(heat_map("m", data | {"std": [[None] * 3] * 2}, (3, 2)))
    sound(heat_map("m", data | {"std": [[1.0] * 3] * 2}, (3, 2)))


def test_arrows_point_from_predicted_to_seen_enlarged() -> None:
    board = {"folder": "plane", "corners_px": [[100.0, 50.0]], "residuals_px": [[0.2, -0.1]], "good": [True]}
    axes = residual_arrows([board], (400, 300))
    factor = float(re.findall(r"([\d.]+) times", axes.get_title(loc="left"))[0])
    np.testing.assert_allclose(marks(axes, "arrows")[0], [[100, 50], [100 + 0.2 * factor, 50 - 0.1 * factor]])
    assert axes.get_ylim() == (299.5, -0.5)


def test_the_coverage_counts_every_corner() -> None:
    corners = np.random.default_rng(0).uniform(0, 1, (500, 2)) * [399, 299]
    counts = [int(count) for count in re.findall(r"<title>(\d+) corners</title>", sound(coverage(corners, (400, 300))))]
    assert (len(counts), sum(counts)) == (48, 500)
