"""The camera: pixels to rays and back, exact where valid and marked where not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.core.arrays import ArrayT, as_floats, fixed, is_tensor, masked, of_shape, validate_arguments, working
from vbaa_calib.core.errors import InputError, about, quoted
from vbaa_calib.core.files import read_json, write_json
from vbaa_calib.geometry.covariance import is_covariance

from .lens import Intrinsics, from_core, lens_of
from .models import MODELS, LensModel


def _checked_image_size(image_size: Any) -> tuple[int, int]:
    """(width, height), positive integers."""
    size = list(image_size) if isinstance(image_size, Sequence | np.ndarray) else []
    if len(size) != 2 or not all(isinstance(side, int | np.integer) and side > 0 for side in size):
        raise InputError(
            f"image_size is {quoted(image_size)}", remedy="give it as two positive integers, (width, height)"
        )
    return int(size[0]), int(size[1])


def _checked_matrix(matrix: Any) -> np.ndarray:
    """(3, 3) read-only copy of a camera matrix with fx, fy > 0, no skew and last row 0 0 1."""
    values = fixed(matrix, (3, 3), "the camera matrix")
    if values[0, 0] <= 0 or values[1, 1] <= 0:
        raise InputError(
            f"the camera matrix is singular or mirrored: fx = {values[0, 0]:g}, fy = {values[1, 1]:g}",
            remedy="both focal lengths must be positive pixels",
        )
    if values[0, 1] != 0 or values[1, 0] != 0 or values[2].tolist() != [0, 0, 1]:
        raise InputError("the camera matrix has skew or a wrong last row", remedy="give [[fx,0,cx],[0,fy,cy],[0,0,1]]")
    return values


def _checked_distortion(distortion: Any, model: LensModel) -> np.ndarray:
    """(k,) read-only copy of the coefficients; OpenCV's (1, k) and (k, 1) are accepted too."""
    values = as_floats(distortion, "distortion", "give finite numbers")
    if values.size != max(values.shape, default=0) or values.size not in model.counts:
        allowed = ", ".join(map(str, model.counts))
        raise InputError(
            f"distortion has the shape {values.shape}", remedy=f"the model {model.name!r} takes {allowed} coefficients"
        )
    return fixed(values.reshape(-1), (values.size,), "distortion")


def _checked_covariance(covariance: Any, count: int) -> np.ndarray:
    """(count, count) read-only copy of a symmetric, positive semidefinite matrix."""
    values = fixed(covariance, (count, count), "the covariance")
    if not is_covariance(values):
        raise InputError("the covariance is not symmetric and positive", remedy="calibrate again")
    return values


@dataclass(frozen=True)
class ValidRegion:
    """Region around the optical axis in which a lens maps one to one.

    Attributes
    ----------
    ideal_radius : largest radius of X/Z, Y/Z (angle from the axis in rad for the fisheye) trusted in every direction.
    distorted_radius : the same on the sensor's normalized plane. Both are inf for a lens without a limit.
    half_angle_rad : `ideal_radius` as an angle from the axis.
    image_fraction : share of the image with a ray for each pixel.
    """

    ideal_radius: float
    distorted_radius: float
    half_angle_rad: float
    image_fraction: float


SCHEMA = "vbaa.camera/1"


@dataclass(frozen=True, eq=False, repr=False)
class Camera:
    """A calibrated camera. Pixel (0, 0) is the centre of the first pixel; x right, y down, z forward.

    NumPy in gives NumPy out, torch gives torch (differentiable); float32 and float64 stay what they are, and torch
    stays on its device. Points that have no answer are NaN and False, never a wrong number.

    Attributes
    ----------
    model : "opencv" (0, 4, 5, 8, 12 or 14 coefficients) or "fisheye" (4).
    image_size : (width, height) in pixels.
    matrix : (3, 3), no skew.
    distortion : (k,) in OpenCV's order.
    covariance : (4 + k, 4 + k) of `parameter_names`, or None where unknown.
    parameter_names : fx, fy, cx, cy and the coefficients; filled in when left empty.

    Raises InputError for an unknown model, a wrong number of coefficients, or a matrix that is no camera's.
    """

    model: str
    image_size: tuple[int, int]
    matrix: np.ndarray
    distortion: np.ndarray
    covariance: np.ndarray | None = None
    parameter_names: tuple[str, ...] = ()
    intrinsics: Intrinsics = field(init=False)

    def __post_init__(self) -> None:
        if not isinstance(self.model, str) or self.model not in MODELS:
            raise InputError(
                f"the camera model is {quoted(self.model)}", remedy=f"choose one of {', '.join(sorted(MODELS))}"
            )
        model = MODELS[self.model]
        matrix, distortion = _checked_matrix(self.matrix), _checked_distortion(self.distortion, model)
        names = ("fx", "fy", "cx", "cy", *model.coefficient_names[: distortion.size])
        if self.parameter_names and tuple(self.parameter_names) != names:
            raise InputError(f"the parameters are {list(self.parameter_names)}", remedy=f"give them as {list(names)}")
        fx, fy, cx, cy = matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        checked = {
            "image_size": _checked_image_size(self.image_size),
            "matrix": matrix,
            "distortion": distortion,
            "covariance": None if self.covariance is None else _checked_covariance(self.covariance, len(names)),
            "parameter_names": names,
            "intrinsics": Intrinsics(model, fx, fy, cx, cy, tuple(distortion.tolist())),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        values = zip(self.parameter_names, self.parameters.tolist(), strict=True)
        numbers = ", ".join(f"{name} {value:.6g}" for name, value in values)
        return f"<Camera: {self.model}, {'x'.join(map(str, self.image_size))} px, {numbers}>"

    @property
    def parameters(self) -> np.ndarray:
        """(4 + k,) parameters in the order of `parameter_names`."""
        return np.concatenate([self.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], self.distortion])

    @validate_arguments
    def moved(self, step: np.ndarray) -> Camera:
        """The camera with its parameters changed by a step (4 + k,); the covariance is unchanged."""
        step = of_shape(step, self.parameters.shape, "step", finite=False)
        matrix = self.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
        return replace(self, matrix=matrix, distortion=self.distortion + step[4:])

    @validate_arguments
    def part(self, binning: tuple[int, int] = (1, 1), roi: tuple[int, int, int, int] | None = None) -> Camera:
        """The camera of cropped and binned pictures: first cropped to `roi` (left, top, width, height; px), then
        binned horizontally and vertically.

        Raises InputError for a part that is not inside its pictures.
        """
        left, top, width, height = roi or (0, 0, *self.image_size)
        inside = min(left, top) >= 0 and left + width <= self.image_size[0] and top + height <= self.image_size[1]
        if not inside or min(width // binning[0], height // binning[1]) < 1:
            whole = "x".join(map(str, self.image_size))
            what = f"a part of {width}x{height} px at ({left}, {top}) is not inside a picture of {whole} px"
            raise InputError(what, remedy="give left, top, width and height in pixels of the whole picture")
        # a pixel of a binned picture has its centre between those of the pixels that it joins
        corner = np.array([left + (binning[0] - 1) / 2.0, top + (binning[1] - 1) / 2.0])
        matrix = self.matrix.copy()
        matrix[:2, 2] -= corner
        matrix[:2] /= np.array(binning)[:, None]
        scale = np.ones(len(self.parameters))
        scale[:4] = 1.0 / np.array([*binning, *binning])
        covariance = None if self.covariance is None else self.covariance * np.outer(scale, scale)
        size = width // binning[0], height // binning[1]
        return replace(self, image_size=size, matrix=matrix, covariance=covariance)

    @validate_arguments
    def in_picture(self, pixels: np.ndarray) -> np.ndarray:
        """(...) mask of the pixels (..., 2) in the picture, up to the outer edges of its outermost ones; False for
        NaN."""
        if pixels.shape[-1:] != (2,):
            raise InputError(f"pixels have the shape {pixels.shape}", remedy="give them as (..., 2)")
        return np.all((pixels > -0.5) & (pixels < np.array(self.image_size) - 0.5), axis=-1)

    @validate_arguments
    def save(self, path: Path | str, *, force: bool = False) -> None:
        """Write camera.json, completely or not at all. Raises InputError for an existing file, unless `force`."""
        write_json(Path(path), self.to_dict(), force, Camera.from_dict)

    @staticmethod
    @validate_arguments
    def load(path: Path | str) -> Camera:
        """The camera in a camera.json. Raises InputError naming the file and what is wrong with it."""
        with about(path):
            return Camera.from_dict(read_json(Path(path)))

    @staticmethod
    @validate_arguments
    def from_dict(data: Mapping[str, Any]) -> Camera:
        """The camera from the keys of camera.json; other keys are ignored. Raises InputError for a missing or wrong
        one."""
        if data.get("schema") != SCHEMA:
            raise InputError(f"the schema is {data.get('schema')!r}", remedy=f"a camera has the schema {SCHEMA!r}")
        for key in ("model", "image_size", "matrix", "distortion"):
            if key not in data:
                raise InputError(f"the camera has no {key}", remedy="write it again, or add the key")
        names = data.get("parameters") or []
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise InputError(f"parameters is {names!r}", remedy="give the names of the covariance's rows as a list")
        return Camera(
            data["model"], data["image_size"], data["matrix"], data["distortion"], data.get("covariance"), tuple(names)
        )

    def to_dict(self) -> dict[str, Any]:
        """The keys of camera.json, ready for JSON."""
        return {
            "schema": SCHEMA,
            "model": self.model,
            "image_size": list(self.image_size),
            "matrix": self.matrix.tolist(),
            "distortion": self.distortion.tolist(),
            "covariance": None if self.covariance is None else self.covariance.tolist(),
            "parameters": list(self.parameter_names),
        }

    def unproject(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Unit rays (..., 3) in the camera frame of pixels (..., 2), and whether each is valid (...)."""
        return self._answer("unproject", "pixel_to_ray", pixels, 2, "pixels")

    def project(self, points: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Pixels (..., 2) of points (..., 3) in the camera frame, and whether each is valid (...).

        Valid are points that the lens sees one to one, also outside the image's borders.
        """
        return self._answer("project", "point_to_pixel", points, 3, "points")

    def unproject_normalized(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Ideal X/Z, Y/Z (..., 2) of pixels (..., 2), and validity (...). Rays at 90° and beyond are not valid."""
        return self._answer("normalized", "pixel_to_normalized", pixels, 2, "pixels")

    def normalized_with_slopes(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT, ArrayT]:
        """`unproject_normalized` with its Jacobian d(X/Z, Y/Z)/d(u, v): points (..., 2), Jacobians (..., 2, 2),
        validity (...).

        They carry pixel noise to normalized coordinates. NaN where not valid. Tensors come back without gradients.
        """
        points, valid, slopes = from_core(self.intrinsics, "normalized", pixels, 2, "pixels", True)
        return points, slopes.reshape(*valid.shape, 2, 2), valid

    def lens_slopes_at(self, points: ArrayT) -> ArrayT:
        """d(X/Z, Y/Z)/d(parameters), (..., 2, 4 + k), at ideal normalized points (..., 2), with their pixels fixed.

        NaN where the lens does not see the point one to one. Tensors come back without gradients.
        """
        return from_core(self.intrinsics, "normalized_by_lens", points, 2, "points")[0]

    def valid_region(self) -> ValidRegion:
        """The region in which this lens is one to one, and the share of the picture that it covers, border pixels
        included."""
        lens = lens_of(self.intrinsics)
        columns, rows = (np.linspace(-0.5, size - 0.5, 64) for size in self.image_size)
        valid = self.unproject(np.stack(np.meshgrid(columns, rows), -1))[1]
        limit = lens.ideal_limit
        half_angle = limit if self.intrinsics.model.is_fisheye else math.atan(limit)
        return ValidRegion(limit, lens.distorted_limit, half_angle, float(valid.mean()))

    def _answer(self, method: str, of_tensors: str, values: ArrayT, last: int, name: str) -> tuple[ArrayT, ArrayT]:
        """Values and validity of a map: by a method of the core's lens for arrays, by a function of `tensors` for
        tensors."""
        if not is_tensor(values):
            result, valid, *_ = from_core(self.intrinsics, method, values, last, name)
            return result, valid
        from . import tensors  # loads torch

        ready, restore = working(values, last, name)
        result, valid = getattr(tensors, of_tensors)(self.intrinsics, ready)
        return restore(masked(result, valid)), valid
