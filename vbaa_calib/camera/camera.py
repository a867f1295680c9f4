"""The camera: pixels to rays and back, exact where valid and marked where not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import ArrayT, masked, working
from ..errors import InputError
from ..files import read_json
from .checks import checked_covariance, checked_distortion, checked_image_size, checked_matrix, checked_model
from .projection import Intrinsics, pixel_to_normalized, pixel_to_ray, point_to_pixel
from .region import ValidRegion, valid_region
from .slopes import normalized_by_lens, pixel_to_normalized_with_slopes

SCHEMA = "vbaa.camera/1"
_MATRIX_NAMES = ("fx", "fy", "cx", "cy")


@dataclass(frozen=True, eq=False)
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

    Raises
    ------
    InputError : for an unknown model, a wrong number of coefficients, or a matrix that is no camera's.
    """

    model: str
    image_size: tuple[int, int]
    matrix: np.ndarray
    distortion: np.ndarray
    covariance: np.ndarray | None = None
    parameter_names: tuple[str, ...] = ()
    intrinsics: Intrinsics = field(init=False, repr=False)

    def __post_init__(self) -> None:
        model = checked_model(self.model)
        matrix, distortion = checked_matrix(self.matrix), checked_distortion(self.distortion, model)
        names = _MATRIX_NAMES + model.coefficient_names[: distortion.size]
        if self.parameter_names and tuple(self.parameter_names) != names:
            raise InputError(f"the parameters are {list(self.parameter_names)}", remedy=f"give them as {list(names)}")
        settled = {
            "image_size": checked_image_size(self.image_size),
            "matrix": matrix,
            "distortion": distortion,
            "covariance": None if self.covariance is None else checked_covariance(self.covariance, len(names)),
            "parameter_names": names,
            "intrinsics": Intrinsics(
                model,
                float(matrix[0, 0]),
                float(matrix[1, 1]),
                float(matrix[0, 2]),
                float(matrix[1, 2]),
                tuple(distortion.tolist()),
            ),
        }
        for name, value in settled.items():
            object.__setattr__(self, name, value)

    @property
    def parameters(self) -> np.ndarray:
        """(4 + k,) the numbers of `parameter_names`."""
        return np.concatenate([self.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], self.distortion])

    def moved(self, step: np.ndarray) -> Camera:
        """With its parameters a step (4 + k,) away; the covariance stays."""
        matrix = self.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
        return replace(self, matrix=matrix, distortion=self.distortion + step[4:])

    def in_picture(self, pixels: np.ndarray) -> np.ndarray:
        """(...) whether pixels (..., 2) lie in the picture, to the outer edges of its outermost ones; NaN does not."""
        return np.all((pixels > -0.5) & (pixels < np.array(self.image_size) - 0.5), axis=-1)

    @staticmethod
    def load(path: Path | str) -> Camera:
        """From a camera.json. Raises InputError naming the file and what is wrong with it."""
        try:
            return Camera.from_dict(read_json(Path(path)))
        except InputError as error:
            raise error if error.where else InputError(error.what, where=path, remedy=error.remedy) from None

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Camera:
        """From the keys of camera.json; other keys are ignored. Raises InputError for a missing or wrong one."""
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

    @property
    def path(self) -> str:
        """The cheapest exact way through this lens: "none", "radial" (one unknown a point) or "full" (two)."""
        model, c = self.intrinsics.model, self.intrinsics.separate
        return model.path(c) if model.tilt(c) is None else "full"

    def unproject(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Unit rays (..., 3) in the camera frame of pixels (..., 2), and whether each is valid (...)."""
        return self._answer(pixel_to_ray, pixels, 2, "pixels")

    def project(self, points: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Pixels (..., 2) of points (..., 3) in the camera frame, and whether each is valid (...).

        Valid are points that the lens sees one to one, also outside the image's borders.
        """
        return self._answer(point_to_pixel, points, 3, "points")

    def unproject_normalized(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Ideal X/Z, Y/Z (..., 2) of pixels (..., 2), and validity (...). Rays at 90° and beyond are not valid."""
        return self._answer(pixel_to_normalized, pixels, 2, "pixels")

    def jacobian(self, pixels: ArrayT) -> ArrayT:
        """d(X/Z, Y/Z)/d(u, v), (..., 2, 2), at pixels (..., 2); NaN where not valid.

        It carries pixel noise to normalized coordinates.
        """
        return self.normalized_with_slopes(pixels)[1]

    def normalized_with_slopes(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT, ArrayT]:
        """`unproject_normalized` and `jacobian` for the price of one: points (..., 2), slopes (..., 2, 2), valid (...).

        Both are NaN where not valid. Tensors come back without gradients.
        """
        work = working(pixels, 2, "pixels")
        points, slopes, valid = pixel_to_normalized_with_slopes(self.intrinsics, work.values)
        return work.restore(points), work.restore(slopes), valid

    def lens_jacobian(self, pixels: ArrayT) -> ArrayT:
        """d(X/Z, Y/Z)/d(parameters) of fixed pixels (..., 2), (..., 2, 4 + k) in `parameter_names` order; NaN where
        not valid."""
        return self.lens_slopes_at(self.normalized_with_slopes(pixels)[0])

    def lens_slopes_at(self, points: ArrayT) -> ArrayT:
        """`lens_jacobian` at the pixels of ideal normalized points (..., 2), which need not be found: (..., 2, 4 + k).

        NaN where the lens does not see the point one to one. Tensors come back without gradients.
        """
        work = working(points, 2, "points")
        return work.restore(normalized_by_lens(self.intrinsics, work.values))

    def valid_region(self) -> ValidRegion:
        """Where this lens is one to one, and what share of the image that covers."""
        return valid_region(self.intrinsics, self.image_size)

    def _answer(self, function: Any, given: ArrayT, last: int, name: str) -> tuple[ArrayT, ArrayT]:
        work = working(given, last, name)
        with np.errstate(all="ignore"):
            values, valid = function(self.intrinsics, work.values)
        return work.restore(masked(values, valid)), valid
