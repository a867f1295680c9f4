"""Lens models, their projections, and a penalty against radial curves that fold inside the picture."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.camera.lens import lens_of
from vbaa_calib.camera.models import MODELS
from vbaa_calib.native import core

from .settings import LensSettings


@dataclass(frozen=True)
class DistortionModel:
    """A lens model: its distortion polynomial and which of its coefficients are solved for."""

    name: str  # as `--lens-model` takes it
    camera_model: str  # "opencv" or "fisheye"
    distortion_count: int  # coefficients stored, in OpenCV's order
    free: tuple[int, ...]  # those that are solved for; the others stay zero
    simpler: str | None  # the model to start from

    @property
    def is_fisheye(self) -> bool:
        return self.camera_model == "fisheye"

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters: fx, fy, cx, cy, then the distortion in OpenCV's order."""
        return ("fx", "fy", "cx", "cy", *MODELS[self.camera_model].coefficient_names[: self.distortion_count])


LENS_MODELS = {
    model.name: model
    for model in (
        DistortionModel("none", "opencv", 0, (), None),
        DistortionModel("radial", "opencv", 4, (0, 1), "none"),
        DistortionModel("opencv4", "opencv", 4, (0, 1, 2, 3), "radial"),
        # from the solution without k3: a free k3 from a cold start ends far from the minimum on long lenses
        DistortionModel("opencv5", "opencv", 5, (0, 1, 2, 3, 4), "opencv4"),
        # from the fisheye, whose curve is smooth: from polynomials it often ends with a pole inside the picture
        DistortionModel("rational", "opencv", 8, tuple(range(8)), "fisheye"),
        DistortionModel("thin", "opencv", 12, tuple(range(12)), "rational"),
        DistortionModel("tilted", "opencv", 14, tuple(range(14)), "thin"),
        DistortionModel("fisheye", "fisheye", 4, (0, 1, 2, 3), None),
    )
}


def camera_of(model: DistortionModel, intrinsics: np.ndarray, image_size: tuple[int, int]) -> Camera:
    """The camera of intrinsics (fx, fy, cx, cy, *distortion), without a covariance."""
    fx, fy, cx, cy = intrinsics[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(model.camera_model, image_size, matrix, intrinsics[4:])


def projected(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 2) of points (N, 3) m in the camera frame, and their derivatives by the points (N, 2, 3), per m, and
    by the lens (N, 2, 4 + k).

    Points that the lens does not see are far outside the picture, with derivatives of zero.
    """
    points = np.ascontiguousarray(points, float)
    pixels, seen, by_point, by_lens = lens_of(camera.intrinsics).project(points, True)
    return np.where(seen[:, None], pixels, 1e4), by_point, by_lens


def pose_slopes(by_point: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """(N, 2, 6) derivatives of pixels by the tangent of a body's pose (`Pose.retract`), from those by points (N, 2,
    3). lever : (N, 3) from the body's origin to the points."""
    return np.concatenate([np.cross(lever[:, None], by_point), by_point], axis=-1)


_NUMERATOR = {"opencv": (0, 1, 4), "fisheye": (0, 1, 2, 3)}  # coefficients of the radial curve, in their order
_DENOMINATOR = {"opencv": (5, 6, 7), "fisheye": ()}


def _radial_curve(
    model: DistortionModel, distortion: np.ndarray, radii: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distorted radius (m,) at ideal radii (m,), its slope (m,), and the slope's derivatives (m, k)."""
    curve, slope, by_distortion = core.bundle.radial_slopes(np.array(distortion, float), model.is_fisheye, radii)
    return curve, slope, by_distortion


def _corner_radius(intrinsics: np.ndarray, image_size: tuple[int, int]) -> float:
    """Distorted radius of the picture corner farthest from the principal point, plus 2 %. intrinsics : (4 + k,)."""
    return float(core.bundle.corner_radius(np.array(intrinsics, float), *image_size))


def _poles(model: DistortionModel, intrinsics: np.ndarray) -> np.ndarray:
    """Squared complex ideal radii (m,) of the poles of a rational distortion."""
    bottom = [index for index in _DENOMINATOR[model.camera_model] if index < len(intrinsics) - 4]
    # in one over the squared radius, so that small coefficients do no harm
    inverses = np.roots([1.0, *intrinsics[4:][bottom]])
    return np.asarray(1.0 / inverses[np.abs(inverses) > 1e-6])


def is_monotonic(model: DistortionModel, intrinsics: np.ndarray, image_size: tuple[int, int]) -> bool:
    """Whether the distortion is monotonic over the picture: every pixel has one ray (`Camera.valid_region`) and none
    lies near a pole. A lens that folds can fit its corners well, but beyond them maps two directions to one pixel."""
    # A pole with a zero next to it is narrower than any sampling of the curve, and which comes first often depends on
    # the last digits of the corners: one counts that lies before the curve has, all but, left the picture.
    if not np.isfinite(intrinsics).all():
        return False
    squares = _poles(model, intrinsics)
    near = squares[(squares.real > 0.0) & (np.abs(squares.imag) < LensSettings.nearly_real * np.abs(squares))].real
    if len(near):
        before = np.linspace(0.0, LensSettings.before_pole * np.sqrt(near.min()), LensSettings.radii)
        if _radial_curve(model, intrinsics[4:], before)[0].max() < _corner_radius(intrinsics, image_size):
            return False
    return camera_of(model, intrinsics, image_size).valid_region().image_fraction == 1.0


def pole_distance(model: DistortionModel, intrinsics: np.ndarray, image_size: tuple[int, int]) -> float:
    """Distance, in the complex plane of the ideal radius, between the nearest pole and the interval of radii in the
    picture, relative to the largest of these.

    It is also small where a large numerator and denominator nearly cancel.
    """
    poles = np.sqrt(_poles(model, intrinsics).astype(complex))
    corners = np.array([[x, y] for x in (-0.5, image_size[0] - 0.5) for y in (-0.5, image_size[1] - 0.5)])
    ideal, valid = camera_of(model, intrinsics, image_size).unproject_normalized(corners)
    if not len(poles) or not valid.any():
        return np.inf
    reach = float(np.linalg.norm(ideal[valid], axis=1).max())
    return float(np.abs(poles - np.clip(poles.real, 0.0, reach)).min()) / reach


def rational_like(fisheye: DistortionModel, intrinsics: np.ndarray, image_size: tuple[int, int]) -> np.ndarray | None:
    """(12,) intrinsics of a pole-free rational lens that approximates a fisheye over the picture, as an initial
    value; None for a fisheye that sees more than 86° off its axis or folds. From other initial values a rational lens
    often has a pole just beyond the corners."""
    reach = _corner_radius(intrinsics, image_size)
    angles = np.linspace(0.0, LensSettings.widest_rad, LensSettings.radii)
    curve, slope, _ = _radial_curve(fisheye, intrinsics[4:], angles)
    seen = angles < angles[np.argmax(curve >= reach)]
    if not seen.any() or np.any(slope[seen] <= 0.0):
        return None
    radii = np.tan(angles[seen][1:])
    ratio, square = curve[seen][1:] / radii, radii**2
    powers = square[:, None] ** np.arange(1, 4)
    # without the weight the powers far out would dominate
    weight = 1.0 / (1.0 + square)
    design = np.hstack([powers, -ratio[:, None] * powers]) * weight[:, None]
    least, distortion = np.inf, np.zeros(8)
    # a denominator without negative coefficients has no pole: the best of those in which some of them are zero
    for zero in product((False, True), repeat=3):
        free = np.append(np.ones(3, bool), ~np.array(zero))
        found = np.zeros(6)
        found[free] = np.linalg.lstsq(design[:, free], (ratio - 1.0) * weight, rcond=None)[0]
        misfit = float(np.linalg.norm(design @ found - (ratio - 1.0) * weight))
        if misfit < least and found[3:].min() >= 0.0:
            least, distortion[[*_NUMERATOR["opencv"], *_DENOMINATOR["opencv"]]] = misfit, found
    return np.concatenate([intrinsics[:4], distortion])


def division_like(model: DistortionModel, division: float, reach: float) -> np.ndarray:
    """(k,) distortion coefficients that approximate the division model, ideal radius r / (1 + λr²) of a distorted
    radius r, up to `reach`."""
    distortion = np.zeros(model.distortion_count)
    free = [index for index in _NUMERATOR[model.camera_model][:2] if index in model.free]
    if (division == 0.0 and model.camera_model != "fisheye") or not free:
        return distortion
    distorted = np.linspace(0.0, reach, LensSettings.radii)[1:]
    ideal = distorted / np.maximum(1.0 + division * distorted**2, 1e-3)
    if model.camera_model == "fisheye":
        ideal = np.arctan(ideal)
    # a polynomial of a radius far beyond 1 is no start
    near = ideal < LensSettings.widest_rad
    powers = ideal[near, None] ** (2 * np.arange(1, len(free) + 1))
    weight = 1.0 / (1.0 + ideal[near] ** 2)
    target = (distorted / ideal - 1.0)[near] * weight
    distortion[free] = np.linalg.lstsq(powers * weight[:, None], target, rcond=None)[0]
    return distortion
