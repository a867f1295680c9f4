"""Lens models: a chart of directions, followed by a map of the plane onto the sensor.

Formulas take and give coordinates one by one, each (...), NumPy or torch. Coefficients come as a sequence of floats,
or of tensors where gradients are wanted.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.polynomial import polynomial

from vbaa_calib.core.arrays import Array, is_tensor, matrix

if TYPE_CHECKING:
    import torch

Coefficients = Sequence[Array]
Matrix = tuple[Array, Array, Array, Array]  # (xx, xy, yx, yy), each (...) or a number
_Path = Literal["none", "radial", "full"]
_SMALL_ANGLE_SQUARED = 1e-6
_LEAST_DEPTH = 1e-12  # Z of a unit vector from which on X/Z counts as a number


class _Perspective:
    """The z = 1 plane: the directions in front of the camera.

    A chart is how directions in the camera frame are laid out on a plane before a lens bends them. radius_limit : no
    direction lies farther out. is_normalized : whether its coordinates are X/Z, Y/Z.
    """

    radius_limit = math.inf
    is_normalized = True

    def to_plane(self, xp: ModuleType, X: Array, Y: Array, Z: Array) -> tuple[Array, Array, Array]:
        """x, y, and whether it is seen, of vectors of any length; x = y = 0 where not."""
        seen = Z > 0
        depth = xp.where(seen, Z, 1.0)
        return xp.where(seen, X / depth, 0.0), xp.where(seen, Y / depth, 0.0), seen

    def to_ray(self, xp: ModuleType, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Unit vectors."""
        z = 1.0 / xp.sqrt(1.0 + x * x + y * y)
        return x * z, y * z, z

    def ray_jacobian(self, xp: ModuleType, x: Array, y: Array) -> Array:
        """d(unit vector)/d(x, y), (..., 3, 2)."""
        z2 = 1.0 / (1.0 + x * x + y * y)
        z3 = z2 * xp.sqrt(z2)
        return matrix(xp, [[(1.0 + y * y) * z3, -x * y * z3], [-x * y * z3, (1.0 + x * x) * z3], [-x * z3, -y * z3]])

    def half_angle(self, radius: float) -> float:
        """Angle from the axis, rad, at a radius in the chart."""
        return math.atan(radius)

    def normalized(self, xp: ModuleType, x: Array, y: Array) -> tuple[Array, Array, Matrix, Array]:
        """X/Z, Y/Z, their derivatives by x and y, and whether Z > 0."""
        return x, y, (1.0, 0.0, 0.0, 1.0), xp.isfinite(x) & xp.isfinite(y)


class _Equidistant:
    """As `_Perspective`, every direction but straight back, at its angle θ from the axis."""

    radius_limit = math.pi
    is_normalized = False

    def to_plane(self, xp: ModuleType, X: Array, Y: Array, Z: Array) -> tuple[Array, Array, Array]:
        off_axis2 = X * X + Y * Y
        near = (Z > 0) & (off_axis2 < _SMALL_ANGLE_SQUARED * Z * Z)
        seen = near | (off_axis2 > 0)
        # each branch gets arguments at which it and its gradient are finite, also where the other one is taken
        depth = xp.where(near, Z, 1.0)
        tan2 = xp.where(near, off_axis2, 0.0) / (depth * depth)
        off_axis = xp.sqrt(xp.where(seen & ~near, off_axis2, 1.0))
        far_ratio = xp.arctan2(off_axis, Z) / off_axis
        ratio = xp.where(near, (1.0 - tan2 * (1.0 / 3.0 - tan2 / 5.0)) / depth, far_ratio)
        return xp.where(seen, X * ratio, 0.0), xp.where(seen, Y * ratio, 0.0), seen

    def to_ray(self, xp: ModuleType, x: Array, y: Array) -> tuple[Array, Array, Array]:
        sine_ratio, cosine, _ = self._sine_ratio_and_cosine(xp, x * x + y * y)
        return x * sine_ratio, y * sine_ratio, cosine

    def ray_jacobian(self, xp: ModuleType, x: Array, y: Array) -> Array:
        sine_ratio, _, bend = self._sine_ratio_and_cosine(xp, x * x + y * y)
        shear = x * y * bend
        along = [[sine_ratio + x * x * bend, shear], [shear, sine_ratio + y * y * bend]]
        return matrix(xp, [*along, [-x * sine_ratio, -y * sine_ratio]])

    def half_angle(self, radius: float) -> float:
        return float(radius)

    def normalized(self, xp: ModuleType, x: Array, y: Array) -> tuple[Array, Array, Matrix, Array]:
        sine_ratio, cosine, bend = self._sine_ratio_and_cosine(xp, x * x + y * y)
        ahead = cosine > _LEAST_DEPTH
        inverse = 1.0 / xp.where(ahead, cosine, 1.0)
        tangent_ratio = sine_ratio * inverse
        # d(tan θ/θ)/d(θ²), twice
        growth = bend * inverse + tangent_ratio * tangent_ratio
        shear = growth * x * y
        jacobian = (tangent_ratio + growth * x * x, shear, shear, tangent_ratio + growth * y * y)
        return x * tangent_ratio, y * tangent_ratio, jacobian, ahead

    @staticmethod
    def _sine_ratio_and_cosine(xp: ModuleType, theta2: Array) -> tuple[Array, Array, Array]:
        """sin θ/θ, cos θ, and (cos θ − sin θ/θ)/θ², from θ²."""
        near = theta2 < _SMALL_ANGLE_SQUARED
        theta = xp.sqrt(xp.where(near, 1.0, theta2))
        sine_ratio = xp.where(near, 1.0 - theta2 / 6.0 * (1.0 - theta2 / 20.0), xp.sin(theta) / theta)
        cosine = xp.where(near, 1.0 - theta2 / 2.0 * (1.0 - theta2 / 12.0), xp.cos(theta))
        far_bend = (cosine - sine_ratio) / (theta * theta)
        return sine_ratio, cosine, xp.where(near, -1.0 / 3.0 + theta2 / 30.0, far_bend)


class LensModel(ABC):
    """What a lens model must define; everything else is done for all models alike.

    It maps the ideal point (x, y) in its chart to the distorted point on the sensor's normalized plane: a radial gain
    g(s) with s = x² + y², the rest (decentring, thin prism), then possibly a tilted sensor.
    """

    name: ClassVar[str]  # in camera.json
    chart: ClassVar[_Perspective | _Equidistant]
    coefficient_names: ClassVar[tuple[str, ...]]  # of the longest vector, in file order
    counts: ClassVar[tuple[int, ...]]  # allowed lengths of the coefficient vector

    @abstractmethod
    def radial(self, s: Array, c: Coefficients) -> tuple[Array, Array]:
        """g and dg/ds; a purely radial lens maps (x, y) to g·(x, y)."""

    @abstractmethod
    def path(self, c: Coefficients) -> _Path:
        """The cheapest exact way through the map, the tilt aside: "none" (it changes nothing), "radial", "full"."""

    @abstractmethod
    def linearize(self, x: Array, y: Array, c: Coefficients) -> tuple[Array, Array, Array, Array, Array, Array]:
        """The distorted point and its derivatives: xd, yd, dxd/dx, dxd/dy, dyd/dx, dyd/dy."""

    @abstractmethod
    def by_coefficient(self, x: Array, y: Array, c: Coefficients) -> list[tuple[Array, Array]]:
        """(dxd/dc, dyd/dc) for each coefficient before the tilt."""

    @abstractmethod
    def fold_radius(self, c: Sequence[float]) -> float:
        """Smallest radius at which the radial map stops growing or has a pole; may be inf."""

    def distort(self, x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
        """The distorted point before the sensor's tilt."""
        gain, _ = self.radial(x * x + y * y, c)
        if self.path(c) != "full":
            return x * gain, y * gain
        dx, dy = self.beside(x, y, c)
        return x * gain + dx, y * gain + dy

    def beside(self, x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
        """What of that is not radial: (xd, yd) − g·(x, y)."""
        return 0.0 * x, 0.0 * y

    def tilt(self, c: Coefficients) -> tuple[Array, Array] | None:
        """The sensor's two tilt angles, rad, or None."""
        return None


def _absent(*coefficients: Array) -> bool:
    """Whether all are plain zeros, whose terms need not be computed. A tensor never counts as absent: its term has a
    derivative even where it is zero."""
    return set(map(type, coefficients)) <= {float} and not any(coefficients)


def _smallest_positive_root(coefficients: Sequence[float] | np.ndarray, limit: float) -> float:
    """Smallest real root in (0, limit] of Σ c_i s^i, coefficients (n,), or inf; terms that do not matter up to the
    limit are left out."""
    scaled = np.asarray(coefficients, float) * limit ** np.arange(len(coefficients), dtype=float)
    kept = np.flatnonzero(np.abs(scaled) > 1e-15 * np.abs(scaled).max(initial=0.0))
    if kept.size == 0 or kept[-1] == 0:
        return math.inf
    roots = np.roots(scaled[kept[-1] :: -1])
    # a pair that rounding has lifted off the real axis still counts: the lens is flat there
    real = roots.real[np.abs(roots.imag) <= 1e-7 * np.abs(roots)]
    inside = real[(real > 0.0) & (real <= 1.0)]
    return float(inside.min() * limit) if inside.size else math.inf


_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_POLYNOMIAL, _RATIONAL, _BEFORE_TILT = 5, 8, 12
_BEYOND = 1e6  # folds farther out than 1000 focal lengths (s = 1e6) are of no concern


class _OpenCV(LensModel):
    """OpenCV's lens: rational radial terms, decentring, thin prism, tilted sensor. No coefficients: a pinhole.

    Coefficient order k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]]. With g = (1 + k1 s + k2 s² + k3 s³) /
    (1 + k4 s + k5 s² + k6 s³) and s = x² + y² on the z = 1 plane:

        xd = g x + 2 p1 x y + p2 (s + 2 x²) + s1 s + s2 s²
        yd = g y + p1 (s + 2 y²) + 2 p2 x y + s3 s + s4 s²

    and then the sensor's tilt.
    """

    name = "opencv"
    chart = _Perspective()
    coefficient_names = _NAMES
    counts = (0, 4, 5, 8, 12, 14)

    def radial(self, s: Array, c: Coefficients) -> tuple[Array, Array]:
        k1, k2, _, _, k3, k4, k5, k6, *_ = _padded(c)
        numerator, d_numerator = _series(s, k1, k2, k3)
        if len(c) <= _POLYNOMIAL or _absent(k4, k5, k6):
            return numerator, d_numerator
        denominator, d_denominator = _series(s, k4, k5, k6)
        inverse = 1.0 / denominator
        gain = numerator * inverse
        return gain, (d_numerator - gain * d_denominator) * inverse

    def path(self, c: Coefficients) -> _Path:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, *_ = _padded(c)
        if not _absent(p1, p2, s1, s2, s3, s4):
            return "full"
        return "none" if _absent(k1, k2, k3, k4, k5, k6) else "radial"

    def distort(self, x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
        if is_tensor(x) and len(c):
            return _distort_by_kornia(x, y, c)
        return super().distort(x, y, c)

    def beside(self, x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
        _, _, p1, p2, _, _, _, _, s1, s2, s3, s4, *_ = _padded(c)
        s = x * x + y * y
        twist = (2.0 * p1) * y + (2.0 * p2) * x
        dx, dy = x * twist + p2 * s, y * twist + p1 * s
        if not _absent(s1, s2, s3, s4):
            dx, dy = dx + s * (s1 + s2 * s), dy + s * (s3 + s4 * s)
        return dx, dy

    def linearize(self, x: Array, y: Array, c: Coefficients) -> tuple[Array, Array, Array, Array, Array, Array]:
        _, _, p1, p2, _, _, _, _, s1, s2, s3, s4, *_ = _padded(c)
        s = x * x + y * y
        gain, d_gain = self.radial(s, c)
        twice = 2.0 * d_gain
        along_x, along_y = twice * x, twice * y
        if _absent(p1, p2):
            xd, yd = x * gain, y * gain
            xx, xy, yy = gain + x * along_x, x * along_y, gain + y * along_y
        else:
            # decentring is a gain of 2 (p1 y + p2 x) and (p2 s, p1 s)
            gain = gain + (2.0 * p1) * y + (2.0 * p2) * x
            xd, yd = x * gain + p2 * s, y * gain + p1 * s
            xx, yy = gain + x * (along_x + 4.0 * p2), gain + y * (along_y + 4.0 * p1)
            xy = x * (along_y + 2.0 * p1) + (2.0 * p2) * y
        yx = xy
        if len(c) > _RATIONAL and not _absent(s1, s2, s3, s4):
            xd, yd = xd + s * (s1 + s2 * s), yd + s * (s3 + s4 * s)
            slope_x, slope_y = 2.0 * s1 + 4.0 * s2 * s, 2.0 * s3 + 4.0 * s4 * s
            xx, xy, yx, yy = xx + x * slope_x, xy + y * slope_x, yx + x * slope_y, yy + y * slope_y
        return xd, yd, xx, xy, yx, yy

    def by_coefficient(self, x: Array, y: Array, c: Coefficients) -> list[tuple[Array, Array]]:
        _, _, _, _, _, k4, k5, k6, *_ = _padded(c)
        x2, y2 = x * x, y * y
        s = x2 + y2
        inverse = 1.0 if _absent(k4, k5, k6) else 1.0 / _series(s, k4, k5, k6)[0]
        xy2 = 2.0 * x * y
        columns = _along(x, y, s, s * inverse)
        columns[2:2] = [(xy2, s + 2.0 * y2), (s + 2.0 * x2, xy2)]
        if len(c) > _POLYNOMIAL:
            columns += _along(x, y, s, -s * self.radial(s, c)[0] * inverse)
        if len(c) > _RATIONAL:
            s2, zero = s * s, 0.0 * s
            columns += [(s, zero), (s2, zero), (zero, s), (zero, s2)]
        return columns[: len(c)]

    def tilt(self, c: Coefficients) -> tuple[Array, Array] | None:
        return None if len(c) < len(_NAMES) or _absent(*c[12:]) else (c[12], c[13])

    def fold_radius(self, c: Sequence[float]) -> float:
        k1, k2, _, _, k3, k4, k5, k6, *_ = _padded(c)
        numerator, denominator = (1.0, k1, k2, k3), (1.0, k4, k5, k6)
        # d(r g)/dr has the sign of N D + 2 s (N' D − N D')
        d_numerator, d_denominator = polynomial.polyder(numerator), polynomial.polyder(denominator)
        wronskian = polynomial.polysub(
            polynomial.polymul(d_numerator, denominator), polynomial.polymul(numerator, d_denominator)
        )
        growth = polynomial.polyadd(polynomial.polymul(numerator, denominator), polynomial.polymulx(2.0 * wronskian))
        fold, pole = _smallest_positive_root(growth, _BEYOND), _smallest_positive_root(denominator, _BEYOND)
        return float(np.sqrt(min(fold, pole)))


def _padded(c: Coefficients) -> Coefficients:
    return (*c, *(0.0,) * (len(_NAMES) - len(c)))


def _series(s: Array, a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """1 + a s + b s² + c s³ and its derivative by s; powers that are absent at the end cost nothing."""
    if not _absent(c):
        return 1.0 + s * (a + s * (b + s * c)), a + s * (2.0 * b + s * (3.0 * c))
    if not _absent(b):
        return 1.0 + s * (a + s * b), a + s * (2.0 * b)
    return 1.0 + s * a, a


def _along(x: Array, y: Array, s: Array, first: Array) -> list[tuple[Array, Array]]:
    """(x, y) times the first power's factor, and that times s and s²."""
    return [(x * power, y * power) for power in (first, s * first, s * s * first)]


def _distort_by_kornia(x: torch.Tensor, y: torch.Tensor, c: Coefficients) -> tuple[torch.Tensor, torch.Tensor]:
    """Tensors go through kornia, whose forward map is right and whose gradients others have tested.

    The tilt is left to us: it must also be undone. One point to each of kornia's batches, so that coefficients may
    broadcast against points.
    """
    # importing kornia costs a second, and only those who work with tensors need it
    import torch
    from kornia.geometry.calibration import distort_points

    terms = [torch.as_tensor(value, dtype=x.dtype, device=x.device) for value in c[:_BEFORE_TILT]]
    eye = torch.eye(3, dtype=x.dtype, device=x.device)
    points = torch.stack(torch.broadcast_tensors(x, y), -1)[..., None, :]
    distorted = distort_points(points, eye, torch.stack(torch.broadcast_tensors(*terms), -1), eye)[..., 0, :]
    return distorted[..., 0], distorted[..., 1]


class _Fisheye(LensModel):
    """Kannala and Brandt's fisheye: the image radius is θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), θ the axis' angle.

    On the equidistant chart this is a purely radial polynomial with s = θ², regular on the axis and beyond 90°.
    """

    name = "fisheye"
    chart = _Equidistant()
    coefficient_names = ("k1", "k2", "k3", "k4")
    counts = (4,)

    def radial(self, s: Array, c: Coefficients) -> tuple[Array, Array]:
        k1, k2, k3, k4 = c
        gain = 1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)))
        return gain, k1 + s * (2.0 * k2 + s * (3.0 * k3 + s * (4.0 * k4)))

    def path(self, c: Coefficients) -> _Path:
        return "none" if _absent(*c) else "radial"

    def linearize(self, x: Array, y: Array, c: Coefficients) -> tuple[Array, Array, Array, Array, Array, Array]:
        x2, y2 = x * x, y * y
        gain, d_gain = self.radial(x2 + y2, c)
        twice = 2.0 * d_gain
        shear = twice * x * y
        return x * gain, y * gain, gain + twice * x2, shear, shear, gain + twice * y2

    def by_coefficient(self, x: Array, y: Array, c: Coefficients) -> list[tuple[Array, Array]]:
        s = x * x + y * y
        return [(x * power, y * power) for power in (s, s * s, s * s * s, s * s * s * s)]

    def fold_radius(self, c: Sequence[float]) -> float:
        growth = [1.0] + [(2 * i + 3) * k for i, k in enumerate(c)]
        return math.sqrt(_smallest_positive_root(growth, math.pi**2))


MODELS: dict[str, LensModel] = {model.name: model for model in (_OpenCV(), _Fisheye())}  # name in camera.json → model
