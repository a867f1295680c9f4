"""The status of a frame and its reason: which numbers of its fit the data support."""

from __future__ import annotations

import numpy as np

from estimator.solver.numbers import FitNumbers
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.robust import chi_square_p
from vbaa_calib.native import core

from .settings import ContactSettings

NO_ANTENNA = "no_antenna"  # too few points
NO_CONTACT = "no_contact"  # the free shape explains the frame
UNOBSERVABLE = "unobservable"  # picture and reading leave the contact open
LOW = "low_signal"  # the distance is too uncertain
FAILED = "failed"  # no contact explains the frame
TIP = "tip_contact"  # the contact is at the tip
OK = "ok"  # all numbers can be used


def statuses(numbers: FitNumbers) -> np.ndarray:
    """(B,) statuses: the first that applies, from those that make everything else meaningless down to ok."""
    with np.errstate(invalid="ignore"):
        uncertain = ~(
            numbers.std[:, 0]
            < np.minimum(ContactSettings.low_signal, ContactSettings.low_signal_relative * numbers.unknowns[:, 0])
        )
        edge_on, mirrored = numbers.edge_on_rad < ContactSettings.edge_on_rad, _mirrored(numbers)
        determined = np.isfinite(numbers.std[:, 0])
        # a fit that stopped somewhere says nothing about whether there is a contact
        stopped = ~numbers.converged & (numbers.scatter > core.solver.WRONG_SHAPE)
        order = [
            (numbers.points < ContactSettings.fewest_points, NO_ANTENNA),
            (~numbers.finite | np.isfinite(numbers.left_px), FAILED),
            (~(numbers.evidence >= ContactSettings.contact_evidence) & ~stopped, NO_CONTACT),
            (edge_on & (uncertain | ~numbers.converged), UNOBSERVABLE),
            (mirrored & (numbers.edge_on_rad < ContactSettings.edge_on_blind_rad), UNOBSERVABLE),
            (unexplained(numbers) | _model_too_low(numbers), FAILED),
            (uncertain & determined, LOW),
            (uncertain | _force_undetermined(numbers) | _ambiguous(numbers), UNOBSERVABLE),
            (_disagreement(numbers) > ContactSettings.contradiction, FAILED),
            (numbers.at_tip, TIP),
        ]
    order.append((np.ones(len(numbers), bool), OK))
    return np.array([status for _, status in order])[np.argmax([which for which, _ in order], axis=0)]


def unexplained(numbers: FitNumbers) -> np.ndarray:
    """(B,) mask of the frames that no single possible contact explains."""
    wrong = ~numbers.converged | (numbers.scatter > core.solver.WRONG_SHAPE)
    # without a reading a steep bend along the line of sight fits almost anything, if not quite
    steep = np.abs(numbers.unknowns[:, 3]) > ContactSettings.steepest_blind
    wrong |= _mirrored(numbers) & ((numbers.scatter > 1.0) | steep)
    return wrong | _at_clamp(numbers) | _friction_exceeded(numbers) | _second_contact(numbers)


def _ambiguous(numbers: FitNumbers) -> np.ndarray:
    """(B,) mask of the frames that another contact, farther away than the uncertainty, explains about equally well."""
    as_good = numbers.alternative_cost < ContactSettings.alternative_cost * numbers.scatter**2
    if not as_good.any():
        return as_good
    apart = np.abs(numbers.alternative_unknowns - numbers.unknowns)[:, :3] > 3.0 * numbers.std[:, :3]
    return apart.any(axis=1) & as_good


def _mirrored(numbers: FitNumbers) -> np.ndarray:
    """(B,) mask of the frames without a moment in which only perspective distinguishes the contact from its mirror
    image."""
    return numbers.ambiguous & (numbers.marginal | ~numbers.sensor_available.any(axis=1))


def _at_clamp(numbers: FitNumbers) -> np.ndarray:
    """(B,) mask of the contacts at the smallest distance of the search."""
    least = numbers.unknowns[:, 0] - np.where(numbers.marginal, numbers.std[:, 0], 0.0)
    return least <= core.solver.NEAREST * (1.0 + 1e-6)


def _friction_exceeded(numbers: FitNumbers) -> np.ndarray:
    return np.abs(numbers.unknowns[:, 3]) > ContactSettings.steepest


def _second_contact(numbers: FitNumbers) -> np.ndarray:
    """(B,) mask of the frames that a second force explains so much better that the distance is not trusted."""
    return (numbers.second_gain > ContactSettings.second_contact) & (
        numbers.second_shift > ContactSettings.second_shift
    )


def _force_undetermined(numbers: FitNumbers) -> np.ndarray:
    """(B,) mask of the frames in which the force, and with it the contact point, is undetermined in some direction
    across the antenna, which affects the rest."""
    std = np.max(numbers.std[:, 1:3], axis=1)
    return ~(0.01 * numbers.unknowns[:, 0] ** 3 * std < ContactSettings.low_signal) & ~numbers.marginal


def _model_too_low(numbers: FitNumbers) -> np.ndarray:
    """(B,) mask of the frames in which the requested model's bias exceeds what its standard deviations can include."""
    bias = numbers.bias[np.arange(len(numbers)), numbers.rung]
    return np.isfinite(bias) & (bias > ContactSettings.highest_bias)


def _disagreement(numbers: FitNumbers) -> np.ndarray:
    """(B,) largest residual of a reading, in its expected standard deviations."""
    return np.max(np.abs(numbers.residual) / numbers.residual_std, axis=1)


def reason(several: FitNumbers, index: int, status: str, length_m: float, requested: str) -> str:
    """The reason of one frame: why it is not ok, or which model was used and why, and further remarks. status : ""
    for a frame that is ok and ordinary."""
    if not status:
        return _model(int(several.rung[index]), several.bias[index].tolist(), requested)
    numbers = several.row(index)
    if status == NO_ANTENNA:
        return f"only {numbers.points[0]} usable centreline points"
    if status == NO_CONTACT:
        return "the antenna has its free shape within its uncertainty"
    if status == FAILED:
        return _failed(numbers, length_m)
    if status == UNOBSERVABLE:
        return _unobservable(numbers, length_m)
    if status == LOW:
        return f"the contact distance is known only to {1e3 * numbers.std[0, 0] * length_m:.1f} mm"
    reasons = [_model(int(numbers.rung[0]), numbers.bias[0].tolist(), requested)]
    if status == TIP:
        reasons.insert(0, "the contact is indistinguishable from the tip: its distance is the antenna's length")
    return "; ".join(reasons + _remarks(numbers))


def _failed(numbers: FitNumbers, length_m: float) -> str:
    why = _misfit(numbers, length_m)
    if not (unexplained(numbers)[0] and numbers.explained_drifted[0]):
        return why
    return (
        f"it fits if the rig has changed since its calibration (the picture by about {numbers.drift_px[0]:.2g} px, the "
        f"reading by {numbers.drift_readings[0]:.1g} std): show the free antenna first, or check the rig; if not, {why}"
    )


def _misfit(numbers: FitNumbers, length_m: float) -> str:
    scatter, friction = numbers.scatter[0], abs(numbers.unknowns[0, 3])
    if not numbers.finite[0]:
        return "the fit left the domain of the model"
    if np.isfinite(numbers.left_px[0]):
        far = f"wherever it is touched, many of them lie {numbers.left_px[0]:.0f} px off or more"
        return f"the points are not on this antenna, or it is bent too far: {far}"
    if _model_too_low(numbers)[0] and not unexplained(numbers)[0]:
        rung = int(numbers.rung[0])
        return f"{RUNGS[rung]} is too low for this frame, some {numbers.bias[0, rung]:.0f} std off: take a higher rung"
    two = ""
    if _second_contact(numbers)[0]:
        near, far = (1e3 * length_m * at for at in sorted((numbers.unknowns[0, 0], numbers.second_place[0])))
        two = f"two contacts explain it better, near {near:.0f} and {far:.0f} mm, or the rig is off"
    if unexplained(numbers)[0] and numbers.explained_alone[0]:
        why = "picture and moment contradict each other: without the reading all is well, so check the sensor"
        return f"{why}; or {two}" if two else why
    if two:
        return f"the shape is not that of one contact: {two}"
    if _at_clamp(numbers)[0]:
        nearest_mm = 1e3 * core.solver.NEAREST * length_m
        return f"the contact lies nearer to the clamp than {nearest_mm:.0f} mm, where none is looked for"
    if _friction_exceeded(numbers)[0]:
        return f"the force needs a friction angle of {friction:.1f} standard deviations: give a larger --friction"
    if scatter > core.solver.WRONG_SHAPE or (scatter > 1.0 and _mirrored(numbers)[0]):
        far = f"points lie {scatter:.1f} std off or more"
        return f"the shape is not that of one contact: {far}, or their std is stated too small"
    if not numbers.converged[0]:
        most = core.solver.MOST_EVALUATIONS
        in_most = f" in {most} evaluations of the model" if numbers.evaluations[0] >= most else ""
        return f"the fit did not converge{in_most}"
    return f"picture and moment contradict each other by {_disagreement(numbers)[0]:.0f} std: check the sensor"


def _unobservable(numbers: FitNumbers, length_m: float) -> str:
    if numbers.edge_on_rad[0] < (
        ContactSettings.edge_on_blind_rad if _mirrored(numbers)[0] else ContactSettings.edge_on_rad
    ):
        return f"the camera sees the deformation plane edge-on, {np.degrees(numbers.edge_on_rad[0]):.1f}° off"
    if not np.isfinite(numbers.std[0, 0]):
        return "nothing in picture and moment holds the contact distance"
    if _force_undetermined(numbers)[0]:
        return "nothing in picture and moment holds the force in one direction across the antenna"
    near, far = (1e3 * length_m * u[0, 0] for u in (numbers.unknowns, numbers.alternative_unknowns))
    rolls = (np.degrees(np.arctan2(u[0, 2], u[0, 1])) for u in (numbers.unknowns, numbers.alternative_unknowns))
    here, there = (f"at {d:.0f} mm pushed towards {r:.0f}°" for d, r in zip((near, far), rolls, strict=True))
    return f"two contacts explain it about equally well: {here}, and {there} from y"


def _model(rung: int, bias: list[float], requested: str) -> str:
    """The rung that was used and the reason, in words."""
    name = RUNGS[rung]
    if requested != "auto":
        too_low = (
            f", and is {bias[rung]:.1f} std off, which is in the deviations"
            if bias[rung] > core.solver.SMALL_BIAS
            else ""
        )
        return f"{name} was asked for{too_low}"
    low = [lower for lower in range(rung) if bias[lower] > core.solver.SMALL_BIAS]
    if not low:
        return f"{name}: its bias is {bias[rung]:.2f} std"
    return f"{name}: {RUNGS[low[-1]]} would be {bias[low[-1]]:.1f} std off"


def _undetermined(numbers: FitNumbers) -> list[str]:
    """The components of the force that are undetermined, and what follows, in words."""
    known = numbers.force_determined[0]
    if known.all():
        return []
    missing = " and ".join(name for name, there in zip(("f_y", "f_z"), known, strict=True) if not there)
    variances, axes = np.linalg.eigh(numbers.covariance[0, 4:, 4:])
    seen, std = float(axes[:, 0] @ numbers.force_N[0, 1:]), float(np.sqrt(max(variances[0], 0.0)))
    angle = np.degrees(np.arctan2(*(np.sign(seen) * axes[::-1, 0])))
    return [
        f"{missing} not determined: only perspective shows the force along the line of sight; across it, "
        f"{angle:.0f}° from y, it is {1e3 * abs(seen):.3g} ± {1e3 * std:.2g} mN"
    ]


def _remarks(numbers: FitNumbers) -> list[str]:
    remarks = _undetermined(numbers)
    if numbers.scatter[0] > 1.0:
        remarks.append(f"the points scatter {numbers.scatter[0]:.1f} times more than they should")
    rig = float(numbers.rig_chi_square[0])
    if chi_square_p(rig, max(int(numbers.rig_axes[0]), 1)) < ContactSettings.rig_p_value:
        remarks.append(f"the rig's parameters had to move by {np.sqrt(rig):.0f} std to fit: check the rig")
    if abs(numbers.tip_std[0]) > ContactSettings.disagreement:
        remarks.append(f"the antenna's visible end lies {abs(numbers.tip_std[0]):.0f} std off, and is not used")
    if numbers.friction_share[0] > ContactSettings.friction_share:
        worse = 1.0 / np.sqrt(max(1.0 - float(numbers.friction_share[0]), 1e-2))
        remarks.append(f"unknown friction makes the distance {worse:.0f} times less certain (--friction)")
    if _disagreement(numbers)[0] > ContactSettings.disagreement:
        remarks.append(f"picture and moment disagree by {_disagreement(numbers)[0]:.0f} std")
    return remarks
