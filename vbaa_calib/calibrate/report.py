"""Reports of a calibration: warnings, a summary in a few lines, and the documents rig.json and camera.json."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from targets.board import Board
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens.uncertainty import projection_uncertainty
from vbaa_calib.core.console import say
from vbaa_calib.core.files import read_yaml, sha256
from vbaa_calib.core.robust import finite_or_none
from vbaa_calib.session import Load

from .pipeline import Calibration
from .plane_c import picture_folders


def report(calibration: Calibration) -> None:
    """Prints the result in a few lines of prose."""
    rig, lens, words = calibration.rig, calibration.lens, calibration.rig.words
    for name, other in calibration.others.items():
        lens_of, where = other.lens, calibration.rig.others[name].words["plane C"]
        say(f"{name:10s} lens {lens_of.model}: rms {lens_of.rms_px:.3f} px; {where}")
    ways = " + ".join(estimate.way for estimate in calibration.plane.estimates)
    rms = "" if calibration.given else f": rms {lens.rms_px:.3f} px"
    say(f"lens       {lens.model}{rms}. {lens.words}")
    say(f"plane C    {words['plane C']} (by {ways})")
    for difference in calibration.plane.differences:
        say(f"           {difference}")
    say(f"antenna    {words['stiffness']}")
    say(f"sensor     {words['sensor']}")
    for one in rig.verdict.findings:
        say(f"{one.label:10s} {one}")


def summary(calibration: Calibration) -> dict[str, Any]:
    """The main numbers of the result, for `--json`."""
    joint, jig = calibration.joint, calibration.plane.jig
    return {
        "lens_rms_px": None if calibration.given else float(calibration.lens.rms_px),
        "plane_rms_px": None if jig is None else float(jig.rms_px),
        "plane_second_solution_ratio": None if jig is None else jig.second_ratio,
        "noise_scale": joint.noise_scale,
        "scatter": joint.scatter,
        "lens_grade": calibration.lens.grade,
        "worst_still_rms": float(joint.point_rms.max()),
        "moment_residual_rms_Nm": finite_or_none(np.sqrt((joint.moment_residuals_Nm**2).mean())),
        "warnings": [str(one) for one in calibration.rig.verdict.findings],
    }


def _evidence(calibration: Calibration, guide: Mapping[str, Any]) -> dict[str, Any]:
    nominal, joint = calibration.session.antenna, calibration.joint
    lens, jig = camera_document(calibration.lens, calibration.session.board), calibration.session.T_antenna_board
    rows = zip(calibration.stills, joint.point_rms, joint.moment_residuals_Nm, joint.kept, strict=True)
    frames: list[dict[str, Any]] = []
    for still, rms, residual_Nm, kept in rows:
        image = os.path.relpath(still.image, calibration.session.root) if still.image else None
        numbers = {"point_rms": float(rms), "moment_residual_Nm": finite_or_none(residual_Nm), "kept": bool(kept)}
        load = ("distance_m", "force_y_N", "force_z_N") if isinstance(still, Load) else ()
        frames.append({"image": image, **numbers, **{name: getattr(still, name) for name in load}})
    return summary(calibration) | {
        "lens": {key: value for key, value in lens.items() if key not in calibration.lens.camera.to_dict()},
        "given_lens": calibration.given and calibration.given.to_dict(),
        "plane": calibration.plane.to_dict(),
        # the board's printed face, so that one picture of it shows later whether the camera has moved
        "jig": None if jig is None else {"T_antenna_board": jig.to_dict()},
        "stills": frames,
        "antenna": {
            "nominal_stiffness_Nm2": nominal.stiffness_Nm2,
            "stiffness_over_nominal": calibration.rig.antenna.stiffness_Nm2 / nominal.stiffness_Nm2,
            "nominal_density_kg_m3": nominal.density_kg_m3,
        },
        "checks": dict(calibration.checks),
        "guide": dict(guide),
        **(
            {"cameras": {name: _evidence(one, {}) for name, one in calibration.others.items()}}
            if calibration.others
            else {}
        ),
    }


def rig_document(calibration: Calibration, command: Sequence[str], guide: Mapping[str, Any]) -> dict[str, Any]:
    """The document rig.json: the rig, the evidence for it, suggested observations (`guide`), the inputs and the
    command line."""
    session = calibration.session
    files = [session.root / "session.yaml"]
    if isinstance(board := read_yaml(files[0]).get("board"), str):
        files.append(session.root / board)
    for name in ("intrinsics", *picture_folders(session), "noload", "loads"):
        inside = (session.root / name).glob("**/*" if session.cameras else "*")
        files += sorted(path for path in inside if path.is_file())
    paths = {str(path.relative_to(session.root)): path for path in files}
    if calibration.given is not None:
        paths[os.path.relpath(calibration.given.path, session.root)] = calibration.given.path
    return calibration.rig.to_dict() | {
        "quality": _evidence(calibration, guide),
        "inputs_sha256": {name: sha256(path) for name, path in paths.items()},
        "versions": {"python": platform.python_version(), "vbaa-calib": version("vbaa-calib")}
        | {name: version(name) for name in ("numpy", "scipy", "opencv-contrib-python-headless", "torch", "kornia")},
        "command": list(command),
    }


def camera_document(solution: LensSolution, spec: Board) -> dict[str, Any]:
    """The document camera.json: what `Camera.load` reads, and the evidence for it (docs/formats.md)."""
    covariance = solution.camera.covariance
    assert covariance is not None
    # null where there is no ray
    (pixels, _, free), (_, _, fixed) = (projection_uncertainty(solution.camera, each) for each in (True, False))
    free_px, fixed_px = (np.where(np.isfinite(std), std, np.array(None)) for std in (free, fixed))
    return {
        **solution.camera.to_dict(),
        "std": dict(zip(solution.camera.parameter_names, covariance.diagonal().clip(0.0) ** 0.5, strict=True)),
        "lens_model": solution.model,
        "monotonic": solution.monotonic,
        **solution.verdict_dict(),
        "rms_px": finite_or_none(solution.rms_px),
        "rms_inliers_px": finite_or_none(solution.rms_inliers_px),
        "projection_uncertainty": {
            "columns_px": pixels[0, :, 0].tolist(),
            "rows_px": pixels[:, 0, 1].tolist(),
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
