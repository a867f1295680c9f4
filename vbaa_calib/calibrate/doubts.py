"""All diagnoses of a calibration: of lens, plane C, the session's hypotheses, and of data that bundle adjustment
excluded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.pose.settings import PoseSettings
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.robust import chi_square_p
from vbaa_calib.session import STANDARD_GRAVITY_M_S2, Load, Session

from .plane_c import PlaneC

if TYPE_CHECKING:
    from .pipeline import Calibration


def _row_doubts(joint: BundleAdjustment, explained: Sequence[Diagnosis]) -> list[Diagnosis]:
    """Diagnoses of rows and stretches of lines that bundle adjustment excluded, except in pictures that another
    diagnosis names."""
    found, named = [], "\n".join(one.words for one in explained)
    for one, kept, disturbed in zip(joint.noted, joint.kept, joint.disturbed, strict=True):
        name = one.still.image.name if one.still.image else "?"
        if disturbed:
            words = (
                f"{name}: {disturbed} of {disturbed + len(one.points_px)} points of the line were left out: a stretch "
            )
            words += "lies off the rest, as where a load's thread or hook crosses the antenna"
            remedy = "hang loads by a thin thread that leaves the antenna sideways in the picture"
            found.append(Diagnosis("line_disturbed", words, remedy, "note"))
        if not kept and name not in named:
            kind = "load" if isinstance(one.still, Load) else "no-load frame"
            words = f"{kind} {name}: left out, for it contradicts the others"
            found.append(Diagnosis("row_left_out", words, "check its row, and that its line is the antenna"))
    return found


def prior_doubts(joint: BundleAdjustment, explained: Sequence[Diagnosis]) -> list[Diagnosis]:
    """Diagnoses where the pictures contradict the priors of plane C, or of the clamp by four standard deviations; none
    where another diagnosis may explain it."""
    if any(one.severity != "note" for one in explained):
        return []
    problem, found = joint.problem, []
    first = len(joint.solution.residuals) - problem.certain
    for index, estimate in enumerate(problem.prior.poses):
        own = joint.solution.residuals[first + 6 * index :][:6]
        if chi_square_p(float(own @ own), 6) < PoseSettings.contradiction:
            words = f"the antenna's pictures contradict the {estimate.way} by {np.sqrt(own @ own / 6):.0f} std"
            remedy = "is the camera where it was, and is session.yaml right about it?"
            found.append(Diagnosis("pictures_contradict_pose", words, remedy))
    known = problem.prior.mean[:6], problem.prior.std[:6]
    for name, value, mean, std in zip(PARAMETERS[:6], joint.parameters[6:12], *known, strict=True):
        if abs(value - mean) > 4.0 * std:
            words = f"{name} is {value:.3g}, {abs(value - mean) / std:.1f} times what a careful builder misses it by"
            remedy = "is plane C right, and the antenna straight in its clamp?"
            found.append(Diagnosis(f"{name}_implausible", words, remedy))
    return found


def _weightless(session: Session) -> list[Diagnosis]:
    """Diagnosis of a session without gravity in which the antenna would sag by more than 0.1 mm."""
    nominal = session.antenna
    own_m = nominal.mass_per_length_kg_m * STANDARD_GRAVITY_M_S2 * nominal.length_m**4 / (8.0 * nominal.stiffness_Nm2)
    if session.gravity_world_m_s2.any() or own_m <= 1e-4:
        return []
    words = (
        f"the session is weightless, where its weight would bend the antenna by {1e3 * own_m:.1f} mm: what the "
        "pictures show of that counts as its bow"
    )
    return [Diagnosis("weightless", words, "on Earth give gravity_world in session.yaml")]


def _plane_doubts(plane: PlaneC) -> list[Diagnosis]:
    """Diagnoses of plane C: ambiguous board poses, unused pictures, and what the sweep excluded or solved for."""
    remedy = "take it from a steeper angle"
    found = [
        Diagnosis("pose_ambiguous", f"the board of {way!r} has a second pose that fits nearly as well", remedy)
        for way, board in plane.boards.items()
        if board.is_ambiguous
    ]
    found += plane.unused
    sweep = plane.sweep
    if sweep is None:
        return found
    found += [
        Diagnosis("sweep_view_left_out", f"sweep {view.name}: left out, {view.reason}", "check its row")
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
    """All diagnoses of a calibration, except those that another one explains."""
    joint, explained = calibration.joint, calibration.static_frame_diagnoses
    found = [*calibration.lens.verdict.findings, *_plane_doubts(calibration.plane), *explained]
    found += prior_doubts(joint, explained) + _row_doubts(joint, explained)
    if not any(one.name.startswith("gravity_") for one in explained):
        found += _weightless(calibration.session)
    return found
