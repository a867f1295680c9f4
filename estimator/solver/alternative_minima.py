"""Other contacts that explain the same frame: searched, compared, and remembered."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.compiled import compiled

from .convergence import converge
from .fit import CONVERGED, copy_fit
from .linear_algebra import put
from .normal_equations import unscaled_cost
from .rig_arrays import tip_deflection

_SAME_DISTANCE, _SAME_FORCE = 1e-2, 0.05
"""Contacts closer than this, in antenna lengths and in parts of the force, are taken for the same."""
_MIRRORED = (-2.0, -1.0)
"""Parts of the force along the line of sight that lead to the mirror image, and to the least force."""
_LARGE_DEFLECTIONS = (0.1, 0.3, -0.1, -0.3)
"""Deflections of the tip along the line of sight, in antenna lengths, from which other contacts are searched."""
_DISTINGUISHABLE = 5.0
"""Moments that differ by fewer deviations do not distinguish a contact from its mirror image."""


@compiled
def try_start(rig, frame, rung, start, best, other, other_cost, work):
    """Fit a frame from another start (4,): the better fit is kept, the next best remembered if it is different.

    best : the fit so far, replaced by a better one. other : (4,) unknowns of the next best, other_cost : (1,).
    """
    found = work.found
    put(start, found.unknowns)
    converge(rig, frame, rung, found, work, False)
    own, cost = unscaled_cost(rig, best), unscaled_cost(rig, found)
    mine, theirs = best.numbers[CONVERGED] > 0.0, found.numbers[CONVERGED] > 0.0
    better = theirs and (cost < own or not mine)
    loser = own if better else cost
    if mine and theirs and different(best.unknowns, found.unknowns) and loser < other_cost[0]:
        other_cost[0] = loser
        other[:] = best.unknowns if better else found.unknowns
    if better:
        copy_fit(found, best)


@compiled
def different(first, second):
    """Whether unknowns (4,) are those of different contacts."""
    gap = np.hypot(first[1] - second[1], first[2] - second[2])
    return abs(first[0] - second[0]) > _SAME_DISTANCE or gap > _SAME_FORCE * np.hypot(first[1], first[2])


@compiled
def mirror_ambiguous(rig, frame, fit):
    """Whether the moments do not distinguish the contact from its mirror image.

    The mirror is the plane through the antenna's x axis across the line of sight: small deflections before and behind
    it look alike, but for perspective.
    """
    along = fit.unknowns[1] * rig.to_camera[0] + fit.unknowns[2] * rig.to_camera[1]
    for about in range(2):
        # the sensor about y responds to f_z, the one about z to f_y
        response = rig.force_unit_N * rig.length_m * fit.unknowns[0] * rig.gain[about] / rig.std[about]
        variance = 1.0  # noise and calibration
        for k in range(len(fit.steps)):
            variance += fit.reading_columns[about, 4 + k] ** 2
        change = abs(2.0 * response * along * rig.to_camera[1 - about]) * frame.available[about] / np.sqrt(variance)
        if not change < _DISTINGUISHABLE:
            return False
    return True


@compiled
def try_mirrors(rig, frame, rung, unknowns, best, other, other_cost, work):
    """Fit from contacts that may look like these unknowns (4,): the mirror image, the least force that the picture asks
    for, and forces that bend the antenna far before and behind the mirror."""
    along = unknowns[1] * rig.to_camera[0] + unknowns[2] * rig.to_camera[1]
    sway = tip_deflection(rig, unknowns[0])
    start = unknowns.copy()
    for part in _MIRRORED:
        for axis in range(2):
            start[1 + axis] = unknowns[1 + axis] + part * along * rig.to_camera[axis]
        try_start(rig, frame, rung, start, best, other, other_cost, work)
    for large in _LARGE_DEFLECTIONS:
        for axis in range(2):
            start[1 + axis] = unknowns[1 + axis] + (large / sway - along) * rig.to_camera[axis]
        try_start(rig, frame, rung, start, best, other, other_cost, work)
