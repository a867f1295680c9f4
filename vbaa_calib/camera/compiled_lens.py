"""A lens inside compiled functions: the same maps as `models`, `lens` and `inverse`, point by point.

Only what a few Newton steps solve is solved here: what is not valid may be so for `inverse`, which spares no effort.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import compiled, kernel, record
from vbaa_calib.core.lanes import LANES, load, spread, store, where_positive

from .lens import Intrinsics, lens_of

_NONE, _RADIAL, _FULL = 0, 1, 2
_STEPS = 5
_SMALL_ANGLE_SQUARED = 1e-6
_LEAST_DEPTH = 1e-12


class CompiledLens(NamedTuple):
    """A lens and its camera matrix in plain arrays, see `lens.Lens`.

    Attributes
    ----------
    fisheye : on the equidistant chart. tilted : a sensor's tilt, which is not compiled.
    path : 0 no distortion, 1 radial, 2 with decentring or prism.
    matrix : (4,) fx, fy, cx, cy. coefficients : (14,), the last of them zeros; `distortions` of them are parameters.
    nodes, steps, nodes_per_unit, limits : of the radial table; limits (2,) are the largest ideal and distorted radius.
    ideal, reach : (S,) radii of the trusted region's rims; inner (2,) their least.
    """

    fisheye: bool
    tilted: bool
    path: int
    matrix: np.ndarray
    coefficients: np.ndarray
    distortions: int
    nodes: np.ndarray
    steps: np.ndarray
    nodes_per_unit: float
    limits: np.ndarray
    ideal: np.ndarray
    reach: np.ndarray
    inner: np.ndarray


Lens = record(CompiledLens)


@lru_cache(maxsize=32)
def compiled_lens(intrinsics: Intrinsics) -> CompiledLens:
    """Made ready for compiled functions."""
    lens, model = lens_of(intrinsics), intrinsics.model
    coefficients = np.zeros(14)
    coefficients[: len(intrinsics.coefficients)] = intrinsics.coefficients
    full = not (lens.undistorted or lens.radial)
    return CompiledLens(
        model.is_fisheye,
        bool(coefficients[12:].any()),
        _NONE if lens.undistorted else _RADIAL if lens.radial else _FULL,
        np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy], float),
        coefficients,
        len(intrinsics.coefficients),
        lens.nodes,
        np.append(np.diff(lens.nodes), 0.0),
        lens.nodes_per_unit,
        np.array([lens.ideal_limit, lens.distorted_limit if lens.undistorted else lens.table_limit]),
        lens.ideal_rim,
        lens.reach_rim,
        np.array([lens.ideal_rim.min(), lens.reach_rim.min()]) if full else np.ones(2),
    )


@compiled
def radial(fisheye, c, s):
    """Radial gain at a squared radius, and its slope by that."""
    if fisheye:
        gain = 1.0 + s * (c[0] + s * (c[1] + s * (c[2] + s * c[3])))
        return gain, c[0] + s * (2.0 * c[1] + s * (3.0 * c[2] + s * (4.0 * c[3])))
    top = 1.0 + s * (c[0] + s * (c[1] + s * c[4]))
    by_top = c[0] + s * (2.0 * c[1] + s * (3.0 * c[4]))
    under = 1.0 / (1.0 + s * (c[5] + s * (c[6] + s * c[7])))
    by_under = c[5] + s * (2.0 * c[6] + s * (3.0 * c[7]))
    gain = top * under
    return gain, (by_top - gain * by_under) * under


@compiled
def _linearise_lens(fisheye, c, x, y):
    """The distorted point, its derivatives by x and y (xx, xy, yx, yy)."""
    s = x * x + y * y
    gain, by_s = radial(fisheye, c, s)
    along_x, along_y = 2.0 * by_s * x, 2.0 * by_s * y
    if fisheye:
        return x * gain, y * gain, gain + x * along_x, x * along_y, x * along_y, gain + y * along_y
    p1, p2, s1, s2, s3, s4 = c[2], c[3], c[8], c[9], c[10], c[11]
    gain = gain + 2.0 * (p1 * y + p2 * x)
    xd, yd = x * gain + s * (p2 + s1 + s2 * s), y * gain + s * (p1 + s3 + s4 * s)
    shear = x * (along_y + 2.0 * p1) + 2.0 * p2 * y
    slope_x, slope_y = 2.0 * s1 + 4.0 * s2 * s, 2.0 * s3 + 4.0 * s4 * s
    xx, yy = gain + x * (along_x + 4.0 * p2 + slope_x), gain + y * (along_y + 4.0 * p1 + slope_y)
    return xd, yd, xx, shear + y * slope_x, shear + x * slope_y, yy


@compiled
def _encloses(radii, inner, x, y):
    """Whether a rim, a radius in each of evenly spaced directions from −π on, encloses a point."""
    square = x * x + y * y
    if square < inner * inner:
        return True
    if not np.isfinite(square):
        return False
    place = (np.arctan2(y, x) + np.pi) * ((len(radii) - 1) / (2.0 * np.pi))
    index = min(int(place), len(radii) - 2)
    return np.sqrt(square) < radii[index] + (place - index) * (radii[index + 1] - radii[index])


@compiled
def _definite(xx, xy, yx, yy):
    shear = 0.5 * (xy + yx)
    return xx + yy > 0.0 and xx * yy - shear * shear > 0.0


@compiled
def sees(lens, x, y):
    """Whether an ideal point of the chart lies in the region that hangs together with the axis."""
    square = x * x + y * y
    if square < lens.limits[0] * lens.limits[0]:
        return True
    if lens.path != _FULL or not np.isfinite(square):
        return False
    _, _, xx, xy, yx, yy = _linearise_lens(lens.fisheye, lens.coefficients, x, y)
    return _definite(xx, xy, yx, yy) and _encloses(lens.ideal, lens.inner[0], x, y)


@kernel
def pixels_of_points(
    tables: CompiledLens, rotation: np.ndarray, translation_m: np.ndarray, points_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) of points (N, 3) that a pose carries into the frame of a camera whose sensor is not tilted, and
    whether each is valid (N,)."""
    lens, at = Lens(*tables), np.empty(3)
    fx, fy, cx, cy = lens.matrix
    pixels, valid = np.zeros((len(points_m), 2)), np.zeros(len(points_m), np.bool_)
    for i in range(len(points_m)):
        for row in range(3):
            at[row] = translation_m[row]
            for axis in range(3):
                at[row] += rotation[row, axis] * points_m[i, axis]
        across = np.hypot(at[0], at[1])
        if not at[2] > 0.0 and not (lens.fisheye and across > 0.0):
            continue
        ratio = np.arctan2(across, at[2]) / across if lens.fisheye and across > 0.0 else 1.0 / at[2]
        x, y = ratio * at[0], ratio * at[1]
        valid[i] = np.isfinite(at[2]) and sees(lens, x, y)
        xd, yd, _, _, _, _ = _linearise_lens(lens.fisheye, lens.coefficients, x, y)
        pixels[i, 0], pixels[i, 1] = xd * fx + cx, yd * fy + cy
    return pixels, valid


@compiled
def _first_guess(lens, x, y):
    """What a distorted point times is about the ideal one, and whether there is one."""
    distorted = np.sqrt(x * x + y * y)
    if lens.path == _NONE:
        return 1.0, distorted < lens.limits[0]
    within_reach = distorted < lens.limits[1] if lens.path == _RADIAL else _encloses(lens.reach, lens.inner[1], x, y)
    if not within_reach:
        return 1.0, False
    within = min(distorted, lens.limits[1])
    place = lens.nodes_per_unit * (within / (1.0 + within))
    index = int(place)
    return (lens.nodes[index] + (place - index) * lens.steps[index]) / (within + 1e-15), True


@compiled
def _undistort(lens, table):
    """LANES ideal points from guesses, by Newton steps for each until it is found. See `normalized_of_pixels`."""
    x, y, allowed = load(table, 0), load(table, 1), load(table, 4)
    for step in range(_STEPS):
        ideal_x, ideal_y = load(table, 2), load(table, 3)
        xd, yd, xx, xy, yx, yy = _linearise_lens(lens.fisheye, lens.coefficients, ideal_x, ideal_y)
        off_x, off_y = x - xd, y - yd
        size_x, size_y = where_positive(off_x, off_x, -off_x), where_positive(off_y, off_y, -off_y)
        beyond = where_positive(size_x - size_y, size_x, size_y) - allowed
        store(table, beyond, 4)
        store(table, xx, 5)
        store(table, xy, 6)
        store(table, yx, 7)
        store(table, yy, 8)
        most = 0.0
        for lane in range(LANES):
            most = max(most, table[4, lane])
        if not most > 0.0 or step == _STEPS - 1:
            break
        inverse = 1.0 / (xx * yy - xy * yx)
        store(table, where_positive(beyond, ideal_x + (yy * off_x - xy * off_y) * inverse, ideal_x), 2)
        store(table, where_positive(beyond, ideal_y + (xx * off_y - yx * off_x) * inverse, ideal_y), 3)


@compiled
def _normalized_of_chart(x, y):
    """X/Z, Y/Z of a point of the equidistant chart, the derivatives (xx, xy, yy), and whether Z > 0."""
    square = x * x + y * y
    if square < _SMALL_ANGLE_SQUARED:
        ratio, cos = 1.0 - square / 6.0 * (1.0 - square / 20.0), 1.0 - square / 2.0 * (1.0 - square / 12.0)
        bend = -1.0 / 3.0 + square / 30.0
    else:
        angle = np.sqrt(square)
        ratio, cos = np.sin(angle) / angle, np.cos(angle)
        bend = (cos - ratio) / square
    ahead = cos > _LEAST_DEPTH
    inverse = 1.0 / cos if ahead else 1.0
    tangent = ratio * inverse
    growth = bend * inverse + tangent * tangent
    return x * tangent, y * tangent, tangent + growth * x * x, growth * x * y, tangent + growth * y * y, ahead


@compiled
def _chart_of_normalized(x, y):
    """The point of the equidistant chart of X/Z, Y/Z."""
    square = x * x + y * y
    if square < _SMALL_ANGLE_SQUARED:
        ratio = 1.0 - square * (1.0 / 3.0 - square / 5.0)
    else:
        off_axis = np.sqrt(square)
        ratio = np.arctan(off_axis) / off_axis
    return x * ratio, y * ratio


@compiled
def normalized_of_pixels(lens, pixels, points, slopes, valid):
    """X/Z, Y/Z (N, 2) of pixels (N, 2), d(X/Z, Y/Z)/d(u, v) (N, 4) row by row, and validity (N,)."""
    fx, fy, cx, cy = lens.matrix
    # of eight points: distorted, ideal, largest error allowed, then found; slopes
    table = np.empty((9, LANES))
    for begin in range(0, len(pixels), LANES):
        some = min(LANES, len(pixels) - begin)
        for lane in range(LANES):
            i = begin + min(lane, some - 1)
            x, y = (pixels[i, 0] - cx) / fx, (pixels[i, 1] - cy) / fy
            ratio, valid[i] = _first_guess(lens, x, y)
            if not valid[i]:
                x, y = 0.0, 0.0
            table[0, lane], table[1, lane], table[2, lane], table[3, lane] = x, y, x * ratio, y * ratio
            table[4, lane] = 5e-14 * np.sqrt(x * x + y * y) + 1e-300
        _undistort(lens, table)
        for lane in range(some):
            i = begin + lane
            x, y, beyond = table[2, lane], table[3, lane], table[4, lane]
            xx, xy, yx, yy = table[5, lane], table[6, lane], table[7, lane], table[8, lane]
            found = valid[i] and beyond <= 0.0 and _definite(xx, xy, yx, yy)
            if lens.path == _RADIAL:
                found = found and x * x + y * y <= lens.limits[0] * lens.limits[0]
            elif lens.path == _FULL:
                found = found and _encloses(lens.ideal, lens.inner[0], x, y)
            inverse = 1.0 / (xx * yy - xy * yx)
            a, b, c, d = yy * inverse, -xy * inverse, -yx * inverse, xx * inverse
            if lens.fisheye:
                x, y, e, f, g, ahead = _normalized_of_chart(x, y)
                a, b, c, d = e * a + f * c, e * b + f * d, f * a + g * c, f * b + g * d
                found = found and ahead
            points[i, 0], points[i, 1] = x, y
            slopes[i, 0], slopes[i, 1], slopes[i, 2], slopes[i, 3] = a / fx, b / fy, c / fx, d / fy
            valid[i] = found


@compiled
def normalized_by_lens(lens, seen, columns):
    """d(X/Z, Y/Z)/d(fx, fy, cx, cy, *distortion), columns (2, 4 + k, LANES), of LANES fixed pixels; zeros where one is
    not seen. seen : (6, LANES) X/Z and Y/Z, then scratch room."""
    for lane in range(LANES):
        x, y, e, f, g = seen[0, lane], seen[1, lane], 1.0, 0.0, 1.0
        if lens.fisheye:
            x, y = _chart_of_normalized(x, y)
            _, _, e, f, g, _ = _normalized_of_chart(x, y)
        seen[2, lane] = 1.0 if sees(lens, x, y) else 0.0
        seen[0, lane], seen[1, lane], seen[3, lane], seen[4, lane], seen[5, lane] = x, y, e, f, g
    x, y, there, e, f, g = load(seen, 0), load(seen, 1), load(seen, 2), load(seen, 3), load(seen, 4), load(seen, 5)
    fx, fy, c, zero = lens.matrix[0], lens.matrix[1], lens.coefficients, spread(0.0)
    xd, yd, xx, xy, yx, yy = _linearise_lens(lens.fisheye, c, x, y)
    inverse = -1.0 / (xx * yy - xy * yx)
    a, b, p, q = yy * inverse, -xy * inverse, -yx * inverse, xx * inverse
    a, b, p, q = e * a + f * p, e * b + f * q, f * a + g * p, f * b + g * q
    a, b = where_positive(there, a, 0.0), where_positive(there, b, 0.0)
    p, q = where_positive(there, p, 0.0), where_positive(there, q, 0.0)
    s = x * x + y * y
    across, down, power = a * x + b * y, p * x + q * y, s
    gain, _ = radial(lens.fisheye, c, s)
    under = zero if lens.fisheye else 1.0 / (1.0 + s * (c[5] + s * (c[6] + s * c[7])))
    _put_column(columns, 0, a * xd / fx, p * xd / fx)
    _put_column(columns, 1, b * yd / fy, q * yd / fy)
    _put_column(columns, 2, a / fx, p / fx)
    _put_column(columns, 3, b / fy, q / fy)
    for i in range(lens.distortions):
        if lens.fisheye:
            _put_column(columns, 4 + i, across * power, down * power)
            power = power * s
        else:
            dx, dy = _by_coefficient(i, x, y, s, under, gain)
            _put_column(columns, 4 + i, a * dx + b * dy, p * dx + q * dy)


@compiled
def _put_column(columns, column, across, down):
    store(columns, across, 0, column)
    store(columns, down, 1, column)


@compiled
def _by_coefficient(i, x, y, s, under, gain):
    """d(distorted)/d(coefficient i) of OpenCV's lens before the tilt."""
    zero = spread(0.0)
    if i == 2:
        return 2.0 * x * y, s + 2.0 * y * y
    if i == 3:
        return s + 2.0 * x * x, 2.0 * x * y
    if i < 8:
        power = s * under
        if i >= 5:
            power = -gain * power
        order = i if i < 2 else 2 if i == 4 else i - 5
        for _ in range(order):
            power = power * s
        return x * power, y * power
    power = s if i == 8 or i == 10 else s * s
    if i < 10:
        return power, zero
    return zero, power
