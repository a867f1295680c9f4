"""The search for the antenna: its compiled functions against SciPy, rough paths, shapes along which two edges show."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import BSpline
from scipy.ndimage import maximum_filter, uniform_filter1d
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from vbaa_calib.core.polyline import arc_lengths, normals, offsets_from, resample
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.corridor import STARTS, Corridor, of_antennas_shape
from vbaa_calib.detect.whisker.profile import refine_path
from vbaa_calib.native import core

from .drawn_lines import SIZE, aside, background, bent, exposed, straight, trace, tube

RNG = np.random.default_rng(0)
LOOKS = np.column_stack([RNG.uniform(80.0, 200.0, (8, 3)), RNG.uniform(5.0, 15.0, 8)])


def test_smooth_curves() -> None:
    """Penalised B-splines by SciPy on the same table, solved densely."""
    pieces, stiffness, scales = 7, 0.3, (3.0, 1.0)
    share, weights = np.sort(RNG.uniform(-0.02, 1.02, 200)), RNG.uniform(0.5, 2.0, 200)
    values = np.sin(5.0 * share) + 0.1 * RNG.normal(size=200) + 4.0 * (RNG.uniform(size=200) < 0.1)
    knots = np.arange(-3.0, pieces + 3.1) / pieces
    table = np.clip(np.linspace(0.0, 1.0, 256), 0.0, 1.0 - 1e-15)
    splines = BSpline.design_matrix(table, knots, 3).toarray()
    rows = np.stack([np.interp(share, np.linspace(0.0, 1.0, 256), column) for column in splines.T], axis=1)
    # the table's rows are seen with the weights of the points between them
    place = np.clip(share, 0.0, 1.0) * 255.0
    row = np.minimum(place.astype(int), 254)
    bends, trusted = np.diff(np.eye(pieces + 3), 2, axis=0), weights
    for scale in scales:
        total, summed = np.zeros(256), np.zeros(256)
        for at, part in ((row, 1.0 - place + row), (row + 1, place - row)):
            np.add.at(total, at, trusted * part)
            np.add.at(summed, at, trusted * part * values)
        matrix = splines.T @ (total[:, None] * splines) + 1e-9 * np.eye(pieces + 3)
        matrix += stiffness * (weights.sum() / (pieces + 3) + 1e-12) * bends.T @ bends
        curve = rows @ np.linalg.solve(matrix, splines.T @ summed)
        trusted = weights / (1.0 + ((values - curve) / scale) ** 2)
    found = core.search.fit_smooth(share, values, weights, scales, pieces, stiffness)
    np.testing.assert_allclose(found, curve, atol=1e-9)


def test_small_systems_means_and_quantiles() -> None:
    root, sides = RNG.normal(size=(6, 6)), RNG.normal(size=(6, 3))
    matrix, solved = root @ root.T + np.eye(6), sides.copy()
    core.search.solve_definite(np.tril(matrix), solved)
    np.testing.assert_allclose(solved, np.linalg.solve(matrix, sides), rtol=1e-9)
    values = RNG.normal(size=50)
    for size in (1, 4, 9):
        for kind, mode in (("zeros", "constant"), ("end_value", "nearest"), ("mirrored", "reflect")):
            found = core.search.running_mean(values, size, getattr(core.search.Beyond, kind))
            np.testing.assert_allclose(found, uniform_filter1d(values, size, mode=mode), atol=1e-12)
    triangle = np.convolve(np.ones(5), np.ones(5)) / 5.0
    several = RNG.normal(size=(30, 2))
    expected = np.stack([np.convolve(column, triangle, "same") for column in several.T], axis=1)
    inside = slice(4, -4)  # beyond an end a sum of sums counts only what is there
    np.testing.assert_allclose(core.search.triangle_sums(several, 5)[inside], expected[inside], atol=1e-12)
    assert core.search.quantile(values, 0.3) == np.sort(values)[15]
    assert core.search.median(np.append(values, np.nan)) == np.sort(values)[25]
    assert np.isnan(core.search.quantile(np.append(values, np.nan), 1.0))


def test_polylines() -> None:
    line = np.cumsum(RNG.normal([2.0, 0.0], 1.0, (80, 2)), axis=0)
    along = np.append(0.0, np.hypot(*np.diff(line, axis=0).T).cumsum())
    np.testing.assert_allclose(arc_lengths(line), along)
    fine, at = resample(line, 0.3)
    np.testing.assert_allclose(at, np.arange(len(at)) * 0.3)
    assert along[-1] - 0.3 <= at[-1] < along[-1]
    np.testing.assert_allclose(fine, np.stack([np.interp(at, along, each) for each in line.T], axis=1), atol=1e-9)
    u, v = np.gradient(fine, axis=0).T
    across = np.stack([-v, u], axis=1) / np.hypot(u, v)[:, None]
    np.testing.assert_allclose(normals(fine), across, atol=1e-9)
    points = line[::3] + RNG.normal(size=(27, 2))
    nearest, distance = offsets_from(fine, points)
    expected = np.hypot(*(points[:, None] - fine).transpose(2, 0, 1)).argmin(axis=1)
    np.testing.assert_array_equal(nearest, expected)
    np.testing.assert_allclose(distance, ((points - fine[expected]) * across[expected]).sum(axis=1))


@pytest.mark.parametrize("depth", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("upward", [False, True])
def test_crossings_are_raw_pixels(depth: type, upward: bool) -> None:
    picture = RNG.uniform(0, 255, (60, 50)).astype(depth)
    path = np.array([[4.3, 20.2], [40.1, 29.7]])
    if upward:
        picture, path = np.ascontiguousarray(picture.T), path[:, ::-1]
    found = core.search.crossings(picture, path, 5, -1.0)
    line = np.arange(5, 41)[: len(found.along)]
    slope = 9.5 / 35.8
    place = 20.2 + slope * (line - 4.3)
    np.testing.assert_allclose(found.points[:, ::-1] if upward else found.points, np.stack([line, place], axis=1))
    np.testing.assert_allclose(found.stretch, np.hypot(1.0, slope))
    np.testing.assert_allclose(found.bow, 0.0, atol=1e-12)
    assert found.inside.all()
    pixel = np.rint(place).astype(int)[:, None] + np.arange(-5, 6)
    np.testing.assert_allclose(found.across, pixel - place[:, None])
    seen = picture[line[:, None], pixel] if upward else picture[pixel, line[:, None]]
    np.testing.assert_array_equal(found.profiles, -seen.astype(float))


@pytest.mark.parametrize("bright", [True, False])
def test_a_path_moves_onto_a_curved_line(bright: bool) -> None:
    truth = bent((40.0, 120.0), 0.0, 12.0)
    line = tube(truth, 3.0, 80.0)
    picture = 100.0 + (line if bright else -line)
    rough = truth + np.outer(np.linspace(0.0, 5.0, len(truth)), [0.0, 1.0])
    found = refine_path(picture.astype(np.float32), rough, 3.0, 12.0, bright)[2:-6]
    assert np.abs(aside(truth, found)).max() < 0.15


@pytest.mark.parametrize("sign", [-1, 0, 1])
@pytest.mark.parametrize(("reach", "pool"), [(2, 1), (3, 2), (1, 3)])
def test_ridges(sign: int, reach: int, pool: int) -> None:
    small = RNG.integers(0, 256, (23, 31)).astype(np.uint8)
    diagonal = int(np.ceil(reach / np.sqrt(2.0)))
    expected = []
    for right, down in ((0, reach), (diagonal, diagonal), (reach, 0), (diagonal, -diagonal)):
        framed = np.pad(small.astype(int), reach, mode="edge")
        at = np.ix_(np.arange(23) + reach, np.arange(31) + reach)
        one, other = (np.roll(framed, (s * down, s * right), (0, 1))[at] for s in (1, -1))
        above, below = small - np.maximum(one, other), np.minimum(one, other) - small
        response = {1: above, -1: below, 0: np.maximum(above, below)}[sign].clip(0)
        expected.append(maximum_filter(response, 2 * pool - 1, mode="constant")[::pool, ::pool].ravel())
    flat = core.search.ridge_responses(small, reach, pool, sign)
    np.testing.assert_array_equal(flat, np.append(np.concatenate(expected), 0))
    index = RNG.integers(0, len(flat), (40, 12)).astype(np.int32)
    texture = 1 + np.flatnonzero(np.cumsum(np.bincount(flat, minlength=256)) >= 0.8 * len(flat))[0]
    over = np.maximum(np.arange(256) - max(texture, 1), 0)
    clear = np.rint(250.0 * over / (over + 3.0 * max(texture, 1)))
    np.testing.assert_allclose(core.search.scores(flat, index, np.full(40, 12.0)), clear[flat[index]].mean(axis=1))


def test_places_of_paths_and_those_that_differ() -> None:
    paths = np.cumsum(RNG.normal([2.0, 1.0], 1.0, (9, 40, 2)), axis=1)
    steps = np.array([[0, 1], [1, 1], [1, 0], [1, -1]]) / np.sqrt([[1], [2], [1], [2]])
    framed = np.pad(paths, ((0, 0), (1, 1), (0, 0)), mode="edge")
    way = framed[:, 2:] - framed[:, :-2]
    direction = np.abs(way[..., :1] * steps[:, 1] - way[..., 1:] * steps[:, 0]).argmax(axis=-1)
    column, row = np.moveaxis(np.rint(((paths + 0.5) / 3 - 0.5) / 2).astype(int), -1, 0)
    inside = (column >= 0) & (column < 12) & (row >= 0) & (row < 6)
    expected = np.where(inside, (direction * 6 + row) * 12 + column, 4 * 6 * 12)
    np.testing.assert_array_equal(core.search.places(paths, 3, 2, (6, 12)), expected)
    fan = np.linspace(0.0, 1.0, 40)[:, None] * np.array([[[100.0, tip]] for tip in (0.0, 1.0, 60.0, 30.0)])
    assert core.search.clearest_paths(np.array([5.0, 4.9, 2.0, 4.0]), fan, 5.0, 4, 0.5) == [0, 3]


def _free() -> SimpleNamespace:
    axes = Rotation.from_euler("xyz", [0.1, 0.2, -0.3]).as_matrix()
    segments = np.tile([0.005, 0.0, 0.0], (48, 1)) + np.outer(np.linspace(0.0, 1.0, 48), [0.0, 0.0003, -0.0002])
    return SimpleNamespace(clamp_m=np.array([-0.1, 0.02, 0.4]), axes=axes, segments_m=segments)


def _curve(free: SimpleNamespace, unknowns: np.ndarray) -> np.ndarray:
    """The bent antenna's points, its segments turned one by one."""
    offset, turn, lateral, depth, place = unknowns
    left = np.maximum(1.0 - (np.arange(48) + 0.5) / (48 * np.exp(place)), 0.0)
    turned = 1.0 - left**2 - (lateral**2 + depth**2) / 30.0 * (left**2 - left**6)
    steps = Rotation.from_rotvec(turned[:, None] * [0.0, -depth, lateral]).apply(free.segments_m)
    steps[:, :2] += turn * np.stack([-steps[:, 1], steps[:, 0]], axis=1)
    own = np.array([0.0, offset, 0.0]) + np.insert(steps.cumsum(axis=0), 0, 0.0, axis=0)
    points = free.clamp_m + own @ free.axes
    return points[:, :2] / points[:, 2:]


def test_bent_shapes() -> None:
    free, allowed, sigma = _free(), (0.002, 0.05, 3.0), 1e-4
    truth = np.array([0.001, 0.02, 0.5, 0.2, np.log(0.6)])
    curve = core.search.bent(free, truth)
    np.testing.assert_allclose(curve, _curve(free, truth), atol=1e-12)
    seen = curve[2:-2:2] + sigma * RNG.normal(size=(23, 2))

    def misfit(unknowns: np.ndarray) -> float:
        parts = []
        for a, b in pairwise(_curve(free, unknowns)):
            share = np.clip((seen - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            parts.append(np.hypot(*(seen - a - share[:, None] * (b - a)).T))
        clamp = (unknowns[0] / allowed[0]) ** 2 + (unknowns[1] / allowed[1]) ** 2
        return float(np.mean(np.min(parts, axis=0) ** 2) / sigma**2 + clamp)

    found, unknowns = core.search.nearest_shape(free, seen, np.full(23, sigma**2), allowed, 0.0, STARTS)
    assert found == pytest.approx(misfit(np.array(unknowns)), rel=1e-3)
    best = minimize(misfit, truth, method="Nelder-Mead", options={"maxiter": 3000, "xatol": 1e-7, "fatol": 1e-7})
    assert found < 1.05 * best.fun + 0.01
    means, variance = core.search.means_of_runs(seen, np.full(23, sigma), 5)
    runs = np.split(seen, np.arange(1, 5) * 23 // 5)
    np.testing.assert_allclose(means, [run.mean(axis=0) for run in runs])
    np.testing.assert_allclose(variance, [sigma**2 / len(run) for run in runs])


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_colours(depth: type) -> None:
    level = 257.0 if depth == np.uint16 else 1.0
    path = resample(np.array([[5.0, 40.0], [90.0, 55.0]]), 1.0)[0]
    share = np.linspace(0.0, 1.0, len(path))
    usual = np.stack([np.interp(share, (np.arange(8) + 0.5) / 8, each) for each in LOOKS.T])
    picture = RNG.uniform(0.0, 60.0, (80, 100, 3))
    v, u = np.mgrid[:80, :100]
    apart, nearest = cKDTree(path).query(np.stack([u, v], axis=-1))
    picture[apart < 4.0] = 0.8 * usual[:3].T[nearest[apart < 4.0]]
    picture[:, 60:75] *= [1.0, 0.2, 0.6]
    taken = (picture * level).astype(depth)
    colours = core.search.colours_at(taken, level, path)
    column, row = np.rint(path.T).astype(int)
    np.testing.assert_allclose(colours, taken[row, column] / level)
    other, off, hue, tinted = core.search.foreign(taken, level, path, share, LOOKS)
    root = share < 0.4
    lit = np.median((colours.T * usual[:3]).sum(axis=0)[root] / (usual[:3] ** 2).sum(axis=0)[root])
    run = uniform_filter1d(colours.T - lit * usual[:3], 15, axis=1, mode="nearest")
    np.testing.assert_allclose(off, np.linalg.norm(run, axis=0) / (lit * usual[3]), rtol=1e-6)
    means = uniform_filter1d(colours.T, 15, axis=1, mode="nearest")
    local = np.clip((means * usual[:3]).sum(axis=0) / (usual[:3] ** 2).sum(axis=0), 0.33 * lit, 1.15 * lit)
    left = np.linalg.norm(means - local * usual[:3], axis=0)
    np.testing.assert_allclose(hue, left / (local * usual[3]), rtol=1e-6)
    tint = left / np.sqrt((usual[:3] ** 2).sum(axis=0) * local * lit)
    alike = np.sort(tint[off < 2.5])
    np.testing.assert_array_equal(tinted, tint > 2.0 * alike[int(0.9 * len(alike))])
    np.testing.assert_array_equal(other, maximum_filter(off > 4.0, 15))
    assert other.any()
    assert not other.all()


WIDTH_PX = 2.3


def corridor(axis_px: np.ndarray) -> Corridor:
    """What detection allows around a free antenna."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(axis_px, axis=0), axis=1))])
    return Corridor(axis_px, 8.0 + 0.6 * along, WIDTH_PX)


def free(length_px: float = 225.0) -> np.ndarray:
    """(K, 2) the free antenna: straight to the right from (40, 120)."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return np.array([40.0, 120.0]) + share * np.array([length_px, 0.0])


@pytest.mark.parametrize("turn_deg", [-45.0, -20.0, 0.0, 30.0, 45.0])
@pytest.mark.parametrize("bright", [True, False, None])
def test_finds_bent_lines(turn_deg: float, bright: bool | None) -> None:
    rng = np.random.default_rng(abs(int(turn_deg)))
    path = bent((40.0, 122.0), 0.0, turn_deg)
    line = tube(path, WIDTH_PX, 80.0)
    # with None glaring at the clamp, darker than its surroundings at the tip
    sign = np.interp(np.arange(line.shape[1]), [40, 130, 150, 265], [1.0, 0.4, -0.4, -1.0]) if bright is None else 1.0
    picture = exposed(background(rng) + 80.0 + (-line if bright is False else sign * line), rng)
    found = trace(picture, corridor(free()), bright)
    inside = found[:, 0] < path[:, 0].max() - 4
    assert inside.sum() > 60
    assert np.abs(aside(path, found[inside])).max() < (3.0 if bright is None else 2.5)


def test_bridges_what_hides_the_antenna() -> None:
    rng = np.random.default_rng(1)
    path = bent((40.0, 120.0), 0.0, 30.0)
    picture = background(rng) + tube(path, WIDTH_PX, 80.0)
    picture[:, 130:165] = 150.0
    found = trace(exposed(picture, rng), corridor(free()))
    seen = (found[:, 0] < 122) | (found[:, 0] > 175)
    inside = seen & (found[:, 0] < path[:, 0].max() - 4)
    assert np.abs(aside(path, found[inside])).max() < 2.5
    assert np.abs(aside(path, found[(found[:, 0] > 130) & (found[:, 0] < 165)])).max() < 12.0


def test_a_brighter_edge_and_a_line_that_does_not_start_at_the_clamp_are_no_lure() -> None:
    rng = np.random.default_rng(2)
    path = bent((40.0, 120.0), 0.0, 15.0)
    picture = background(rng, 2.0) + tube(path, WIDTH_PX, 60.0)
    picture[:60] += 120.0
    picture = picture + tube(np.array([[180.0, 80.0], [260.0, 84.0]]), WIDTH_PX, 90.0)
    found = trace(exposed(picture, rng), corridor(free()))
    inside = found[:, 0] < path[:, 0].max() - 4
    assert np.abs(aside(path, found[inside])).max() < 2.5


def test_a_corridor_that_leaves_the_picture_is_followed_as_far_as_it_goes() -> None:
    rng = np.random.default_rng(3)
    path = straight(0.0, 500.0, (290.0, 120.0))
    found = trace(exposed(background(rng) + tube(path, WIDTH_PX, 80.0), rng), corridor(free(500.0)))
    assert np.isfinite(found).all()
    assert np.abs(aside(path, found[found[:, 0] < 315])).max() < 2.5


def test_resampling_and_normals() -> None:
    points, at = resample(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]]), 0.5)
    np.testing.assert_allclose(at, np.arange(0.0, 11.0, 0.5))
    np.testing.assert_allclose(points[10], [3.0, 4.0])
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), 0.5)
    circle = np.stack([np.cos(np.linspace(0, 1, 50)), np.sin(np.linspace(0, 1, 50))], axis=1)
    np.testing.assert_allclose(normals(circle)[1:-1], -circle[1:-1], atol=1e-9)


@pytest.mark.parametrize("changing", [True, False])
@pytest.mark.parametrize(
    ("passes_px", "turned_rad", "verdict"), [(1.0, 0.0, "ok"), (30.0, 0.0, "no_antenna"), (0.0, 0.3, "no_antenna")]
)
def test_before_the_rig_is_known_a_line_must_leave_the_clamp(
    passes_px: float, turned_rad: float, verdict: str, changing: bool
) -> None:
    """A cable that passes it, or leaves it at an angle, is none, however much of it is seen."""
    points = free() + np.outer(np.linspace(0.0, 225.0, 60) * np.tan(turned_rad) + passes_px, [0.0, 1.0])
    seen = np.zeros(60, np.uint8)
    line = Centreline(points, np.full(60, 0.1), 1.0, 50.0, 1.0, "ok", "", guide_px=points, visibility=seen)
    assert of_antennas_shape(line, corridor(free()), changing).verdict == verdict


WIDTH_PX_SEARCH, SPACING_PX, LENGTH_PX = 5.0, 6.0, 200.0
CONTACTS = np.array([0.25, 0.5, 0.75, 1.0])
NO_LOOKS = np.empty((0, 4))
ODDS = SimpleNamespace(
    surface_spread=50.0,
    colour_spread=15.0,
    edge_rate=0.1,
    hidden_odds=-1.5,
    hidden_root_odds=-3.0,
    correlation_px=6.0,
    strain_std=0.01,
    look_odds=2.0,
)


def shape(turn_rad: float, contact: float = 0.6, heading_rad: float = 0.0) -> np.ndarray:
    """(73, 2) the axis, turned at its tip as a force at a part of its length does."""
    reach = np.linspace(0.0, 1.0, 73) / contact
    bend = np.where(reach < 1.0, reach * (2.0 - reach), 1.0)
    angle = heading_rad + turn_rad * bend / bend[-1]
    along = LENGTH_PX / 72 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start = np.array([[159.5, 119.5]]) - 100.0 * np.array([[np.cos(heading_rad), np.sin(heading_rad)]])
    return start + np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (along[1:] + along[:-1]), axis=0)])


def found(picture: np.ndarray, heading_rad: float = 0.0, looks: np.ndarray = NO_LOOKS, most: int = 2) -> list:
    """The shapes about a straight axis."""
    turns = np.arange(-0.6, 0.61, 0.05)
    paths = np.array([shape(turn, contact, heading_rad) for contact in CONTACTS for turn in turns])
    axis = shape(0.0, 1.0, heading_rad)
    taken = np.ascontiguousarray(picture)
    return core.search.likely_shapes(
        taken, axis, paths, SPACING_PX, WIDTH_PX_SEARCH, CONTACTS, (1.5, 0.015), looks, ODDS, most
    )


def drawn(path: np.ndarray, height: float = 60.0, seed: int = 3) -> np.ndarray:
    """(H, W) float32: a tube before blots."""
    rng = np.random.default_rng(seed)
    return exposed(background(rng) + 40.0 + tube(path, WIDTH_PX_SEARCH, height), rng)


def off(path: np.ndarray, true: np.ndarray) -> float:
    """How far the points of a path are from the true line on average, px: at clear edges odds do not tell a pixel."""
    return float(np.abs(aside(true, path)).mean())


TRUE = shape(0.37)
PICTURE = drawn(TRUE)


@pytest.mark.parametrize("height", [60.0, -50.0, 25.0])
def test_a_tube_is_found_whatever_its_polarity(height: float) -> None:
    """Brighter or darker than what it is before: the middle of its edges."""
    assert off(found(drawn(TRUE, height))[0][2], TRUE) < 1.0


@pytest.mark.parametrize("colour", [(30.0, 30.0, -30.0), (-25.0, 25.0, 0.0), (40.0, 0.0, 0.0)])
def test_a_tube_is_found_whatever_its_colour(colour: tuple[float, float, float]) -> None:
    """Also one that is hardly brighter or darker than its background."""
    picture = np.stack([drawn(TRUE, height, seed=4 + k) for k, height in enumerate(colour)], axis=-1)
    assert off(found(picture.astype(np.uint8))[0][2], TRUE) < 1.0


def test_its_background_may_change_along_it() -> None:
    """Brighter than one half of what is behind it and darker than the other."""
    changing = np.where(np.arange(SIZE[1]) < 150, 60.0, 160.0)
    tubes = tube(TRUE, WIDTH_PX_SEARCH, 1.0)
    picture = exposed(changing + (110.0 - changing) * np.clip(2.0 * tubes, 0.0, 1.0), np.random.default_rng(5))
    assert off(found(picture)[0][2], TRUE) < 1.0


def test_a_mirrored_picture_shows_the_mirrored_shape() -> None:
    """Up and down exchanged about the axis."""
    (_, bend, path, _), *_ = found(PICTURE)
    (_, other, mirrored, _), *_ = found(PICTURE[::-1])
    assert_allclose(mirrored, path * [1.0, -1.0] + [0.0, SIZE[0] - 1.0], atol=2.0)
    assert abs(bend[1] + other[1]) < 0.03


def test_a_turned_picture_shows_the_turned_shape() -> None:
    """By half a turn about its middle, as the axis is."""
    path, turned = found(PICTURE)[0][2], found(PICTURE[::-1, ::-1], np.pi)[0][2]
    assert_allclose(turned, np.array(SIZE[::-1]) - 1.0 - path, atol=2.0)


@pytest.mark.parametrize("exposure", [lambda level: 0.6 * level, lambda level: 255.0 - level, lambda level: level + 40])
def test_light_does_not_matter(exposure: Callable[[np.ndarray], np.ndarray]) -> None:
    """Scaled, inverted or raised levels show the same shape."""
    assert_allclose(found(exposure(PICTURE))[0][2], found(PICTURE)[0][2], atol=2.0)


def test_what_hides_its_middle_does_not_matter() -> None:
    """A bar across it, with edges of its own."""
    picture = PICTURE.copy()
    picture[:, 130:165] = 200.0
    evidence, _, path, odds = found(picture)[0]
    hidden = (path[:, 0] > 132) & (path[:, 0] < 162)
    assert off(path, TRUE) < 1.0
    assert odds[hidden].mean() < 0.5 * odds[~hidden].mean()
    assert evidence < found(PICTURE)[0][0]


def test_an_empty_picture_shows_little() -> None:
    """Its best shape has far less evidence, and a flat picture's has less than none."""
    empty = exposed(background(np.random.default_rng(3)) + 40.0, np.random.default_rng(3))
    assert found(empty)[0][0] < 0.25 * found(PICTURE)[0][0]
    assert found(np.full(SIZE, 90, np.uint8))[0][0] < 0.0


def test_kinds_of_pictures_agree() -> None:
    """Bytes, sixteen bits and floats, grey and three equal channels."""
    level = np.rint(PICTURE).astype(np.uint8)
    evidence, _, path, _ = found(level)[0]
    for same in (level.astype(np.uint16) * 257, level.astype(np.float32), level.astype(float), level[..., None]):
        other, _, others, _ = found(same)[0]
        assert_allclose(others, path, atol=1e-6)
        assert_allclose(other, evidence, rtol=1e-6)
    assert off(found(np.repeat(level[..., None], 3, axis=2))[0][2], TRUE) < 1.0


@pytest.mark.parametrize("coloured", [False, True])
def test_the_line_that_looks_as_the_antenna_does_wins(coloured: bool) -> None:
    """Of two tubes, by their luma alone where the picture is grey."""
    other, rng = shape(-0.37), np.random.default_rng(6)
    light = 90.0 + tube(TRUE, WIDTH_PX_SEARCH, 50.0) - tube(other, WIDTH_PX_SEARCH, 60.0)
    picture = np.clip(exposed(light, rng, 1.0), 0, 255).astype(np.uint8)
    taken = np.repeat(picture[..., None], 3, axis=2) if coloured else picture
    for level, path in ((135.0, TRUE), (36.0, other)):
        looks = np.repeat([[level, level, level, 10.0]], 8, axis=0)
        assert off(found(taken, looks=looks)[0][2], path) < 1.0


def test_shapes_come_with_what_they_are_made_of() -> None:
    """The best one first; each another one; evidence is what its places' odds add up to, less what bending costs."""
    shapes = found(PICTURE, most=4)
    assert 1 <= len(shapes) <= 4
    assert [one[0] for one in shapes] == sorted((one[0] for one in shapes), reverse=True)
    for evidence, (contact, turn, _, _), path, odds in shapes:
        strain = turn * WIDTH_PX_SEARCH / (min(contact, 1.0) * LENGTH_PX) / ODDS.strain_std
        assert_allclose(evidence, LENGTH_PX / ODDS.correlation_px * odds.mean() - 0.5 * strain**2, rtol=1e-3)
        assert path.shape == (73, 2)
