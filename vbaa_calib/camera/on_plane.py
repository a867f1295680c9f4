"""Pixels to metres on a plane in the camera's view: the metric layer, as a torch module. Loads torch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from vbaa_calib.core.arrays import ArrayT, is_tensor, like, masked, working
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import PLANE_C, Plane, Pose

from .camera import Camera
from .lens import Intrinsics, from_core
from .models import MODELS
from .plane import cross, in_plane_axes
from .tensors import pixel_to_ray


class CameraOnPlane(torch.nn.Module):
    """Intersections of pixels' rays with a plane, in metres.

    Lens, camera pose and plane are buffers in float64: they move with `.to(device)`, stay float64 when the network
    around them is cast (`.half()`, `.float()`), and become part of the graph when they are made to require gradients
    or are swapped by `torch.func.functional_call`. Pixels may have any
    leading shape, float32 or float64; NumPy in gives NumPy out. What has no answer (outside the lens's valid region,
    parallel, grazing, behind the camera, a plane through its centre) is NaN and False, and its gradient is zero.

    Parameters
    ----------
    camera : the lens.
    T_antenna_camera : pose of the camera in the antenna frame.
    plane : in the antenna frame; plane C by default. `hinge_plane(roll)` gives the deformation plane.
    """

    matrix: torch.Tensor
    distortion: torch.Tensor
    rotation: torch.Tensor
    translation_m: torch.Tensor
    normal: torch.Tensor
    offset_m: torch.Tensor
    axes: torch.Tensor

    def __init__(self, camera: Camera, T_antenna_camera: Pose, plane: Plane = PLANE_C) -> None:
        super().__init__()
        self.camera, self.T_antenna_camera, self.plane = camera, T_antenna_camera, plane
        length = np.linalg.norm(plane.normal)
        if not np.isfinite(plane.offset_m) or not abs(length - 1.0) < 1e-6:
            raise InputError(
                f"the plane's normal has the length {length:g}", remedy="give a unit normal, finite offset"
            )
        buffers: dict[str, np.ndarray | float] = {
            "matrix": camera.matrix,
            "distortion": camera.distortion,
            "rotation": T_antenna_camera.rotation,
            "translation_m": T_antenna_camera.translation_m,
            "normal": plane.normal,
            "offset_m": plane.offset_m,
            "axes": in_plane_axes(plane),
        }
        for name, value in buffers.items():
            if not np.isfinite(value).all():
                raise InputError(f"{name} has NaN or infinity in it", remedy="give finite numbers")
            self.register_buffer(name, torch.tensor(np.asarray(value), dtype=torch.float64))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The parameters of `calibration_jacobian`: the camera's, then the pose's."""
        # the camera's small motion as `Pose.retract` takes it: rad, then m, antenna frame
        motion = tuple(f"{kind}_{axis}" for kind in ("rotation", "translation") for axis in "xyz")
        return self.camera.parameter_names + motion

    def forward(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Coordinates and validity, as `project`."""
        return self.project(pixels)

    def project(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Coordinates on the plane (..., 2) m of pixels (..., 2), and validity (...).

        On plane C they are the antenna frame's x and y; on the hinge plane x and the way along the roll.
        """
        return self._answer(pixels, self.axes)

    def points(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Points (..., 3) m on the plane, antenna frame, at pixels (..., 2), and validity (...)."""
        return self._answer(pixels, torch.eye(3, dtype=torch.float64))

    def pixel_jacobian(self, pixels: ArrayT) -> ArrayT:
        """d(coordinates on the plane)/d(u, v), (..., 2, 2) m/px. NaN where not valid."""
        return self._jacobian(pixels, by_parameter=False)

    def calibration_jacobian(self, pixels: ArrayT) -> ArrayT:
        """d(coordinates on the plane)/d(parameters), (..., 2, P), in `parameter_names` order. NaN where not valid.

        With the joint covariance Σ of the parameters, J Σ Jᵀ is the covariance of all points with one another.
        """
        return self._jacobian(pixels, by_parameter=True)

    def covariance(self, pixels: ArrayT, sigma_px: float | ArrayT) -> ArrayT:
        """Covariance (..., 2, 2) m² on the plane from independent pixel noise of sigma_px, a number or (...). Raises
        InputError where sigma_px is negative."""
        jacobian = self.pixel_jacobian(pixels)
        sigma = like(jacobian, sigma_px)[..., None, None]
        if (sigma < 0.0).any():
            raise InputError("sigma_px is negative", remedy="give the standard deviation of the pixels, px")
        return (jacobian * sigma) @ (jacobian * sigma).swapaxes(-1, -2)

    def _apply(self, fn: Callable[[torch.Tensor], torch.Tensor], recurse: bool = True) -> CameraOnPlane:
        # a focal length in half precision is pixels off: what moves or casts the network only moves these
        exact = dict(self._buffers)
        super()._apply(fn, recurse)
        for name, value in exact.items():
            moved = self._buffers[name]
            if value is not None and moved is not None:
                self._buffers[name] = value.to(moved.device) if moved.dtype != value.dtype else moved
        return self

    def _answer(self, pixels: ArrayT, axes: torch.Tensor) -> tuple[ArrayT, ArrayT]:
        if not is_tensor(pixels):
            place = self._place(axes)
            points, known = from_core(self._intrinsics(), "on_plane", pixels, 2, "pixels", *place, single=True)
            return points, known
        values, restore = working(pixels, 2, "pixels")
        K, c = self.matrix.to(values), self.distortion.to(values)
        intrinsics = Intrinsics(MODELS[self.camera.model], K[0, 0], K[1, 1], K[0, 2], K[1, 2], c)
        rays, seen = pixel_to_ray(intrinsics, values)
        pose = self.translation_m.to(rays), rays @ self.rotation.to(rays).T
        points, crosses = cross(*pose, self.normal.to(rays), self.offset_m.to(rays))
        valid = seen & crosses
        return restore(masked(points @ axes.to(rays).T, valid)), valid

    def _jacobian(self, pixels: ArrayT, by_parameter: bool) -> ArrayT:
        place = self._place(self.axes)
        return from_core(self._intrinsics(), "plane_slopes", pixels, 2, "pixels", *place, by_parameter)[0]

    def _intrinsics(self) -> Intrinsics:
        (fx, _, cx), (_, fy, cy), _ = self.matrix.tolist()
        return Intrinsics(MODELS[self.camera.model], fx, fy, cx, cy, tuple(self.distortion.tolist()))

    def _place(self, axes: torch.Tensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The camera's pose (3, 4), the plane's normal and offset (4,), and axes (2 or 3, 3), for the core."""
        place = (
            torch.cat([self.rotation, self.translation_m[:, None]], 1),
            torch.cat([self.normal, self.offset_m[None]]),
        )
        pose, plane, rows = (each.detach().double().cpu().contiguous().numpy() for each in (*place, axes))
        return pose, plane, rows
