"""The report's plots: what is drawn lies where its value is, and any number of frames fits."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from viz.plots.svg import Axes
from viz.report.clock import Clock, by_column
from viz.report.cone import ConeData, YieldData, cone, yields
from viz.report.map import Chart, colours, maps, scatter_across
from viz.report.time import MEASURED, curve, lanes, signals

STATUS = {"ok": "#00ff00", "failed": "#ff0000"}
TEAL_DOTS = 5.0


def dots_of(svg: str, colour: str, size: float = TEAL_DOTS) -> np.ndarray:
    """(N, 2) where the filled points of a colour are, px."""
    found = []
    for path in ElementTree.fromstring(svg).iter("path"):
        if path.get("stroke") == colour and path.get("stroke-width") == f"{size:g}":
            found += re.findall(r"M([-\d.]+) ([-\d.]+)h0", path.get("d", ""))
    return np.array(found, float).reshape(-1, 2)


def clock(number: int, step_s: float = 0.1, start_s: float = 0.0) -> Clock:
    return Clock.of(start_s + step_s * np.arange(number))


def test_a_curve_puts_points_where_their_values_are() -> None:
    value = np.array([1.0, 2.0, np.nan, 4.0, np.nan, 3.0])
    svg = curve("force", "mN", clock(6), value, np.full(6, 0.1), value + 0.05)
    x, y = dots_of(svg, MEASURED).T
    np.testing.assert_allclose(np.corrcoef(y, [1, 2, 4, 3])[0, 1], -1.0, atol=1e-4)
    np.testing.assert_allclose(np.diff(x) / np.diff(x)[0], [1.0, 2.0, 2.0], atol=0.01)


def test_the_band_is_two_standard_deviations_wide_and_a_hopeless_one_is_cut() -> None:
    std = np.full(9, 0.1)
    std[4] = 1e6
    picture = ElementTree.fromstring(curve("force", "mN", clock(9), np.zeros(9), std))
    band = next(iter(picture.iter("polygon")))
    y = np.array(re.findall(r",([-\d.]+)", band.get("points", "")), float)
    low, high = y.max(), y.min()
    grid = [float(line.get("y1", "")) for line in picture.iter("line") if line.get("x1") == "148.0"]
    assert 34.0 <= high < low <= 190.0 - 24.0
    labels = [
        float(text.text.replace("−", "-"))
        for text in picture.iter("text")
        if text.get("text-anchor") == "end" and text.text
    ]
    scale = (grid[0] - grid[-1]) / (labels[-1] - labels[0])
    # 20 of 22 corners stand at ± 0.2 mN
    np.testing.assert_allclose(
        (np.median(y[y > np.median(y)]) - np.median(y[y < np.median(y)])) / scale, 0.4, rtol=0.02
    )


@pytest.mark.parametrize("value", [np.full(4, np.nan), np.full(4, 3.0), np.zeros(4)])
def test_a_curve_of_nothing_or_of_one_value_is_still_a_picture(value: np.ndarray) -> None:
    svg = curve("force", "mN", clock(4), value, np.full(4, np.nan))
    assert len(dots_of(svg, MEASURED)) == np.isfinite(value).sum()
    ElementTree.fromstring(signals("slip", "mm/s", clock(4), [("a", "#000", value)], np.full(4, np.nan), "noise"))


def test_one_frame_is_enough() -> None:
    ElementTree.fromstring(curve("force", "mN", clock(1), np.array([1.0]), np.array([0.1])))
    ElementTree.fromstring(lanes("status", clock(1), ["ok"], STATUS))
    assert Clock.of(np.array([3.0, 3.0])).step_s == 1.0


def test_a_clock_that_counts_from_1970_is_told_from_its_first_frame() -> None:
    assert clock(3).label == "time, s"
    late = clock(3, start_s=1.7e9)
    assert late.label == "time after 1700000000 s, s"
    np.testing.assert_allclose(late.time_s, [0.0, 0.1, 0.2], atol=1e-6)


def test_columns_keep_the_extremes_of_every_number_of_frames() -> None:
    rng = np.random.default_rng(1)
    x, value = np.sort(rng.uniform(0, 10, 20_000)), rng.normal(size=20_000)
    found = by_column(Axes((0.0, 10.0), (-5.0, 5.0), 960.0), x, value, value)
    assert len(found.x) <= 960
    assert found.low.min() == value.min()
    assert found.high.max() == value.max()
    assert (found.low <= found.middle).all()
    assert (found.middle <= found.high).all()
    assert np.median(np.abs(found.middle)) < 0.4


def test_a_gap_in_time_breaks_the_band() -> None:
    time = np.concatenate([np.arange(5), 100 + np.arange(5)]) * 0.1
    picture = ElementTree.fromstring(curve("l", "mm", Clock.of(time), np.ones(10), np.ones(10)))
    assert len(list(picture.iter("polygon"))) == 2


def test_lanes_show_every_label_with_its_count() -> None:
    svg = lanes("status", clock(4), ["ok", "failed", "ok", "ok"], STATUS)
    picture = ElementTree.fromstring(svg)
    said = [text.text for text in picture.iter("text")]
    assert "ok (3)" in said
    assert "failed (1)" in said
    width = {rect.get("fill"): 0.0 for rect in picture.iter("rect")}
    for rect in picture.iter("rect"):
        width[rect.get("fill")] += float(rect.get("width", ""))
    assert width["#00ff00"] == pytest.approx(3 * width["#ff0000"], abs=0.5)


def test_one_bad_frame_of_very_many_is_still_seen() -> None:
    label = ["ok"] * 50_000
    label[31_234] = "failed"
    picture = ElementTree.fromstring(lanes("status", clock(50_000, 1 / 30), label, STATUS))
    bad = [rect for rect in picture.iter("rect") if rect.get("fill") == "#ff0000"]
    assert len(bad) == 1
    assert float(bad[0].get("height", "")) > 1.0
    assert len(list(picture.iter("rect"))) < 50


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
    svg = cone(data)
    said = "".join(ElementTree.fromstring(svg).itertext())
    assert "α = 16.7°, μ = 0.3" in said
    apart = dots_of(svg, "#0072b2")
    assert len(apart) == 2
    rays = [
        np.array([pair.split(",") for pair in line.get("points", "").split()], float)
        for line in ElementTree.fromstring(svg).iter("polyline")
        if line.get("stroke") == "#0f766e"
    ]
    for point, ray in zip(apart, sorted(rays, key=lambda r: r[1, 1]), strict=True):
        along = (point[0] - ray[0, 0]) / (ray[1, 0] - ray[0, 0])
        assert ray[0, 1] + along * (ray[1, 1] - ray[0, 1]) == pytest.approx(point[1], abs=0.3)


@pytest.mark.parametrize("number", [0, 3])
def test_no_cone_is_drawn_where_friction_cannot_be_told(number: int) -> None:
    nothing = np.zeros(number)
    svg = cone(ConeData(nothing, nothing, nothing, np.full(number, "unused"), np.nan, (0.0, np.inf)))
    assert "μ" not in svg
    assert "polygon" not in svg
    assert "nan" not in svg


def test_yields_have_the_slope_of_the_compliance() -> None:
    force = np.linspace(0.01, 0.1, 8)
    svg = yields(YieldData(force, force / 250, np.full(8, 1e-5), 1 / 250, 1e-4, 1 / 250))
    x, y = dots_of(svg, "#0072b2").T
    line = next(p for p in ElementTree.fromstring(svg).iter("polyline") if p.get("stroke") == "#0f766e")
    ends = np.array([pair.split(",") for pair in line.get("points", "").split()], float)
    np.testing.assert_allclose(np.interp(x, ends[:, 0], ends[:, 1]), y, atol=0.2)
    bare = yields(YieldData(force, force / 250, np.full(8, np.nan), np.nan, np.nan))
    assert "fit" not in bare
    assert "nan" not in bare


def test_a_map_of_equal_scales() -> None:
    points = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.1, 0.05, 0.1]])
    nothing = np.zeros((0, 3))
    chart = Chart(
        points,
        np.tile(np.diag([4e-6, 1e-6, 1e-6]), (3, 1, 1)),
        np.arange(3.0),
        points,
        np.array([[0, 1]]),
        np.array([[0, 1, 2]]),
        nothing,
    )
    above = re.findall(r"<svg.*?</svg>", maps(chart))[0]
    where = [re.findall(r"translate\(([-\d.]+) ([-\d.]+)\)", above)][0]
    a, b, c = np.array(where, float)
    np.testing.assert_allclose(np.hypot(*(c - a)) / np.hypot(*(b - a)), 0.5, rtol=0.01)
    radii = np.array(re.findall(r'<ellipse rx="([\d.]+)" ry="([\d.]+)"', above), float)
    np.testing.assert_allclose(radii[:, 0] / radii[:, 1], 2.0, rtol=0.02)
    # 100 mm of x are as long as the distance of the first two contacts; twice the deviation of 2 mm is the ellipse's
    assert "drawn" not in maps(chart)
    np.testing.assert_allclose(radii[0, 0] / np.hypot(*(b - a)), 4.0 / 100.0, rtol=0.02)


def test_small_ellipses_are_enlarged_and_said_to_be() -> None:
    points = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])
    none = np.zeros((0, 3))
    tiny = np.tile(1e-8 * np.eye(3), (2, 1, 1))
    svg = maps(Chart(points, tiny, np.arange(2.0), none, np.zeros((0, 2), int), np.zeros((0, 3), int), none))
    larger = int(re.findall(r"drawn (\d+) times larger", svg)[0])
    radius = float(re.findall(r'<ellipse rx="([\d.]+)"', svg)[0])
    across = np.diff([float(x) for x in re.findall(r"translate\(([-\d.]+) ", svg)[:2]])[0]
    assert radius == pytest.approx(larger * 0.2 / 100 * across, rel=0.02)
    unknown = np.full((2, 3, 3), np.nan)
    assert "<ellipse" not in maps(
        Chart(points, unknown, np.zeros(2), none, np.zeros((0, 2), int), np.zeros((0, 3), int), none)
    )


def test_forces_across_the_antenna_lie_in_their_quadrant() -> None:
    force = np.array([[50.0, -10.0], [-40.0, 20.0]])
    svg = scatter_across(force, np.full((2, 2), np.nan), np.arange(2.0))
    middle = dots_of(svg, "#1f2937")[0]
    first, second = (dots_of(svg, colour, 3.6)[0] - middle for colour in colours(np.arange(2.0)))
    assert first[0] > 0 > second[0]
    assert first[1] > 0 > second[1]
    np.testing.assert_allclose(first / [50.0, 10.0], second / [-40.0, -20.0], rtol=0.02)
    assert first[0] / 50.0 == pytest.approx(first[1] / 10.0, rel=0.02)
    assert "nan" not in svg
