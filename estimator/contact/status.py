"""The status of a frame and its reason: which numbers of its fit the data support."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from estimator.solver.numbers import FitNumbers
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.robust import chi_limit
from vbaa_calib.native import core

from .settings import ContactSettings

NO_ANTENNA = "no_antenna"  # too few points
NO_CONTACT = "no_contact"  # the free shape explains the frame
UNOBSERVABLE = "unobservable"  # picture and reading leave the contact open
LOW = "low_signal"  # the distance is too uncertain
FAILED = "failed"  # no contact explains the frame
TIP = "tip_contact"  # the contact is at the tip
OK = "ok"  # all numbers can be used


@lru_cache
def limits() -> tuple[Any, np.ndarray]:
    """The thresholds of a frame's status in the core's form, and the statuses in the order of its `report.hpp`: the
    first that applies, from those that make everything else meaningless down to ok."""
    names = [NO_ANTENNA, FAILED, NO_CONTACT, UNOBSERVABLE, LOW, TIP, OK]
    return core.solver.Limits(ContactSettings), np.array(names)


def unexplained(numbers: FitNumbers, bits: int = core.solver.UNEXPLAINED) -> np.ndarray:
    """(B,) mask of the frames that no single possible contact explains, or of which something else was noticed that the
    core's `report.hpp` names."""
    return np.asarray(core.solver.judge(limits()[0], numbers.rows)[1] & bits != 0)


def _noticed(numbers: FitNumbers) -> int:
    """The findings on one frame, as a mask of bits that the core's `report.hpp` names."""
    return int(core.solver.judge(limits()[0], numbers.rows)[1][0])


def _disagreement(numbers: FitNumbers) -> float:
    """Largest residual of a reading of one frame, in its expected standard deviations."""
    return float(np.max(np.abs(numbers.residual[0]) / numbers.residual_std[0]))


def reason(several: FitNumbers, index: int, status: str, length_m: float, requested: str) -> str:
    """The reason of one frame: why it is not ok, or which model was used and why, and further remarks. status : ""
    for a frame that is ok and ordinary."""
    if not status:
        row = several.rows[index]
        return model_words(int(row["rung"]), row["bias"].tolist(), requested)
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
    reasons = [model_words(int(numbers.rung[0]), numbers.bias[0].tolist(), requested)]
    if status == TIP:
        reasons.insert(0, "the contact is indistinguishable from the tip: its distance is the antenna's length")
    return "; ".join(reasons + _remarks(numbers))


def _failed(numbers: FitNumbers, length_m: float) -> str:
    why = _misfit(numbers, length_m)
    if not (_noticed(numbers) & core.solver.UNEXPLAINED and numbers.explained_drifted[0]):
        return why
    return (
        f"it fits if the rig has changed since its calibration (the picture by about {numbers.drift_px[0]:.2g} px, the "
        f"reading by {numbers.drift_readings[0]:.1g} std): show the free antenna first, or check the rig; if not, {why}"
    )


def _misfit(numbers: FitNumbers, length_m: float) -> str:
    scatter, friction = numbers.scatter[0], abs(numbers.unknowns[0, 3])
    bits, noticed = core.solver, _noticed(numbers)
    if not numbers.finite[0]:
        return "the fit left the domain of the model"
    if np.isfinite(numbers.left_px[0]):
        far = f"wherever it is touched, many of them lie {numbers.left_px[0]:.0f} px off or more"
        return f"the points are not on this antenna, or it is bent too far: {far}"
    if noticed & bits.MODEL_TOO_LOW and not noticed & bits.UNEXPLAINED:
        rung = int(numbers.rung[0])
        return f"{RUNGS[rung]} is too low for this frame, some {numbers.bias[0, rung]:.0f} std off: take a higher rung"
    two = ""
    if noticed & bits.TWICE_TOUCHED:
        near, far = (1e3 * length_m * at for at in sorted((numbers.unknowns[0, 0], numbers.second_place[0])))
        two = f"two contacts explain it better, near {near:.0f} and {far:.0f} mm, or the rig is off"
    if noticed & bits.UNEXPLAINED and numbers.explained_alone[0]:
        why = "picture and moment contradict each other: without the reading all is well, so check the sensor"
        return f"{why}; or {two}" if two else why
    if two:
        return f"the shape is not that of one contact: {two}"
    if noticed & bits.AT_CLAMP:
        nearest_mm = 1e3 * core.solver.NEAREST * length_m
        return f"the contact lies nearer to the clamp than {nearest_mm:.0f} mm, where none is looked for"
    if noticed & bits.TOO_STEEP:
        return f"the force needs a friction angle of {friction:.1f} standard deviations: give a larger --friction"
    if scatter > core.solver.WRONG_SHAPE or (scatter > 1.0 and noticed & bits.MIRRORED):
        far = f"points lie {scatter:.1f} std off or more"
        return f"the shape is not that of one contact: {far}, or their std is stated too small"
    if not numbers.converged[0]:
        most = core.solver.MOST_EVALUATIONS
        in_most = f" in {most} evaluations of the model" if numbers.evaluations[0] >= most else ""
        return f"the fit did not converge{in_most}"
    return f"picture and moment contradict each other by {_disagreement(numbers):.0f} std: check the sensor"


def _unobservable(numbers: FitNumbers, length_m: float) -> str:
    if numbers.edge_on_rad[0] < (
        ContactSettings.edge_on_blind_rad if _noticed(numbers) & core.solver.MIRRORED else ContactSettings.edge_on_rad
    ):
        return f"the camera sees the deformation plane edge-on, {np.degrees(numbers.edge_on_rad[0]):.1f}° off"
    if not np.isfinite(numbers.std[0, 0]):
        return "nothing in picture and moment holds the contact distance"
    if _noticed(numbers) & core.solver.FORCE_UNKNOWN:
        return "nothing in picture and moment holds the force in one direction across the antenna"
    near, far = (1e3 * length_m * u[0, 0] for u in (numbers.unknowns, numbers.alternative_unknowns))
    rolls = (np.degrees(np.arctan2(u[0, 2], u[0, 1])) for u in (numbers.unknowns, numbers.alternative_unknowns))
    here, there = (f"at {d:.0f} mm pushed towards {r:.0f}°" for d, r in zip((near, far), rolls, strict=True))
    return f"two contacts explain it about equally well: {here}, and {there} from y"


def model_words(rung: int, bias: list[float], requested: str) -> str:
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
    if np.sqrt(rig) > chi_limit(ContactSettings.rig_p_value, max(int(numbers.rig_axes[0]), 1)):
        remarks.append(f"the rig's parameters had to move by {np.sqrt(rig):.0f} std to fit: check the rig")
    if abs(numbers.tip_std[0]) > ContactSettings.disagreement:
        remarks.append(f"the antenna's visible end lies {abs(numbers.tip_std[0]):.0f} std off, and is not used")
    if numbers.friction_share[0] > ContactSettings.friction_share:
        worse = 1.0 / np.sqrt(max(1.0 - float(numbers.friction_share[0]), 1e-2))
        remarks.append(f"unknown friction makes the distance {worse:.0f} times less certain (--friction)")
    if _disagreement(numbers) > ContactSettings.disagreement:
        remarks.append(f"picture and moment disagree by {_disagreement(numbers):.0f} std")
    return remarks
