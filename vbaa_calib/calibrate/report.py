"""Reports of a calibration: warnings, the result in a few lines, the evidence for rig.json and camera.json."""

from __future__ import annotations

import os
import platform
from collections.abc import Collection, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from targets.board import Board
from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.residual_checks import FALSE_READING, Checks
from vbaa_calib.calibrate.antenna.session_rig import LOG_MASS_STD
from vbaa_calib.calibrate.faults.explanations import picture_scatter
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens.uncertainty import projection_uncertainty
from vbaa_calib.calibrate.pose.fusion import CONTRADICTION
from vbaa_calib.core.console import say
from vbaa_calib.core.files import sha256
from vbaa_calib.core.robust import chi_square_p, finite_or_none
from vbaa_calib.rig import Rig
from vbaa_calib.session import STANDARD_GRAVITY_M_S2, Load, NominalAntenna, Session, Still

from .pipeline import Calibration
from .plane_c import PlaneC, picture_folders

_PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "torch", "kornia")  # whose versions rig.json names
_STIFFNESS_DOUBT = 0.15  # relative difference of EI from E·πd⁴/64 that is worth a warning: 4 % of the diameter
_SIGNIFICANT, _CHANCE = 4.0, 6e-5
"""Standard deviations beyond which an assumption counts as broken, and how often one that holds is that far off: there
are about twenty, and a session without a fault is to pass them all."""
_SCATTERED = 5.0  # scatter of the shapes, over their pictures' own, beyond which the model does not fit
_EXPLAINS_SCATTER = ("load_", "gravity_", "joint_readings_", "clamp_slipped", "antenna_bent_between", "stills_")
"""How the names of the diagnoses begin that say why the shapes scatter."""
_SAG_MATTERS_M = 1e-4
_ANISOTROPY_MATTERS = 0.01  # part by which the compliances must differ at least: a wire drawn 0.25 % out of round


def still_doubts(joint: BundleAdjustment, stills: Sequence[Still], said: str = "") -> list[str]:
    """Stills whose rows look wrong, but for those whose pictures were named in `said`."""
    found = []
    offs = joint.moment_residuals_Nm / joint.problem.moment_std_Nm
    for still, off, kept in zip(stills, offs, joint.kept, strict=True):
        name = still.image.name if still.image else "?"
        what = f"{'load' if isinstance(still, Load) else 'no-load frame'} {name}"
        if still.image and name in said:
            continue
        reading = f"the moment reading is {off:+.1f} std off" if abs(off) > FALSE_READING else ""
        if not kept:
            why = reading or "for it contradicts the others"
            found.append(f"{what}: left out, {why}; is its row right, and its line the antenna?")
        elif reading:
            found.append(f"{what}: {reading}; is its row right?")
    return found


def prior_doubts(joint: BundleAdjustment, said: Collection[str] = ()) -> list[str]:
    """Where the pictures contradict plane C, clamp or loads; what a diagnosis already `said` is left out."""
    problem, found = joint.problem, []
    first = len(joint.solution.residuals) - problem.certain
    for index, estimate in enumerate(problem.prior.poses):
        own = joint.solution.residuals[first + 6 * index :][:6]
        if chi_square_p(float(own @ own), 6) < CONTRADICTION:
            found.append(
                f"the antenna's pictures contradict the {estimate.way} by {np.sqrt(own @ own / 6):.0f} std: is the "
                "camera where it was, and is session.yaml right about it?"
            )
    known = problem.prior.mean[:6], problem.prior.std[:6]
    for name, value, mean, std in zip(PARAMETERS[:6], joint.parameters[6:12], *known, strict=True):
        explained = "antenna_bent" in said and name.startswith("bow")
        if abs(value - mean) > _SIGNIFICANT * std and not explained:
            found.append(
                f"{name} is {value:.3g}, {abs(value - mean) / std:.1f} times what a careful builder misses it by: is "
                "plane C right, and the antenna straight in its clamp?"
            )
    scatter = max(picture_scatter(joint.noted), 1.0)
    if joint.noise_scale > _SCATTERED * scatter and not any(name.startswith(_EXPLAINS_SCATTER) for name in said):
        found.append(
            f"the shapes scatter {joint.noise_scale:.0f} times more about the model than their pictures explain: check "
            "the unit and the sign of forces and distances, and gravity"
        )
    return found


def antenna_doubts(nominal: NominalAntenna, rig: Rig, checks: Checks) -> list[str]:
    """EI against E·πd⁴/64, equal compliance (assumption 4), and the density that the sag requires."""
    found, difference = [], rig.antenna.stiffness_Nm2 / nominal.stiffness_Nm2 - 1
    if abs(difference) > max(_STIFFNESS_DOUBT, _SIGNIFICANT * rig.std("log_stiffness_Nm2")):
        found.append(
            f"EI is {100 * difference:+.0f} % off E·πd⁴/64 = {nominal.stiffness_Nm2:.4g} N·m²: check diameter, loads "
            "and their unit"
        )
    uneven = checks.anisotropy
    if uneven is not None and abs(uneven.value) > max(_ANISOTROPY_MATTERS, _SIGNIFICANT * uneven.std):
        found.append(
            f"the antenna is {100 * abs(uneven.value):.1f} ± {100 * uneven.std:.1f} % stiffer against bending to "
            f"{'y' if uneven.value > 0 else 'z'} than to the other side: is the wire round?"
        )
    mass, known = checks.mass_per_length_kg_m, nominal.mass_per_length_kg_m
    if mass is not None and abs(np.log(mass.value / known)) > _SIGNIFICANT * np.hypot(1 / mass.in_std, LOG_MASS_STD):
        area = known / nominal.density_kg_m3
        found.append(
            f"the sag requires a density of {mass.value / area:.0f} ± {mass.std / area:.0f} kg/m³, the session says "
            f"{nominal.density_kg_m3:.0f}: check diameter, density and the direction of gravity"
        )
    sag_m = known * STANDARD_GRAVITY_M_S2 * nominal.length_m**4 / (8.0 * nominal.stiffness_Nm2)
    if not rig.gravity_world_m_s2.any() and sag_m > _SAG_MATTERS_M:
        found.append(
            f"the session is weightless, where its weight would bend the antenna by {1e3 * sag_m:.1f} mm: what the "
            "pictures show of that counts as its bow. On Earth give gravity_world in session.yaml"
        )
    return found


def sensor_doubts(session: Session, rig: Rig, checks: Checks) -> list[str]:
    """Sign, noise and drift of the moment sensor."""
    found = []
    if rig.moment_sensor.gain <= 0:
        found.append("the moment sensor's gain is negative: its sign is turned round")
    if checks.noise_chance(session.moment_std_Nm) < _CHANCE:
        found.append(
            f"the moment sensor scatters by {1e3 * checks.noise_Nm:.3g} mN·m, the session says "
            f"{1e3 * session.moment_std_Nm:.3g}: the former is used"
        )
    drift = checks.drift_Nm
    if drift is not None and abs(drift.in_std) > _SIGNIFICANT:
        found.append(
            f"the moment sensor drifts by {1e3 * drift.value:.2g} ± {1e3 * drift.std:.2g} mN·m per {checks.drift_per}: "
            "let it warm up, and zero it again before a recording"
        )
    return found


def _plane_doubts(plane: PlaneC) -> list[str]:
    found = [
        f"the board of {way!r} has a second pose that fits nearly as well: take it from a steeper angle"
        for way, board in plane.boards.items()
        if board.is_ambiguous
    ]
    sweep = plane.sweep
    if sweep is None:
        return found
    axes = (
        f"the joints' axes miss the right angle by {1e3 * sweep.axis_skew_rad:.2f} mrad and pass each other by "
        f"{1e3 * sweep.axis_offset_m:.2f} mm: solved with that"
    )
    left_out = [f"sweep {view.name}: left out, {view.reason}" for view in sweep.left_out]
    return [*found, *left_out, *([axes] if sweep.axes_free else [])]


def doubts(calibration: Calibration) -> list[str]:
    """What a person should look at, in words; a doubt that a diagnosis explains is left to that."""
    session, rig, plane = calibration.session, calibration.rig, calibration.plane
    diagnoses = calibration.still_diagnoses
    said = {one.name for one in diagnoses}
    found = [*map(str, calibration.lens.verdict.diagnoses), *_plane_doubts(plane), *map(str, diagnoses)]
    found += prior_doubts(calibration.joint, said)
    found += still_doubts(calibration.joint, calibration.stills, "\n".join(one.words for one in diagnoses))
    if not any(one.grave for one in diagnoses):
        found += antenna_doubts(session.antenna, rig, calibration.checks)
        if not any(name.startswith("sensor_") for name in said):
            found += sensor_doubts(session, rig, calibration.checks)
    return found


def report(calibration: Calibration, warnings: Sequence[str]) -> None:
    """The result in a few lines of prose."""
    rig, stiffness, sensor = calibration.rig, calibration.rig.antenna.stiffness_Nm2, calibration.rig.moment_sensor
    x, y, z = 1e3 * rig.T_antenna_camera.translation_m
    off = 1e3 * np.sqrt(np.diag(rig.covariance)[:6])
    ways = " + ".join(estimate.way for estimate in calibration.plane.estimates)
    lens = calibration.lens
    rms = "" if calibration.given else f": rms {lens.rms_px:.3f} px"
    say(f"lens       {lens.model}{rms}. {lens.verdict.words}")
    say(
        f"plane C    camera at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the antenna frame, "
        f"± {off[3:].max():.2g} mm, ± {off[:3].max():.2g} mrad (by {ways})"
    )
    for difference in calibration.plane.differences:
        say(f"           {difference}")
    say(f"antenna    EI = {stiffness:.5g} ± {stiffness * rig.std('log_stiffness_Nm2'):.2g} N·m²")
    gain = f"gain {sensor.gain:.4f} ± {rig.std('moment_gain'):.4f}"
    say(f"sensor     {gain}, offset {1e3 * sensor.offset_Nm:.3f} mN·m")
    grave = {str(one) for one in (*lens.verdict.diagnoses, *calibration.still_diagnoses) if one.grave}
    for line in warnings:
        say(f"{'wrong' if line in grave else 'look at':10s} {line}")


def summary(calibration: Calibration, warnings: Sequence[str]) -> dict[str, Any]:
    """The numbers of the result at a glance, for `--json`."""
    joint, jig = calibration.joint, calibration.plane.jig
    return {
        "lens_rms_px": None if calibration.given else float(calibration.lens.rms_px),
        "plane_rms_px": None if jig is None else float(jig.rms_px),
        "plane_second_solution_ratio": None if jig is None else jig.second_ratio,
        "noise_scale": joint.noise_scale,
        "lens_grade": calibration.lens.verdict.grade,
        "worst_still_rms": float(joint.point_rms.max()),
        "moment_residual_rms_Nm": float(np.sqrt((joint.moment_residuals_Nm**2).mean())),
        "warnings": list(warnings),
    }


def _evidence(calibration: Calibration, warnings: Sequence[str]) -> dict[str, Any]:
    nominal, joint = calibration.session.antenna, calibration.joint
    lens, jig = camera_document(calibration.lens, calibration.session.board), calibration.session.T_antenna_board
    rows = zip(calibration.stills, joint.point_rms, joint.moment_residuals_Nm, joint.kept, strict=True)
    stills: list[dict[str, Any]] = []
    for still, rms, residual_Nm, kept in rows:
        image = os.path.relpath(still.image, calibration.session.root) if still.image else None
        numbers = {"point_rms": float(rms), "moment_residual_Nm": float(residual_Nm), "kept": bool(kept)}
        load = ("distance_m", "force_y_N", "force_z_N") if isinstance(still, Load) else ()
        stills.append({"image": image, **numbers, **{name: getattr(still, name) for name in load}})
    return summary(calibration, warnings) | {
        "lens": {key: value for key, value in lens.items() if key not in calibration.lens.camera.to_dict()},
        "given_lens": calibration.given and calibration.given.to_dict(),
        "plane": calibration.plane.to_dict(),
        # the board's printed face, so that one picture of it shows later whether the camera has moved
        "jig": None if jig is None else {"T_antenna_board": jig.to_dict()},
        "stills": stills,
        "antenna": {
            "nominal_stiffness_Nm2": nominal.stiffness_Nm2,
            "stiffness_over_nominal": calibration.rig.antenna.stiffness_Nm2 / nominal.stiffness_Nm2,
            "nominal_density_kg_m3": nominal.density_kg_m3,
        },
        "checks": calibration.checks.to_dict(),
    }


def rig_document(calibration: Calibration, warnings: Sequence[str], command: Sequence[str]) -> dict[str, Any]:
    """rig.json: the rig, the evidence for it, and what it was made of by which command line."""
    session = calibration.session
    files = [session.root / "session.yaml"]
    for name in ("intrinsics", *picture_folders(session), "noload", "loads"):
        files += sorted(path for path in (session.root / name).glob("*") if path.is_file())
    paths = {str(path.relative_to(session.root)): path for path in files}
    if calibration.given is not None:
        paths[os.path.relpath(calibration.given.path, session.root)] = calibration.given.path
    return calibration.rig.to_dict() | {
        "quality": _evidence(calibration, warnings),
        "inputs_sha256": {name: sha256(path) for name, path in paths.items()},
        "versions": {"python": platform.python_version(), "vbaa-calib": version("vbaa-calib")}
        | {name: version(name) for name in _PACKAGES},
        "command": list(command),
    }


def camera_document(solution: LensSolution, spec: Board) -> dict[str, Any]:
    """camera.json: what `Camera.load` reads, and the evidence for it (docs/formats.md)."""
    covariance = solution.camera.covariance
    assert covariance is not None
    # null where there is no ray
    free, fixed = (projection_uncertainty(solution.camera, compensated) for compensated in (True, False))
    free_px, fixed_px = (np.where(np.isfinite(one.std_px), one.std_px, np.array(None)) for one in (free, fixed))
    return {
        **solution.camera.to_dict(),
        "std": dict(zip(solution.camera.parameter_names, covariance.diagonal().clip(0.0) ** 0.5, strict=True)),
        "lens_model": solution.model,
        "monotonic": solution.monotonic,
        **solution.verdict.to_dict(),
        "rms_px": finite_or_none(solution.rms_px),
        "rms_inliers_px": finite_or_none(solution.rms_inliers_px),
        "projection_uncertainty": {
            "columns_px": free.pixels[0, :, 0].tolist(),
            "rows_px": free.pixels[:, 0, 1].tolist(),
            "std_px": free_px.tolist(),
            "std_fixed_camera_px": fixed_px.tolist(),
        },
        "board_shape": solution.board_shape.to_dict(),
        "views": [
            vars(view) | {"outlier_ids": list(view.outlier_ids), "T_camera_board": view.T_camera_board.to_dict()}
            for view in solution.views
        ],
        "dropped": [vars(view) for view in solution.dropped],
        "model_comparison": [vars(candidate) for candidate in solution.comparison],
        "board": spec.to_dict(),
    }
