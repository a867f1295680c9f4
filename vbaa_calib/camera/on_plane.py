"""Pixels to metres on a plane that the camera sees: the metric layer, as a torch module. Loads torch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from vbaa_calib.core.arrays import ArrayT, as_tensor, is_tensor, like, masked, working
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import PLANE_C, Plane, Pose

from .camera import Camera
from .models import MODELS
from .plane import Crossing, cross, in_plane_axes
from .projection import Intrinsics, pixel_to_ray, ray_derivatives

_POSE_NAMES = ("rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z")
"""Small motion of the camera, as `Pose.retract` takes it: rotation vector in rad, translation in m, antenna frame."""


class CameraOnPlane(torch.nn.Module):
    """Where the rays of pixels meet a plane, in metres.

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
            raise InputError(f"the plane's normal has the length {length:g}", remedy="give a finite plane, normal of 1")
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
        """What `calibration_jacobian` differentiates by: the camera's parameters, then the pose's."""
        return self.camera.parameter_names + _POSE_NAMES

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
        return self._jacobian(pixels, by_parameter=False)

    def calibration_jacobian(self, pixels: ArrayT) -> ArrayT:
        """d(coordinates on the plane)/d(parameters), (..., 2, P), in `parameter_names` order. NaN where not valid.

        With the joint covariance Σ of the parameters, J Σ Jᵀ is the covariance of all points with one another.
        """
        return self._jacobian(pixels, by_parameter=True)

    def covariance(self, pixels: ArrayT, sigma_px: float | ArrayT) -> ArrayT:
        """Covariance (..., 2, 2) m² on the plane from independent pixel noise of sigma_px, a number or (...)."""
        jacobian = self.pixel_jacobian(pixels)
        sigma = like(jacobian, sigma_px)[..., None, None]
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

    def _crossing(self, rays: torch.Tensor) -> tuple[torch.Tensor, Crossing]:
        directions = rays @ self.rotation.to(rays).T
        return directions, cross(self.translation_m.to(rays), directions, self.normal.to(rays), self.offset_m.to(rays))

    def _answer(self, pixels: ArrayT, wanted: Callable[[Crossing], torch.Tensor]) -> tuple[ArrayT, ArrayT]:
        work = working(pixels, 2, "pixels")
        values = as_tensor(work.values)
        K, c = self.matrix.to(values), self.distortion.to(values)
        intrinsics = Intrinsics(MODELS[self.camera.model], K[0, 0], K[1, 1], K[0, 2], K[1, 2], c)
        rays, seen = pixel_to_ray(intrinsics, values)
        _, crossing = self._crossing(rays)
        valid = seen & crossing.valid
        result = masked(wanted(crossing), valid)
        if is_tensor(pixels):
            return work.restore(result), valid
        return work.restore(result.detach().numpy()), valid.numpy()

    def _jacobian(self, pixels: ArrayT, by_parameter: bool) -> ArrayT:
        work = working(pixels, 2, "pixels")
        with torch.no_grad():
            jacobian = self._sliding(as_tensor(work.values), by_parameter)
        return work.restore(jacobian if is_tensor(pixels) else jacobian.numpy())

    def _sliding(self, pixels: torch.Tensor, by_parameter: bool) -> torch.Tensor:
        """How a point slides on the plane while its ray turns and its origin moves."""
        (fx, _, cx), (_, fy, cy), _ = self.matrix.tolist()
        intrinsics = Intrinsics(MODELS[self.camera.model], fx, fy, cx, cy, tuple(self.distortion.tolist()))
        rays, by_pixel, by_lens, valid = ray_derivatives(intrinsics, pixels)
        directions, crossing = self._crossing(rays)
        # the origin moved by a step moves the point by (1 − m nᵀ/(n·m)) times it; the direction moved, by t times that
        identity, normal = torch.eye(3).to(pixels), self.normal.to(pixels)
        slide = identity - directions[..., :, None] * normal / crossing.slant[..., None, None]
        by_origin = self.axes.to(pixels) @ slide
        by_direction = by_origin * crossing.range_m[..., None, None]
        turned = by_direction @ self.rotation.to(pixels)
        if not by_parameter:
            return masked(turned @ by_pixel, valid & crossing.valid)
        by_rotation = torch.linalg.cross(directions[..., None, :], by_direction, dim=-1)
        whole = torch.cat([turned @ by_lens, by_rotation, by_origin], -1)
        return masked(whole, valid & crossing.valid)
