"""Lens models of other programs as projections, and our lens that is nearest to one over the picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.camera.models import MODELS
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.least_squares import SQUARES, Linearised, Rules, minimise
from vbaa_calib.native import core

Projection = Callable[[np.ndarray], np.ndarray]
"""Directions (N, 3) in the camera frame → pixels (N, 2), NaN where the model has none."""


def refitted(
    project: Projection, size: tuple[int, int], name: str, path: Path, inside: np.ndarray | None = None
) -> tuple[Camera, str]:
    """Our lens that is nearest to a projection over a picture (width, height) px, and a sentence on its error.

    name : of the model, for the sentence. inside : (K, 2) px, corners of the part of the picture where it counts.
    Raises InputError where none comes near, or the model has no directions.
    """
    rays, pixels = _spread(project, size, inside)
    if len(rays) < 100:
        what = f"its {name} lens has directions for next to none of the picture"
        raise InputError(what, where=path, remedy="are its numbers in its model's order?")
    fits: list[tuple[bool, float, Camera]] = []
    for kind, count in (("opencv", 5), ("opencv", 8), ("fisheye", 4), ("opencv", 12)):
        for small_px in (1e-2, 1.0):
            fit = _fitted(kind, count, project, (rays, pixels), size, small_px)
            if fit is not None and (error := _rms(fit, rays, pixels)) < np.inf:
                fits.append((fit.valid_region().image_fraction < 1.0, error, fit))
                break
    folds, rms, camera = min(fits, key=lambda each: each[:2], default=(True, np.inf, None))
    for each in fits:  # the shortest lens, unless a longer one is clearly nearer
        if each[0] == folds and each[1] <= 1.3 * rms + 1e-4:
            _, rms, camera = each
            break
    # a lens further from its file's is another: good corners of a board scatter by a quarter
    if camera is None or rms > 1.0:
        what = f"no lens of ours comes near its {name} lens: {rms:.2g} px rms over the picture"
        raise InputError(what, where=path, remedy="calibrate the lens again, with vbaa intrinsics")
    most = float(np.nanmax(np.linalg.norm(camera.project(rays)[0] - pixels, axis=1)))
    part = "over the picture" if inside is None else "in its valid_intrinsics_region"
    words = f"{name} is refitted as {camera.model} with {camera.distortion.size} coefficients: "
    return camera, f"{words}off by {rms:.2g} px rms, {most:.2g} px at most {part}"


def _rms(camera: Camera, rays: np.ndarray, pixels: np.ndarray) -> float:
    """Rms distance of the pixels of two lenses; infinite where ours folds before the other does."""
    seen, valid = camera.project(rays)
    if valid.mean() < 0.98:  # at a fold of the other's the last directions are nearly parallel, and ours may end before
        return np.inf
    return float(np.sqrt(((seen - pixels)[valid] ** 2).sum(axis=1).mean()))


def _spread(project: Projection, size: tuple[int, int], inside: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) and their pixels (N, 2), evenly over the picture, within the region in which the model is
    one to one."""
    around, edge = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False), np.radians(115.0)
    for count in (400, 240):  # the second time, to the picture's corners only
        angles = np.linspace(0.0, edge, count)
        sine = np.sin(angles)[:, None]
        rays = np.stack([sine * np.cos(around), sine * np.sin(around), np.cos(angles)[:, None] + 0.0 * around], axis=-1)
        with np.errstate(all="ignore"):
            pixels = project(rays.reshape(-1, 3)).reshape((*rays.shape[:2], 2))
            radius = np.linalg.norm(pixels - pixels[:1], axis=-1)
            grows = np.diff(radius, axis=0, prepend=-1.0) > 0.0
        ahead = np.logical_and.accumulate(grows, axis=0)
        seen = ahead & ((pixels > -0.5) & (pixels < np.array(size) - 0.5)).all(axis=-1)
        edge = min(edge, 1.02 * float(angles[seen.any(axis=1)].max(initial=0.0)) + 1e-6)
    rays, pixels = rays[seen], pixels[seen]
    if inside is not None and len(inside) >= 3:
        outline = np.asarray(inside, np.float32).reshape(-1, 1, 2)
        within = [cv2.pointPolygonTest(outline, pixel, False) >= 0.0 for pixel in pixels.tolist()]
        rays, pixels = rays[within], pixels[within]
    columns_rows = 48, 36
    at = (pixels + 0.5) / size * columns_rows
    cells = at.astype(int)
    off = np.linalg.norm(at - cells - 0.5, axis=1)
    order = np.argsort(off, kind="stable")
    first = np.unique(cells[order] @ [1, columns_rows[0]], return_index=True)[1]
    return rays[order[first]], pixels[order[first]]


def _fitted(
    kind: str,
    count: int,
    project: Projection,
    samples: tuple[np.ndarray, np.ndarray],
    size: tuple[int, int],
    small_px: float,
) -> Camera | None:
    """The lens of a model with `count` coefficients that fits the pixels by least squares; None where there is none.

    samples : directions (N, 3) and their pixels (N, 2). small_px : residual of a coefficient of 1: keeps small those
        that cancel each other, which could make the lens fold.
    """
    (rays, pixels), fisheye = samples, MODELS[kind].is_fisheye
    if not fisheye and (rays[:, 2] < 0.05).any():
        return None
    step = 1e-4
    middle, right, down = project(np.array([[0.0, 0.0, 1.0], [step, 0.0, 1.0], [0.0, step, 1.0]]))
    focal = np.array([right[0] - middle[0], down[1] - middle[1]]) / step
    if not np.isfinite([*focal, *middle]).all() or (focal <= 0.0).any():
        return None
    angles = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    values = np.concatenate([focal, middle, np.zeros(count)])
    for share in (0.25, 0.5, 0.75, 1.0):  # outwards: too far from its numbers, a lens folds before the outermost
        near = angles <= share * angles.max()
        if near.sum() < len(values):
            continue
        values = _descended(fisheye, values, rays[near], pixels[near], small_px)
    fx, fy, cx, cy = values[:4]
    return Camera(kind, size, np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), values[4:])


def _descended(fisheye: bool, start: np.ndarray, rays: np.ndarray, pixels: np.ndarray, small_px: float) -> np.ndarray:
    """Parameters of the lens that fits the pixels by least squares, from an initial value; as `_fitted`."""
    count = len(start) - 4
    prior = np.hstack([np.zeros((count, 4)), small_px * np.eye(count)])

    def at(values: np.ndarray) -> Linearised | None:
        if (values[:2] <= 0.0).any():
            return None
        seen, slopes = _projected(fisheye, values, rays)
        residuals = np.concatenate([(seen - pixels).ravel(), prior @ values])
        return Linearised(values, residuals, np.vstack([slopes, prior]), count, loss=SQUARES)

    first, rules = at(start), Rules(iterations=300, tolerance=1e-9, standstill=1e-9, damping=1e-3)
    return start if first is None or not first.is_finite else minimise(at, first, rules)[0].parameters


def _projected(fisheye: bool, values: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and their derivatives (2N, 4 + k), also where the lens folds, as it may during the iteration."""
    if fisheye:
        seen, _, _, slopes = core.lens.Lens(fisheye, values).project(np.ascontiguousarray(rays), True)
        return seen, slopes.reshape(-1, len(values))
    fx, fy, cx, cy = values[:4]
    matrix, nothing = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), np.zeros(3)
    seen, slopes = cv2.projectPoints(rays[:, None], nothing, nothing, matrix, values[4:])
    return seen[:, 0], slopes[:, 6 : 6 + len(values)]


def _on_sensor(lens: Sequence[float], points: np.ndarray) -> np.ndarray:
    """Pixels of points (N, 2) on the normalised sensor, by fx, fy, cx, cy."""
    return points * lens[:2] + lens[2:4]


def _radtan(coefficients: Sequence[float], points: np.ndarray) -> np.ndarray:
    """Points (N, 2), distorted by OpenCV's k1 k2 p1 p2 where there are any."""
    if not len(coefficients):
        return points
    k1, k2, p1, p2 = coefficients
    x, y = points.T
    square = x * x + y * y
    radial = 1.0 + k1 * square + k2 * square**2
    return np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=1,
    )


def _omni(values: Sequence[float], coefficients: Sequence[float] = ()) -> Projection:
    """Mei's unified model in Kalibr's form: xi, fu, fv, pu, pv; radtan on the normalised sensor."""
    xi, *lens = values

    def project(rays: np.ndarray) -> np.ndarray:
        length = np.linalg.norm(rays, axis=1)
        depth = rays[:, 2] + xi * length
        bound = -min(xi, 1.0 / xi if xi > 0.0 else np.inf)  # what lies behind is mapped a second time
        depth = np.where(rays[:, 2] > bound * length, depth, np.nan)
        return _on_sensor(lens, _radtan(coefficients, rays[:, :2] / depth[:, None]))

    return project


def _double_sphere(values: Sequence[float], _: Sequence[float] = ()) -> Projection:
    """Usenko, Demmel and Cremers, The Double Sphere Camera Model, Eqs. 40 to 45: xi, alpha, fu, fv, pu, pv."""
    xi, alpha, *lens = values

    def project(rays: np.ndarray) -> np.ndarray:
        first = np.linalg.norm(rays, axis=1)
        shifted = xi * first + rays[:, 2]
        second = np.sqrt(rays[:, 0] ** 2 + rays[:, 1] ** 2 + shifted**2)
        inner = alpha / (1.0 - alpha) if alpha <= 0.5 else (1.0 - alpha) / alpha
        bound = (inner + xi) / np.sqrt(2.0 * inner * xi + xi**2 + 1.0)
        depth = np.where(rays[:, 2] > -bound * first, alpha * second + (1.0 - alpha) * shifted, np.nan)
        return _on_sensor(lens, rays[:, :2] / depth[:, None])

    return project


def _extended_unified(values: Sequence[float], _: Sequence[float] = ()) -> Projection:
    """The extended unified model of Khomutenko, Garcia and Martinet: alpha, beta, fu, fv, pu, pv."""
    alpha, beta, *lens = values

    def project(rays: np.ndarray) -> np.ndarray:
        away = np.sqrt(beta * (rays[:, 0] ** 2 + rays[:, 1] ** 2) + rays[:, 2] ** 2)
        depth = alpha * away + (1.0 - alpha) * rays[:, 2]
        bound = (alpha - 1.0) / (2.0 * alpha - 1.0) if alpha > 0.5 else -np.inf
        return _on_sensor(lens, rays[:, :2] / np.where(rays[:, 2] > bound * away, depth, np.nan)[:, None])

    return project


def _field_of_view(values: Sequence[float], coefficients: Sequence[float]) -> Projection:
    """The field-of-view model of Devernay and Faugeras with one angle w: fu, fv, pu, pv; the radius is atan(2 r
    tan(w/2)) / w."""
    (angle,) = coefficients

    def project(rays: np.ndarray) -> np.ndarray:
        points = rays[:, :2] / np.where(rays[:, 2] > 0.0, rays[:, 2], np.nan)[:, None]
        radius = np.maximum(np.linalg.norm(points, axis=1), 1e-12)
        factor = np.arctan(2.0 * radius * np.tan(angle / 2.0)) / (radius * angle) if angle else np.ones(len(points))
        return _on_sensor(values, points * factor[:, None])

    return project


def _thin_prism_fisheye(values: Sequence[float], coefficients: Sequence[float]) -> Projection:
    """COLMAP's thin-prism fisheye model: fx, fy, cx, cy; k1 k2 p1 p2 k3 k4 sx1 sy1 over the angle."""
    k1, k2, p1, p2, k3, k4, sx, sy = coefficients

    def project(rays: np.ndarray) -> np.ndarray:
        off_axis = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-12)
        points = rays[:, :2] * (np.arctan2(off_axis, rays[:, 2]) / off_axis)[:, None]
        square = (points**2).sum(axis=1)
        radial = np.polyval([k4, k3, 0.0, 0.0], square) * square
        shift = np.stack([sx * square, sy * square], axis=1) + points * radial[:, None]
        return _on_sensor(values, _radtan((k1, k2, p1, p2), points) + shift)

    return project


def _skewed(camera: Camera, skew: float) -> Projection:
    """Projection by our lens with a skew, px, in its matrix."""

    def project(rays: np.ndarray) -> np.ndarray:
        pixels, valid = camera.project(rays)
        pixels[:, 0] += skew * (pixels[:, 1] - camera.matrix[1, 2]) / camera.matrix[1, 1]
        return np.where(valid[:, None], pixels, np.nan)

    return project


def _stereographic(rays: np.ndarray) -> np.ndarray:
    return 2.0 * rays[:, :2] / (np.linalg.norm(rays, axis=1) + rays[:, 2])[:, None]


def _splined(values: Sequence[float], config: Mapping[str, float]) -> Projection:
    """mrcal's LENSMODEL_SPLINED_STEREOGRAPHIC: fx, fy, cx, cy, and control points (Ny, Nx, 2) of a B-spline surface of
    shifts on the stereographic plane. config : order, Nx, Ny, fov_x_deg of its name."""
    order, columns, rows = (int(config[key]) for key in ("order", "Nx", "Ny"))
    lens, points = values[:4], np.reshape(values[4:], (rows, columns, 2))
    margin = order - 1
    per_unit = (columns - 1 - margin) / (4.0 * np.tan(np.radians(config["fov_x_deg"]) / 4.0))
    basis = _quadratic if order == 2 else _cubic

    def project(rays: np.ndarray) -> np.ndarray:
        plane = _stereographic(rays)
        at = plane * per_unit + (np.array([columns, rows]) - 1.0) / 2.0
        at = np.asarray(np.where(np.isfinite(at), at, -1.0))
        knots = np.clip(np.floor(at + (0.5 if order == 2 else 0.0)), 1, np.array([columns, rows]) - 1 - margin)
        # beyond the last knots the surface is not the model's
        beyond = np.asarray(at < 0.5) | np.asarray(at > np.array([columns, rows]) - 1.5)
        weights = basis(at - knots)
        across, along = weights[:, 0], weights[:, 1]
        first = knots.astype(int) - 1
        span = np.arange(order + 1)
        near = points[first[:, 1, None, None] + span[:, None], first[:, 0, None, None] + span]
        shift = np.einsum("nj,ni,njik->nk", along, across, near)
        return np.where(np.any(beyond, axis=1)[:, None], np.nan, _on_sensor(lens, plane + shift))

    return project


def _cubic(at: np.ndarray) -> np.ndarray:
    """(..., 4) weights of the uniform cubic B-spline at [0, 1] between the second and third of four points."""
    x = at[..., None]
    return (
        np.concatenate(
            [(1.0 - x) ** 3, 3.0 * x**3 - 6.0 * x**2 + 4.0, -3.0 * x**3 + 3.0 * x**2 + 3.0 * x + 1.0, x**3], axis=-1
        )
        / 6.0
    )


def _quadratic(at: np.ndarray) -> np.ndarray:
    """(..., 3) weights of the uniform quadratic B-spline at [−1/2, 1/2] about the second of three points."""
    x = at[..., None]
    return np.concatenate([(0.5 - x) ** 2 / 2.0, 0.75 - x**2, (0.5 + x) ** 2 / 2.0], axis=-1)


def _cahvor(values: Sequence[float], config: Mapping[str, float]) -> Projection:
    """CAHVOR, and CAHVORE with a single centre, as mrcal states them: fx, fy, cx, cy; the direction alpha, beta of the
    axis of distortion; r0, r1, r2 over the squared tangent of the angle from it, or over chi of CAHVORE's linearity.
    config : linearity of CAHVORE; skew, px by which v moves with x."""
    lens, (alpha, beta, *radial) = values[:4], values[4:9]
    axis = np.array([np.sin(alpha) * np.cos(beta), np.sin(beta), np.cos(alpha) * np.cos(beta)])

    def project(rays: np.ndarray) -> np.ndarray:
        along = rays @ axis
        across = rays - along[:, None] * axis
        off_axis = np.maximum(np.linalg.norm(across, axis=1), 1e-12)
        chi = _chi(np.arctan2(off_axis, along), config.get("linearity", 1.0))
        moved = (off_axis / chi)[:, None] * axis + across * (1.0 + np.polyval(radial[::-1], chi**2))[:, None]
        points = moved[:, :2] / np.where(moved[:, 2] > 0.0, moved[:, 2], np.nan)[:, None]
        return _on_sensor(lens, points) + points[:, :1] * [0.0, config.get("skew", 0.0)]

    return project


def _chi(angle: np.ndarray, linearity: float) -> np.ndarray:
    """tan(L θ)/L for a linearity L > 0, sin(L θ)/L for L < 0, θ for L = 0; NaN beyond the model's end."""
    scaled = np.where(np.abs(angle * linearity) < np.pi / 2.0, angle * linearity, np.nan)
    if abs(linearity) < 1e-15:
        return angle
    return np.asarray((np.tan(scaled) if linearity > 0.0 else np.sin(scaled)) / linearity)


PROJECTIONS: dict[str, Callable[..., Projection]] = {
    "omni": _omni,
    "ds": _double_sphere,
    "eucm": _extended_unified,
    "fov": _field_of_view,
    "thin_prism_fisheye": _thin_prism_fisheye,
    "skewed": _skewed,
    "splined": _splined,
    "cahvor": _cahvor,
    "stereographic": lambda values, _: lambda rays: _on_sensor(values, _stereographic(rays)),
}
"""Name of another program's model → the projection of its numbers: intrinsics, then coefficients or settings."""
