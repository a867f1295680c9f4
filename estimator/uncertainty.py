"""What a fit is worth: noise and the rig's joint covariance in the contact, and the test for contact itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.reprojection import robust_weights

from .fit import FREE, Fit, evaluated, least_cost
from .scene import by_rig

LEAST_REDUNDANCY = 0.005
"""A moment whose misfit may be only this part of its own deviation was fitted, not tested: it contradicts nothing."""


@dataclass(frozen=True, eq=False)
class Spread:
    """First-order uncertainty of a fit.

    Attributes
    ----------
    joint : (3 + R, 3 + R) covariance of unknowns and rig steps; infinite where the data do not hold an unknown.
    moment_std : standard deviation of the moment's whitened residual, which is below one as far as the moment itself
        was fitted; at least `LEAST_REDUNDANCY`.
    """

    joint: np.ndarray
    moment_std: float

    @property
    def covariance(self) -> np.ndarray:
        """(3, 3) of the unknowns, from noise and rig together."""
        return self.joint[:3, :3]


def spread(result: Fit) -> Spread:
    """Invert a fit's information.

    A distance held at the tip gets the deviation that it would have if it were free: the data allow it that far inside.
    """
    jacobian = result.jacobian * robust_weights(result.residuals)[:, None]
    information = jacobian.T @ jacobian + np.diag(result.prior)
    scale = np.sqrt(np.diag(information))
    nothing = Spread(np.full(information.shape, np.inf), 1.0)
    if not np.isfinite(scale).all() or (scale == 0).any():
        return nothing
    unit = information / np.outer(scale, scale)
    if np.linalg.cond(unit) > 1e14:
        return nothing
    joint = np.linalg.inv(unit) / np.outer(scale, scale)
    fitted = float(jacobian[-1] @ joint @ jacobian[-1])
    return Spread(joint, float(np.sqrt(max(1.0 - fitted, LEAST_REDUNDANCY**2))))


def evidence(result: Fit) -> float:
    """How much better a contact explains the frame than the free antenna: half the difference of the squared misfits.

    Both may bend the rig's parameters within their joint covariance first, so that a clamp angle that is known badly is
    not taken for a contact. Without contact it is 1.5 to 2 (three unknowns fitted to noise). The result must be of the
    highest rung (`fit.evaluated`): what a lower one leaves out of the weight must not pass for a force.
    """
    free = evaluated(replace(result.scene, rig_table=by_rig(result.scene, FREE)), FREE)
    as_calibrated = result.residuals - result.jacobian[:, 3:] @ result.rig_steps
    _, without = least_cost(free.residuals, free.jacobian[:, 3:], free.prior[3:])
    _, touching = least_cost(as_calibrated, result.jacobian, result.prior)
    return without - touching
