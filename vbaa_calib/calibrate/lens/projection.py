"""A board's corners through a lens, compiled: pixels and their derivatives by lens, board's shape and view's pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel

from .board_shape import SHAPE

_ON_AXIS = 1e-8
_TILTED = 14
"""Coefficients of a lens whose sensor is tilted, by the last two."""
_POLE, _BEYOND_CORNER = 1e-3, 1.02
WORK = 14
"""Rows of room that `view_rows` needs."""


class Corners(NamedTuple):
    """Corners of V views: board points (N, 3) m, by how much they move with the board's shape (N, 3, 5), pixels (N, 2).

    weights : (N,) of their residuals. bounds : (V + 1,), view v has corners bounds[v] to bounds[v + 1].
    """

    points_m: np.ndarray
    deformation: np.ndarray
    pixels: np.ndarray
    weights: np.ndarray
    bounds: np.ndarray


@kernel
def _fisheye(work: np.ndarray, lens: np.ndarray, slopes: np.ndarray, count: int) -> None:
    """As `_opencv`."""
    for n in range(count):
        x, y = work[4, n], work[5, n]
        square = x * x + y * y
        radius = np.sqrt(square) if square > _ON_AXIS**2 else _ON_AXIS
        angle = np.arctan(radius)
        term, power = angle / radius, angle * angle
        gain, slope = term, 1.0
        for i in range(4, 8):
            term *= power
            gain += lens[i] * term
            slope += (2 * i - 5) * lens[i] * term * radius / angle
            slopes[i, n], slopes[i, count + n] = x * term, y * term
        bend = (slope / (1.0 + square) - gain) / (radius * radius) if square > _ON_AXIS**2 else 0.0
        work[6, n], work[7, n], work[8, n] = x * gain, y * gain, gain + bend * x * x
        work[9, n], work[10, n], work[11, n] = bend * x * y, bend * x * y, gain + bend * y * y


@kernel
def _opencv(work: np.ndarray, lens: np.ndarray, slopes: np.ndarray, count: int) -> None:
    """From ideal points, rows 4 and 5 of `work`, the distorted ones, rows 6 and 7, and how they move with those, rows 8
    to 11: xx, xy, yx, yy. Rows 4 and on of the slopes: by the coefficients."""
    d = np.zeros(_TILTED)
    for i in range(len(lens) - 4):
        d[i] = lens[4 + i]
    k1, k2, p1, p2, k3, k4 = d[0], d[1], d[2], d[3], d[4], d[5]
    k5, k6, s1, s2, s3, s4 = d[6], d[7], d[8], d[9], d[10], d[11]
    for n in range(count):
        x, y = work[4, n], work[5, n]
        s = x * x + y * y
        top, d_top = 1.0 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2.0 * k2 + 3.0 * s * k3)
        inverse, d_bottom = 1.0 / (1.0 + s * (k4 + s * (k5 + s * k6))), k4 + s * (2.0 * k5 + 3.0 * s * k6)
        gain = top * inverse
        bend = 2.0 * (d_top - gain * d_bottom) * inverse
        twice_x, twice_y = 2.0 * x, 2.0 * y
        along_x, along_y = p1 * twice_y + p2 * twice_x, p1 * twice_x + p2 * twice_y
        prism_x, prism_y = s1 + 2.0 * s * s2, s3 + 2.0 * s * s4
        work[6, n] = x * (gain + along_x) + p2 * s + s * (s1 + s * s2)
        work[7, n] = y * (gain + along_x) + p1 * s + s * (s3 + s * s4)
        work[8, n] = gain + bend * x * x + along_x + 2.0 * p2 * twice_x + prism_x * twice_x
        work[9, n] = bend * x * y + along_y + prism_x * twice_y
        work[10, n] = bend * x * y + along_y + prism_y * twice_x
        work[11, n] = gain + bend * y * y + along_x + 2.0 * p1 * twice_y + prism_y * twice_y
        work[12, n], work[13, n] = inverse, gain
    size = len(lens)
    if size > 4:
        for n in range(count):
            x, y = work[4, n], work[5, n]
            s = x * x + y * y
            first = s * work[12, n]
            slopes[4, n], slopes[4, count + n] = x * first, y * first
            slopes[5, n], slopes[5, count + n] = x * s * first, y * s * first
            slopes[6, n], slopes[6, count + n] = 2.0 * x * y, s + 2.0 * y * y
            slopes[7, n], slopes[7, count + n] = s + 2.0 * x * x, 2.0 * x * y
    for i in range(8, min(size, 12)):
        # k3, then k4, k5 and k6, which pull the other way
        power, scaled = 3 if i == 8 else i - 8, i > 8
        for n in range(count):
            x, y = work[4, n], work[5, n]
            s = x * x + y * y
            term = work[12, n] * (-work[13, n] if scaled else 1.0)
            for _ in range(power):
                term *= s
            slopes[i, n], slopes[i, count + n] = x * term, y * term
    for i in range(12, min(size, 16)):
        own, other = (0, count) if i < 14 else (count, 0)
        for n in range(count):
            s = work[4, n] * work[4, n] + work[5, n] * work[5, n]
            slopes[i, own + n], slopes[i, other + n] = s * s if i % 2 else s, 0.0


@kernel
def _tilt(work: np.ndarray, lens: np.ndarray, slopes: np.ndarray, count: int) -> None:
    """Onto the tilted sensor, as OpenCV tilts it, with all slopes."""
    sx, cx, sy, cy = np.sin(lens[16]), np.cos(lens[16]), np.sin(lens[17]), np.cos(lens[17])
    height = cy * cx
    for n in range(count):
        x, y = work[6, n], work[7, n]
        # the ray turned
        a, b, w = cy * x + sy * sx * y - sy * cx, cx * y + sx, sy * x - cy * sx * y + cy * cx
        inverse = height / w
        p, q = a / w, b / w
        work[6, n], work[7, n] = height * p + sy * cx, height * q - sx
        xx, xy = inverse * (cy - p * sy), inverse * (sy * sx + p * cy * sx)
        yx, yy = -inverse * q * sy, inverse * (cx + q * cy * sx)
        for i in range(4, 16):
            u, v = slopes[i, n], slopes[i, count + n]
            slopes[i, n], slopes[i, count + n] = xx * u + xy * v, yx * u + yy * v
        slopes[16, n] = inverse * b * (sy + p * cy) - cy * sx * p - sy * sx
        slopes[16, count + n] = inverse * (cx - sx * y + q * cy * b) - cy * sx * q - cx
        slopes[17, n] = -inverse * (w + p * a) - sy * cx * p + cy * cx
        slopes[17, count + n] = -inverse * q * a - sy * cx * q
        first, second, third, fourth = work[8, n], work[9, n], work[10, n], work[11, n]
        work[8, n], work[9, n] = xx * first + xy * third, xx * second + xy * fourth
        work[10, n], work[11, n] = yx * first + yy * third, yx * second + yy * fourth


@kernel
def _rotation_matrix(turn: np.ndarray) -> np.ndarray:
    """(3, 3) of a rotation vector."""
    w, x, y, z = _quaternion(turn)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


@kernel
def _quaternion(turn: np.ndarray) -> tuple[float, float, float, float]:
    angle = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    share = np.sin(0.5 * angle) / angle if angle > _ON_AXIS else 0.5
    return np.cos(0.5 * angle), share * turn[0], share * turn[1], share * turn[2]


@kernel
def turned(by: np.ndarray, turn: np.ndarray) -> tuple[float, float, float]:
    """Rotation vector of a rotation vector turned by another."""
    a, b, c, d = _quaternion(by)
    w, x, y, z = _quaternion(turn)
    w, x, y, z = (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
    sine = np.sqrt(x * x + y * y + z * z)
    # the shorter way round
    angle = 2.0 * np.arctan2(sine, abs(w))
    share = np.copysign(angle / sine if sine > _ON_AXIS else 2.0, w)
    return share * x, share * y, share * z


@kernel
def view_rows(
    view: int,
    corners: Corners,
    bundle: tuple[np.ndarray, np.ndarray, np.ndarray],
    fisheye: bool,
    work: np.ndarray,
    slopes: np.ndarray,
) -> int:
    """A view's residuals, px, and their negative derivatives, into the last and the other rows of `slopes`.

    bundle : lens (4 + k,), the board's shape (5,), the views' poses (V, 6).
    work : (14, M) room. slopes : (4 + k + 5 + 6 + 1, 2M), u of the view's corners and behind it v. Returns how many.
    """
    lens, shape, poses = bundle
    first, count, size = corners.bounds[view], corners.bounds[view + 1] - corners.bounds[view], len(lens)
    r, pose = _rotation_matrix(poses[view]), poses[view]
    for n in range(count):
        at = first + n
        px, py, pz = corners.points_m[at, 0], corners.points_m[at, 1], corners.points_m[at, 2]
        for i in range(SHAPE):
            px += corners.deformation[at, 0, i] * shape[i]
            py += corners.deformation[at, 1, i] * shape[i]
            pz += corners.deformation[at, 2, i] * shape[i]
        x, y = r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz, r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz
        z = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz
        depth = 1.0 / (z + pose[5]) if z + pose[5] != 0.0 else 1.0
        work[0, n], work[1, n], work[2, n], work[3, n] = x, y, z, depth
        work[4, n], work[5, n] = (x + pose[3]) * depth, (y + pose[4]) * depth
    if fisheye:
        _fisheye(work, lens, slopes, count)
    else:
        _opencv(work, lens, slopes, count)
    if size == 4 + _TILTED:
        _tilt(work, lens, slopes, count)
    for axis in range(2):
        focal, behind, rest = lens[axis], axis * count, (1 - axis) * count
        for n in range(count):
            slopes[axis, behind + n], slopes[axis, rest + n] = work[6 + axis, n], 0.0
            slopes[2 + axis, behind + n], slopes[2 + axis, rest + n] = 1.0, 0.0
            predicted = focal * work[6 + axis, n] + lens[2 + axis]
            slopes[size + SHAPE + 6, behind + n] = corners.pixels[first + n, axis] - predicted
        for i in range(4, size):
            for n in range(count):
                slopes[i, behind + n] *= focal
        for n in range(count):
            x, y, z, scale = work[0, n], work[1, n], work[2, n], focal * work[3, n]
            a, b = scale * work[8 + 2 * axis, n], scale * work[9 + 2 * axis, n]
            c = -a * work[4, n] - b * work[5, n]
            along = a * r[0, 0] + b * r[1, 0] + c * r[2, 0]
            across = a * r[0, 1] + b * r[1, 1] + c * r[2, 1]
            up = a * r[0, 2] + b * r[1, 2] + c * r[2, 2]
            at = first + n
            for i in range(SHAPE):
                moved = along * corners.deformation[at, 0, i] + across * corners.deformation[at, 1, i]
                slopes[size + i, behind + n] = moved + up * corners.deformation[at, 2, i]
            # gᵀ(ω × q) = ωᵀ(q × g)
            slopes[size + SHAPE, behind + n] = y * c - z * b
            slopes[size + SHAPE + 1, behind + n] = z * a - x * c
            slopes[size + SHAPE + 2, behind + n] = x * b - y * a
            slopes[size + SHAPE + 3, behind + n] = a
            slopes[size + SHAPE + 4, behind + n] = b
            slopes[size + SHAPE + 5, behind + n] = c
    return int(count)


@kernel
def corner_rows(
    lens: np.ndarray, shape: np.ndarray, poses: np.ndarray, fisheye: bool, corners: Corners
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (N, 2) px of all corners, and their negative derivatives (N, 2, 4 + k + 5 + 6)."""
    most, width = most_corners(corners), len(lens) + SHAPE + 6
    work, own = np.empty((WORK, most)), np.empty((width + 1, 2 * most))
    residuals = np.empty((len(corners.pixels), 2))
    slopes = np.empty((len(residuals), 2, width))
    for view in range(len(poses)):
        count = view_rows(view, corners, (lens, shape, poses), fisheye, work, own)
        for axis in range(2):
            for n in range(count):
                at = corners.bounds[view] + n
                residuals[at, axis] = own[width, axis * count + n]
                for i in range(width):
                    slopes[at, axis, i] = own[i, axis * count + n]
    return residuals, slopes


@kernel
def most_corners(corners: Corners) -> int:
    """Of a view."""
    most = 0
    for view in range(len(corners.bounds) - 1):
        most = max(most, corners.bounds[view + 1] - corners.bounds[view])
    return most


@kernel
def radial_slope(
    distortion: np.ndarray, fisheye: bool, radius: float, by_distortion: np.ndarray
) -> tuple[float, float]:
    """Distorted radius at an ideal one (an angle, of a fisheye), and its slope; into (k,) the slope's derivatives."""
    by_distortion[:] = 0.0
    square, count = radius * radius, len(distortion)
    top, d_top, bottom, d_bottom, power = 1.0, 0.0, 1.0, 0.0, 1.0
    terms = 4 if fisheye else 3
    for i in range(terms):
        power *= square
        at = i if fisheye or i < 2 else 4
        if at < count:
            top, d_top = top + distortion[at] * power, d_top + 2 * (i + 1) * distortion[at] * power
        if not fisheye and count > 5:
            bottom, d_bottom = bottom + distortion[5 + i] * power, d_bottom + 2 * (i + 1) * distortion[5 + i] * power
    if abs(bottom) < _POLE:
        bottom = _POLE
    # d_top and d_bottom are slopes by the logarithm of the radius
    ratio = top / bottom
    turning, power = (d_top - ratio * d_bottom) / bottom, 1.0
    for i in range(terms):
        power *= square
        at = i if fisheye or i < 2 else 4
        if at < count:
            by_distortion[at] = (2 * i + 3 - d_bottom / bottom) * power / bottom
        if not fisheye and count > 5:
            own = (2 * i + 3) * ratio + turning - ratio * d_bottom / bottom
            by_distortion[5 + i] = -own * power / bottom
    return radius * ratio, ratio + turning


@kernel
def radial_slopes(
    distortion: np.ndarray, fisheye: bool, radii: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`radial_slope` at radii (m,): curve (m,), slope (m,), its derivatives (m, k)."""
    curve, slope = np.empty(len(radii)), np.empty(len(radii))
    by_distortion = np.empty((len(radii), len(distortion)))
    for i in range(len(radii)):
        curve[i], slope[i] = radial_slope(distortion, fisheye, radii[i], by_distortion[i])
    return curve, slope, by_distortion


@kernel
def corner_radius(intrinsics: np.ndarray, image_size: tuple[int, int]) -> float:
    """Distorted radius of the picture's furthest corner from the axis, and 2 % more; intrinsics (4 + k,)."""
    cx, cy = intrinsics[2], intrinsics[3]
    far_x, far_y = max(image_size[0] - 0.5 - cx, cx + 0.5), max(image_size[1] - 0.5 - cy, cy + 0.5)
    return float(_BEYOND_CORNER * np.hypot(far_x / intrinsics[0], far_y / intrinsics[1]))
