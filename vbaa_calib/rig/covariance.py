"""The joint covariance out of rig.json, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from .parameters import RIG_PARAMETERS


def joint_covariance(joint: Mapping[str, Any], lens: tuple[str, ...], where: object) -> np.ndarray:
    """(17, 17), or (17 + P, 17 + P) with the P parameters of the lens, from the mapping `joint`.

    Raises InputError for other parameters, another shape, or a matrix that is no covariance.
    """
    rows, names = joint["covariance"], tuple(joint["parameters"])
    if names not in (RIG_PARAMETERS, RIG_PARAMETERS + lens) or {len(rows), *map(len, rows)} != {len(names)}:
        raise InputError(
            f"joint must give the covariance of {', '.join(RIG_PARAMETERS)}, and then of the lens ({', '.join(lens)})",
            where=where,
            remedy="run vbaa calibrate again",
        )
    covariance = np.array(rows, float)
    if not _is_covariance(covariance):
        raise InputError("joint.covariance is not a covariance", where=where, remedy="run vbaa calibrate again")
    return covariance


def _is_covariance(matrix: np.ndarray) -> bool:
    """Symmetric and positive semidefinite, whatever the units of its rows."""
    variance = np.diag(matrix)
    if (variance < 0).any():
        return False
    deviation = np.sqrt(np.where(variance > 0, variance, 1.0))
    with np.errstate(over="ignore"):
        correlation = matrix / deviation / deviation[:, None]
    if np.abs(correlation).max() > 1 + 1e-6 or np.abs(correlation - correlation.T).max() > 1e-6:
        return False
    return bool(np.linalg.eigvalsh(correlation).min() > -1e-6)
