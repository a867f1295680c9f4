"""What deserves a look, or is wrong, with a calibration: pictures against plane C, rows, antenna, sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.residual_checks import FALSE_READING, Checks
from vbaa_calib.calibrate.antenna.session_rig import LOG_MASS_STD
from vbaa_calib.calibrate.faults.explanations import picture_scatter
from vbaa_calib.calibrate.pose.fusion import CONTRADICTION
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.robust import chi_square_p
from vbaa_calib.rig import Rig
from vbaa_calib.session import STANDARD_GRAVITY_M_S2, Load, NominalAntenna, Session, Still

from .plane_c import PlaneC

if TYPE_CHECKING:
    from .pipeline import Calibration


@dataclass(frozen=True)
class DoubtSettings:
    """From which difference on an assumption of a calibration counts as broken."""

    significant_std: float = 4.0  # there are about twenty assumptions, and a session without a fault passes them all
    chance: float = 6e-5  # how often one that holds is that far off
    stiffness: float = 0.15  # relative difference of EI from E·πd⁴/64: 4 % of the diameter
    scattered: float = 5.0  # scatter of the shapes, over their pictures' own, beyond which the model does not fit
    anisotropy: float = 0.01  # relative difference of the compliances: a wire drawn 0.25 % out of round
    sag_m: float = 1e-4  # what the weight would bend an antenna that is called weightless
    explains_scatter: tuple[str, ...] = (  # how the names of the diagnoses begin that say why the shapes scatter
        *("load_", "gravity_", "joint_readings_"),
        *("clamp_slipped", "antenna_bent_between", "stills_"),
    )


_LIMITS = DoubtSettings()


def row_doubts(
    joint: BundleAdjustment, frames: Sequence[Still], explained: Sequence[Diagnosis] = ()
) -> list[Diagnosis]:
    """Rows of static frames that look wrong, but for those whose pictures a diagnosis names."""
    found, named = [], "\n".join(one.words for one in explained)
    offs = joint.moment_residuals_Nm / joint.problem.moment_std_Nm
    for frame, off, kept in zip(frames, offs, joint.kept, strict=True):
        name = frame.image.name if frame.image else "?"
        what = f"{'load' if isinstance(frame, Load) else 'no-load frame'} {name}"
        if frame.image and name in named:
            continue
        reading = f"the moment reading is {off:+.1f} std off" if abs(off) > FALSE_READING else ""
        if not kept:
            words = f"{what}: left out, {reading or 'for it contradicts the others'}"
            found.append(Diagnosis("row_left_out", words, "is its row right, and its line the antenna?"))
        elif reading:
            found.append(Diagnosis("moment_reading_off", f"{what}: {reading}", "is its row right?"))
    return found


def prior_doubts(
    joint: BundleAdjustment, explained: Sequence[Diagnosis] = (), limits: DoubtSettings = _LIMITS
) -> list[Diagnosis]:
    """Where the pictures contradict plane C, clamp or loads, but for what a diagnosis explains."""
    problem, found, names = joint.problem, [], [one.name for one in explained]
    first = len(joint.solution.residuals) - problem.certain
    for index, estimate in enumerate(problem.prior.poses):
        own = joint.solution.residuals[first + 6 * index :][:6]
        if chi_square_p(float(own @ own), 6) < CONTRADICTION:
            words = f"the antenna's pictures contradict the {estimate.way} by {np.sqrt(own @ own / 6):.0f} std"
            remedy = "is the camera where it was, and is session.yaml right about it?"
            found.append(Diagnosis("pictures_contradict_pose", words, remedy))
    known = problem.prior.mean[:6], problem.prior.std[:6]
    for name, value, mean, std in zip(PARAMETERS[:6], joint.parameters[6:12], *known, strict=True):
        bent = "antenna_bent" in names and name.startswith("bow")
        if abs(value - mean) > limits.significant_std * std and not bent:
            words = f"{name} is {value:.3g}, {abs(value - mean) / std:.1f} times what a careful builder misses it by"
            remedy = "is plane C right, and the antenna straight in its clamp?"
            found.append(Diagnosis(f"{name}_implausible", words, remedy))
    scatter = max(picture_scatter(joint.noted), 1.0)
    if joint.noise_scale > limits.scattered * scatter and not any(
        name.startswith(limits.explains_scatter) for name in names
    ):
        words = f"the shapes scatter {joint.noise_scale:.0f} times more about the model than their pictures explain"
        remedy = "check the unit and the sign of forces and distances, and gravity"
        found.append(Diagnosis("shapes_scatter", words, remedy))
    return found


def antenna_doubts(
    nominal: NominalAntenna, rig: Rig, checks: Checks, limits: DoubtSettings = _LIMITS
) -> list[Diagnosis]:
    """EI against E·πd⁴/64, equal compliance (assumption 4), and the density that the sag requires."""
    found, difference = [], rig.antenna.stiffness_Nm2 / nominal.stiffness_Nm2 - 1
    if abs(difference) > max(limits.stiffness, limits.significant_std * rig.std("log_stiffness_Nm2")):
        words = f"EI is {100 * difference:+.0f} % off E·πd⁴/64 = {nominal.stiffness_Nm2:.4g} N·m²"
        found.append(Diagnosis("stiffness_not_nominal", words, "check diameter, loads and their unit"))
    uneven = checks.anisotropy
    if uneven is not None and abs(uneven.value) > max(limits.anisotropy, limits.significant_std * uneven.std):
        words = (
            f"the antenna is {100 * abs(uneven.value):.1f} ± {100 * uneven.std:.1f} % stiffer against bending to "
            f"{'y' if uneven.value > 0 else 'z'} than to the other side"
        )
        found.append(Diagnosis("stiffness_uneven", words, "is the wire round?"))
    mass, known = checks.mass_per_length_kg_m, nominal.mass_per_length_kg_m
    if mass is not None:
        std = np.hypot(1 / mass.in_std, LOG_MASS_STD)
        if abs(np.log(mass.value / known)) > limits.significant_std * std:
            area = known / nominal.density_kg_m3
            words = (
                f"the sag requires a density of {mass.value / area:.0f} ± {mass.std / area:.0f} kg/m³, the session "
                f"says {nominal.density_kg_m3:.0f}"
            )
            remedy = "check diameter, density and the direction of gravity"
            found.append(Diagnosis("density_not_nominal", words, remedy))
    sag_m = known * STANDARD_GRAVITY_M_S2 * nominal.length_m**4 / (8.0 * nominal.stiffness_Nm2)
    if not rig.gravity_world_m_s2.any() and sag_m > limits.sag_m:
        words = (
            f"the session is weightless, where its weight would bend the antenna by {1e3 * sag_m:.1f} mm: what the "
            "pictures show of that counts as its bow"
        )
        found.append(Diagnosis("weightless", words, "on Earth give gravity_world in session.yaml"))
    return found


def sensor_doubts(session: Session, rig: Rig, checks: Checks, limits: DoubtSettings = _LIMITS) -> list[Diagnosis]:
    """Sign, noise and drift of the moment sensor."""
    found = []
    if rig.moment_sensor.gain <= 0:
        found.append(Diagnosis("sensor_gain_negative", "the moment sensor's gain is negative", "is its sign right?"))
    if checks.noise_chance(session.moment_std_Nm) < limits.chance:
        words = (
            f"the moment sensor scatters by {1e3 * checks.noise_Nm:.3g} mN·m, the session says "
            f"{1e3 * session.moment_std_Nm:.3g}"
        )
        found.append(Diagnosis("sensor_noise", words, "the former is used"))
    drift = checks.drift_Nm
    if drift is not None and abs(drift.in_std) > limits.significant_std:
        words = (
            f"the moment sensor drifts by {1e3 * drift.value:.2g} ± {1e3 * drift.std:.2g} mN·m per {checks.drift_per}"
        )
        found.append(Diagnosis("sensor_drifts", words, "let it warm up, and zero it again before a recording"))
    return found


def _plane_doubts(plane: PlaneC) -> list[Diagnosis]:
    """Second poses of a board, and what the sweep left out or solved for."""
    remedy = "take it from a steeper angle"
    found = [
        Diagnosis("pose_ambiguous", f"the board of {way!r} has a second pose that fits nearly as well", remedy)
        for way, board in plane.boards.items()
        if board.is_ambiguous
    ]
    sweep = plane.sweep
    if sweep is None:
        return found
    found += [
        Diagnosis("sweep_view_left_out", f"sweep {view.name}: left out, {view.reason}", "is its row right?")
        for view in sweep.left_out
    ]
    if sweep.axes_free:
        words = (
            f"the joints' axes miss the right angle by {1e3 * sweep.axis_skew_rad:.2f} mrad and pass each other by "
            f"{1e3 * sweep.axis_offset_m:.2f} mm"
        )
        found.append(Diagnosis("axes_skew", words, "solved with that", "note"))
    return found


def doubts(calibration: Calibration) -> list[Diagnosis]:
    """All that is wrong or deserves a look, but for doubts that a diagnosis explains."""
    session, rig, joint = calibration.session, calibration.rig, calibration.joint
    explained = calibration.still_diagnoses
    found = [*calibration.lens.verdict.diagnoses, *_plane_doubts(calibration.plane), *explained]
    found += prior_doubts(joint, explained) + row_doubts(joint, calibration.stills, explained)
    if not any(one.grave for one in explained):
        found += antenna_doubts(session.antenna, rig, calibration.checks)
        if not any(one.name.startswith("sensor_") for one in explained):
            found += sensor_doubts(session, rig, calibration.checks)
    return found
