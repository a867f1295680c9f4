"""Derivatives of contacts by what was measured and by the rig."""

from __future__ import annotations

import numpy as np

from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import Jacobian
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.native import core

from .inputs import Batch


def jacobian(batch: Batch, rig_arrays: RigArrays, rung: str, fitted: FitNumbers, located: np.ndarray) -> Jacobian:
    """Derivatives of the contacts (B,) that were fitted to a batch; `located` says which there are."""
    frames, rig = batch.frames(rig_arrays), rig_arrays.rig
    known = located & ~fitted.marginal
    at = np.where(known[:, None], fitted.unknowns, [0.5, 0.0, 0.0, 0.0])
    scatter = np.where(known, fitted.scatter, 1.0)
    by_points, by_readings, by_gravity, by_rig = core.solver.gradients(
        rig_arrays.core, frames, RUNGS.index(rung), at, scatter, fitted.at_tip & known
    )
    rotation, _ = rig.kinematics.world_antenna(batch.pan_rad, batch.tilt_rad)
    turned, shifted = rig.kinematics.by_joints(batch.pan_rad, batch.tilt_rad)  # (2, B, 3, 3), (2, B, 3)

    def in_world(by: np.ndarray) -> np.ndarray:
        """(B, 7, ...) with the point's rows in the world and behind the force's."""
        point = np.einsum("bij,bj...->bi...", rotation, by[:, 1:4])
        whole: np.ndarray = np.where(
            known.reshape(-1, *[1] * (by.ndim - 1)), np.concatenate([by[:, :1], by[:, 4:], point], axis=1), np.nan
        )
        return whole

    slopes = batch.slopes(rig)
    by_pixels = in_world(np.einsum("brni,bnij->brnj", by_points, np.nan_to_num(slopes)))
    if batch.order is not None:
        listed = np.empty_like(by_pixels)
        np.put_along_axis(listed, batch.order[:, None, :, None], by_pixels, 2)
        by_pixels = listed
    gravity = np.einsum("kbji,j->bik", turned, rig.gravity_world_m_s2)
    by_joints = in_world(by_gravity @ gravity)
    by_joints[:, 4:] += np.einsum("kbij,bj->bik", turned, fitted.point_m) + np.moveaxis(shifted, 0, -1)
    names = len(rig.parameter_names)
    by_readings = in_world(by_readings)[..., rig_arrays.sensors]
    return Jacobian(by_pixels, by_readings, by_joints, in_world(by_rig)[..., :names])
