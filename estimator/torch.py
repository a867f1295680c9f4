"""Contacts as a differentiable layer of torch: from centrelines to distance, force and contact point. Loads torch."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from estimator.contact.estimate import ContactEstimator
from estimator.table.contacts import LOCATED
from vbaa_calib.core.errors import InputError


class ContactTensors(NamedTuple):
    """Contacts of B frames: distance_m (B,), force_N (B, 3) antenna frame, point_world_m (B, 3), located (B,) bool.

    Numbers that the data do not support are NaN; no gradient flows through them.
    """

    distance_m: Tensor
    force_N: Tensor
    point_world_m: Tensor
    located: Tensor


class _EstimatedContacts(torch.autograd.Function):
    """(B, 7) distance, force and world point of frames, differentiable by `Contacts.jacobian`."""

    @staticmethod
    def forward(
        ctx: Any, estimator: ContactEstimator, sigma_px: Any, pixels: Tensor, moments: Tensor, joints: Tensor
    ) -> Tensor:
        """Contacts by the estimator, on the processor."""
        lines, read, angles = (each.detach().cpu().double().numpy() for each in (pixels, moments, joints))
        found = estimator.estimate_batch(
            lines,
            read[:, 0],
            angles[:, 0],
            angles[:, 1],
            sigma_px=sigma_px,
            moments_z=read[:, 1],
            jacobian=any(ctx.needs_input_grad),
        )
        if found.jacobian is not None:
            slopes = (found.jacobian.by_pixels, found.jacobian.by_readings[..., :2], found.jacobian.by_joints)
            ctx.save_for_backward(*(pixels.new_tensor(np.nan_to_num(each)) for each in slopes))
        located = np.isin(found.status, LOCATED)
        values = np.column_stack([found.distance_m, found.force_N, found.point_world_m])
        return pixels.new_tensor(np.where(located[:, None], values, np.nan))

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients by pixels, moments and joints."""
        by_pixels, by_readings, by_joints = ctx.saved_tensors
        gradient = torch.nan_to_num(gradient)
        return (
            None,
            None,
            torch.einsum("br,brnj->bnj", gradient, by_pixels),
            torch.einsum("br,brj->bj", gradient, by_readings),
            torch.einsum("br,brj->bj", gradient, by_joints),
        )


class ContactLayer(torch.nn.Module):
    """Contacts of centrelines, differentiable by pixels or metric points, moments and joint angles.

    The estimator works in float64 on the processor, whatever the tensors' device and type. Gradients are those of
    `Contact.jacobian`: by the implicit function theorem at the fit, 0 for points that the robust loss takes for gross
    errors.

    Parameters
    ----------
    estimator : of the rig. Its parameters are no parameters of the layer; `Contacts.jacobian.by_rig` has the
        derivatives by them.
    """

    def __init__(self, estimator: ContactEstimator) -> None:
        super().__init__()
        if not isinstance(estimator, ContactEstimator):
            raise InputError("estimator is no ContactEstimator", remedy="give ContactEstimator(rig)")
        self.estimator = estimator

    def forward(
        self,
        pixels: Tensor | None = None,
        moment: Tensor | None = None,
        joints: Tensor | None = None,
        *,
        plane_xy_m: Tensor | None = None,
        sigma_px: float | None = None,
    ) -> ContactTensors:
        """Contacts of B frames.

        Parameters
        ----------
        pixels : (B, N, 2) on the centreline; rows with NaN are missing, so that shorter lines can be filled up.
        moment : (B,) N·m, or (B, 2) with that about z; None or NaN: by the picture alone.
        joints : (B, 2) pan and tilt, rad; None: 0.
        plane_xy_m : in place of pixels, (B, N, 2) m on plane C, as `rig.camera_on_plane()` gives them.
        sigma_px : standard deviation of the points across the antenna; by default their own scatter, and no less than
            the rig's pictures showed.

        Raises
        ------
        InputError : other shapes, both or neither of pixels and plane_xy_m, or what `ContactEstimator.estimate_batch`
            refuses.
        """
        if (pixels is None) == (plane_xy_m is None):
            raise InputError("exactly one of pixels and plane_xy_m is needed")
        lines = pixels if pixels is not None else plane_xy_m
        if not isinstance(lines, Tensor) or lines.ndim != 3 or lines.shape[-1] != 2 or not lines.is_floating_point():
            raise InputError(
                "the centrelines are no tensor (B, N, 2) of floats", remedy="fill shorter ones up with NaN"
            )
        if pixels is None:
            pixels = self._pixels(lines)
        count = len(pixels)
        read = pixels.new_full((count, 2), torch.nan)
        if moment is not None:
            columns = moment.reshape(count, -1) if isinstance(moment, Tensor) and moment.numel() else read[:, :0]
            if columns.shape[1] not in (1, 2):
                raise InputError("moment is no tensor (B,) or (B, 2)", remedy="give N·m, NaN where there is no reading")
            read = torch.cat([columns.to(pixels), read[:, columns.shape[1] :]], dim=1)
        angles = pixels.new_zeros((count, 2)) if joints is None else joints
        if not isinstance(angles, Tensor) or angles.shape != (count, 2):
            raise InputError("joints are no tensor (B, 2)", remedy="give pan and tilt, rad")
        found: Tensor = _EstimatedContacts.apply(self.estimator, sigma_px, pixels, read, angles.to(pixels))
        return ContactTensors(found[:, 0], found[:, 1:4], found[:, 4:], torch.isfinite(found[:, 0]))

    def _pixels(self, plane_xy_m: Tensor) -> Tensor:
        """The pixels (B, N, 2) of points (B, N, 2) on plane C, with gradients; NaN stays NaN."""
        rig = self.estimator.rig
        pose = rig.T_antenna_camera.inverse()
        missing = ~torch.isfinite(plane_xy_m).all(-1, keepdim=True)
        xy = torch.where(missing, 0.0, plane_xy_m)
        rotation, shift = (plane_xy_m.new_tensor(each) for each in (pose.rotation, pose.translation_m))
        seen, valid = rig.camera.project(xy @ rotation[:, :2].T + shift)
        return torch.where(missing | ~valid[..., None], torch.nan, seen)
