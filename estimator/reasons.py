"""Why a frame has its status, and its model, in words."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from vbaa_calib.antenna.rungs import RUNGS

from .quantities import Numbers
from .solve.descend import NEAREST
from .solve.ladder import SMALL
from .verdict import (
    DISAGREEMENT,
    EDGE_ON_BLIND_RAD,
    EDGE_ON_RAD,
    FAILED,
    LOW,
    NO_ANTENNA,
    NO_CONTACT,
    STRANGE_RIG,
    TIP,
    UNOBSERVABLE,
    WRONG_SHAPE,
    at_clamp,
    blindly,
    contradicted,
    contradiction,
    doubled,
    leaning,
    loose,
    misled,
    unexplained,
)


def reason(numbers: Numbers, index: int, status: str, length_m: float, asked: str) -> str:
    """One frame's: why it is not ok, which model was taken and why, and what else was noticed."""
    if status == NO_ANTENNA:
        return f"only {numbers.points[index]} usable centreline points"
    if status == NO_CONTACT:
        return "the antenna has its free shape within its uncertainty"
    if status == FAILED:
        return _failed(numbers, index, length_m)
    if status == UNOBSERVABLE:
        return _unobservable(numbers, index, length_m)
    if status == LOW:
        return f"the contact distance is known only to {1e3 * numbers.std[index, 0] * length_m:.1f} mm"
    reasons = [_model(numbers, index, asked)]
    if status == TIP:
        reasons.insert(0, "the contact cannot be told from the tip: its distance is the antenna's length")
    return "; ".join(reasons + _noticed(numbers, index))


def _failed(numbers: Numbers, index: int, length_m: float) -> str:
    scatter, lean = numbers.scatter[index], abs(numbers.unknowns[index, 3])
    if not numbers.finite[index]:
        return "the fit left the domain of the model"
    if misled(numbers)[index] and not unexplained(numbers)[index]:
        rung = int(numbers.rung[index])
        return (
            f"{RUNGS[rung]} is too low for this frame, some {numbers.bias[index, rung]:.0f} std off: take a higher rung"
        )
    two = ""
    if doubled(numbers)[index]:
        places = sorted((numbers.unknowns[index, 0], numbers.second_place[index]))
        near, far = (1e3 * length_m * place for place in places)
        two = f"two contacts explain it better, near {near:.0f} and {far:.0f} mm, or the rig is off"
    if contradicted(numbers)[index]:
        why = "picture and moment contradict each other: without the reading all is well, so check the sensor"
        return f"{why}; or {two}" if two else why
    if two:
        return f"the shape is not that of one contact: {two}"
    if at_clamp(numbers)[index]:
        return f"the contact lies nearer to the clamp than {1e3 * NEAREST * length_m:.0f} mm, where none is looked for"
    if leaning(numbers)[index]:
        return f"the force would have to lean {lean:.1f} times as far from the normal as friction is thought to tilt it"
    if scatter > WRONG_SHAPE or (scatter > 1.0 and blindly(numbers)[index]):
        return f"the shape is not that of one contact: points lie {scatter:.1f} std off or more"
    if not numbers.converged[index]:
        return "the fit did not converge"
    return f"picture and moment contradict each other by {contradiction(numbers)[index]:.0f} std: check the sensor"


def _unobservable(numbers: Numbers, index: int, length_m: float) -> str:
    if numbers.edge_on_rad[index] < (EDGE_ON_BLIND_RAD if blindly(numbers)[index] else EDGE_ON_RAD):
        return f"the camera sees the deformation plane edge-on, {np.degrees(numbers.edge_on_rad[index]):.1f}° off"
    if not np.isfinite(numbers.std[index, 0]):
        return "nothing in picture and moment holds the contact distance"
    if loose(numbers)[index]:
        return "nothing in picture and moment holds the force in one direction across the antenna"
    near, far = (1e3 * length_m * u[index, 0] for u in (numbers.unknowns, numbers.rival_unknowns))
    rolls = (np.degrees(np.arctan2(u[index, 2], u[index, 1])) for u in (numbers.unknowns, numbers.rival_unknowns))
    here, there = (f"at {d:.0f} mm pushed towards {r:.0f}°" for d, r in zip((near, far), rolls, strict=True))
    return f"two contacts explain it about equally well: {here}, and {there} from y"


def _model(numbers: Numbers, index: int, asked: str) -> str:
    """Which rung was taken, and why."""
    rung, bias = int(numbers.rung[index]), numbers.bias[index]
    name = RUNGS[rung]
    if asked != "auto":
        too_low = f", and is {bias[rung]:.1f} std off, which is in the deviations" if bias[rung] > SMALL else ""
        return f"{name} was asked for{too_low}"
    low = [index for index in range(rung) if bias[index] > SMALL]
    if not low:
        return f"{name}: its bias is {bias[rung]:.2f} std"
    return f"{name}: {RUNGS[low[-1]]} would be {bias[low[-1]]:.1f} std off"


def _noticed(numbers: Numbers, index: int) -> list[str]:
    noticed = []
    if numbers.scatter[index] > 1.0:
        noticed.append(f"the points scatter {numbers.scatter[index]:.1f} times more than they should")
    strange = float(numbers.strange[index])
    if chi2.sf(strange, max(int(numbers.rig_axes[index]), 1)) < STRANGE_RIG:
        noticed.append(f"the rig's parameters had to move by {np.sqrt(strange):.0f} std to fit: check the rig")
    if contradiction(numbers)[index] > DISAGREEMENT:
        noticed.append(f"picture and moment disagree by {contradiction(numbers)[index]:.0f} std")
    return noticed
