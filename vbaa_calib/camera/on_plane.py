"""Pixels to metres on a plane that the camera sees: the metric layer, as a torch module."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from ..errors import InputError
from ..geometry import PLANE_C, Plane, Pose
from .arrays import ArrayT, masked, widest_float, working
from .camera import Camera
from .intersection import Crossing, cross, in_plane_axes
from .models import MODELS
from .projection import Intrinsics, RayDerivatives, pixel_to_ray, ray_derivatives

POSE_NAMES = ("rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z")
"""Small motion of the camera, as `Pose.retract` takes it: rotation vector in rad, translation in m, antenna frame."""


class CameraOnPlane(torch.nn.Module):
    """Where the rays of pixels meet a plane, in metres.

    Lens, camera pose and plane are buffers in float64: they move with `.to(device)`, and become part of the graph
    when they are made to require gradients or are swapped by `torch.func.functional_call`. Pixels may have any
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
            raise InputError(f"the plane's normal has the length {length:g}", remedy="give a finite plane, normal of 1")
        buffers = {
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
        """What `calibration_jacobian` differentiates by: the camera's parameters, then the pose's."""
        return self.camera.parameter_names + POSE_NAMES

    def forward(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """The same as `project`."""
        return self.project(pixels)

    def project(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """Coordinates on the plane (..., 2) m of pixels (..., 2), and validity (...).

        On plane C they are the antenna frame's x and y; on the hinge plane x and the way along the roll.
        """
        return self._answer(pixels, lambda crossing: crossing.points @ self.axes.to(crossing.points).T)

    def points(self, pixels: ArrayT) -> tuple[ArrayT, ArrayT]:
        """The same points (..., 3) m in the antenna frame, and validity (...)."""
        return self._answer(pixels, lambda crossing: crossing.points)

    def pixel_jacobian(self, pixels: ArrayT) -> ArrayT:
        """d(coordinates on the plane)/d(u, v), (..., 2, 2) m/px. NaN where not valid."""
        return self._jacobian(pixels, lambda moved, on_plane, crossing: on_plane @ (self._turned(moved.by_pixel)))

    def calibration_jacobian(self, pixels: ArrayT) -> ArrayT:
        """d(coordinates on the plane)/d(parameters), (..., 2, P), in the order of `parameter_names`; NaN where not valid.

        With the joint covariance Σ of the parameters, J Σ Jᵀ is the covariance of all points with one another.
        """
        return self._jacobian(pixels, self._by_calibration)

    def covariance(self, pixels: ArrayT, sigma_px: float | ArrayT) -> ArrayT:
        """Covariance (..., 2, 2) m² on the plane from independent pixel noise of sigma_px, a number or (...)."""
        jacobian = self.pixel_jacobian(pixels)
        variance = torch.as_tensor(sigma_px) ** 2
        if isinstance(jacobian, np.ndarray):
            return jacobian @ np.swapaxes(jacobian, -1, -2) * variance.numpy()[..., None, None].astype(jacobian.dtype)
        return jacobian @ jacobian.mT * variance.to(jacobian)[..., None, None]

    def calibration_covariance(self, pixels: ArrayT, parameter_covariance: np.ndarray) -> ArrayT:
        """Covariance (N, 2, N, 2) m² of N points with one another, from the parameters' (P, P)."""
        jacobian = self.calibration_jacobian(pixels)
        count = len(self.parameter_names)
        if jacobian.ndim != 3 or np.shape(parameter_covariance) != (count, count):
            raise InputError(
                f"pixels {tuple(pixels.shape)} and covariance {np.shape(parameter_covariance)} do not fit",
                remedy=f"give them as (N, 2) and ({count}, {count})",
            )
        flat = jacobian.reshape(-1, count)
        shape = (len(jacobian), 2, len(jacobian), 2)
        if isinstance(flat, np.ndarray):
            return (flat @ np.asarray(parameter_covariance, flat.dtype) @ flat.T).reshape(shape)
        return (flat @ torch.as_tensor(parameter_covariance).to(flat) @ flat.T).reshape(shape)

    def _intrinsics(self, device: torch.device) -> Intrinsics:
        matrix, distortion = (value.to(widest_float(device)) for value in (self.matrix, self.distortion))
        return Intrinsics(
            MODELS[self.camera.model], matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], distortion
        )

    def _turned(self, vectors: torch.Tensor) -> torch.Tensor:
        """Columns (..., 3, n) of the camera frame in the antenna frame."""
        return self.rotation.to(vectors) @ vectors

    def _crossing(self, rays: torch.Tensor) -> Crossing:
        directions = rays @ self.rotation.to(rays).T
        return cross(self.translation_m.to(rays), directions, self.normal.to(rays), self.offset_m.to(rays))

    def _answer(self, pixels: ArrayT, wanted: Callable[[Crossing], torch.Tensor]) -> tuple[ArrayT, ArrayT]:
        work = working(pixels, 2, "pixels")
        values = torch.as_tensor(work.values)
        rays, seen = pixel_to_ray(self._intrinsics(values.device), values)
        crossing = self._crossing(rays)
        valid = seen & crossing.valid
        result = masked(wanted(crossing), valid)
        if isinstance(pixels, torch.Tensor):
            return work.restore(result), valid
        return work.restore(result.detach().numpy()), valid.numpy()

    def _jacobian(
        self, pixels: ArrayT, wanted: Callable[[RayDerivatives, torch.Tensor, Crossing], torch.Tensor]
    ) -> ArrayT:
        work = working(pixels, 2, "pixels")
        values = torch.as_tensor(work.values)
        with torch.no_grad():
            moved = ray_derivatives(self.camera.intrinsics, values)
            crossing = self._crossing(moved.rays)
            directions = moved.rays @ self.rotation.to(values).T
            # a direction that turns by dm, or an origin that moves by it, moves the point by (1 − m nᵀ/(n·m)) dm
            slide = torch.eye(3).to(values) - (
                directions[..., :, None] * self.normal.to(values) / crossing.slant[..., None, None]
            )
            on_plane = self.axes.to(values) @ slide
            jacobian = masked(wanted(moved, on_plane, crossing), moved.valid & crossing.valid)
        return work.restore(jacobian if isinstance(pixels, torch.Tensor) else jacobian.numpy())
