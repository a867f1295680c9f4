"""`vbaa demo`: the whole chain on a bundled scene, by the same commands that a user would type."""

from __future__ import annotations

import argparse
import os
import shlex
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError, require_extra
from vbaa_calib.core.files import read_json, write_json
from vbaa_calib.core.folders import make_folder, writing_alone

if TYPE_CHECKING:
    from estimator.table.contacts import ContactTable
    from vbaa_calib.rig import Rig

SCENES = ("demo", "upright_knife", "steep_sphere")


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path("demo"), help="folder for everything (default: demo)")
    parser.add_argument("--scene", choices=SCENES, default="demo", help="which bundled scene")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate, calibrate, estimate, reconstruct, view; then compare with the truth.

    Raises InputError when the folder holds something that is not a demo's, or a demo without `force`.
    """
    started = time.perf_counter()
    out: Path = args.out
    if os.path.isdir(out) and any(out.iterdir()):
        if not (out / "session" / "session.yaml").is_file():
            raise InputError("is not empty and not a demo's folder", where=out, remedy="name another with --out")
        if not args.force:
            raise InputError("exists already", where=out, remedy="give --force to replace it, or another --out")
    elif os.path.lexists(out) and not os.path.isdir(out):
        raise InputError("is a file", where=out, remedy="name a folder with --out")
    make_folder(out)
    with writing_alone(out):
        return _whole_way(args, out, started)


def _whole_way(args: argparse.Namespace, out: Path, started: float) -> dict[str, Any]:
    """Runs the chain's verbs one after the other, with outputs in the folder."""
    require_extra("pyvista", "view")
    from vbaa_calib.cli.main import run_verb
    from viz.render.probe import can_render

    drawable = can_render()
    if not drawable:
        say("no OpenGL here: scene.png is left out; to have it, install libegl1 and libgl1-mesa-dri")
    names = ("session", "rig.json", "contacts.csv", "object.vtp", "scene.png", "scene.html")
    session, rig, contacts, surface, picture, page = (str(out / name) for name in names)
    view = ["view", contacts, "--rig", rig, "--session", session, "--truth", f"{session}/truth.json", "--html", page]
    for command in (
        ["simulate", args.scene, "-o", session],
        ["calibrate", session, "-o", rig],
        ["estimate", session, "--rig", rig, "-o", contacts, "--no-report"],
        ["reconstruct", contacts, "--rig", rig, "-o", surface],
        [*view, "--screenshot", picture] if drawable else view,
    ):
        say(f"\n$ vbaa {shlex.join(command)}")
        begun = time.perf_counter()
        run_verb([*command, "--force"])
        say(f"  ({time.perf_counter() - begun:.1f} s)")
    result = _finish(out, time.perf_counter() - started, args.argv)
    say(f"\neverything is in {out}/: open {out}/report.html and {out}/scene.html")
    return result


def _finish(out: Path, seconds: float, argv: Sequence[str]) -> dict[str, Any]:
    """Write score, table, report.html and summary.json. argv : the demo's command line, for the report."""
    from estimator.table.files import read_contacts
    from vbaa_calib.rig import Rig
    from viz.report.make import Sources, make_report

    rig, contacts = Rig.load(out / "rig.json"), read_contacts(out / "contacts.csv")
    truth = read_json(out / "session" / "truth.json")
    errors = _score(rig, contacts, truth)
    goals = {"distance_rmse_m": 1e3 * 0.02 * rig.antenna.length_m}
    # Name, key of the score, factor, unit, and the error it may have at most. Distance: 2 % of the antenna's length.
    limits = (
        ("contact point", "contact_point_rmse_m", 1e3, "mm", 1.5),
        ("contact distance", "distance_rmse_m", 1e3, "mm", None),
        ("force", "force_rmse_relative", 100.0, "%", 8.0),
        ("force direction", "direction_rmse_rad", 180 / np.pi, "°", 4.0),
        ("stiffness EI", "stiffness_relative_error", 100.0, "%", 2.0),
        ("focal length", "focal_relative_error", 100.0, "%", 0.5),
        ("camera position", "camera_position_error_m", 1e3, "mm", None),
        ("camera rotation", "camera_rotation_error_rad", 180 / np.pi, "°", None),
    )
    rows = [(name, factor * errors[key], unit, goals.get(key, goal)) for name, key, factor, unit, goal in limits]
    say(f"\n{'error against truth':<20}{'':>10}     goal")
    for name, value, unit, goal in rows:
        say(f"{name:<20}{value:>10.3f} {unit:<3} {'' if goal is None else f'≤ {goal:g}'}")
    say(f"{'error² over predicted variance':<31}{errors['nees']:.1f} (1 is honest)")
    say(f"{'frames right':<20}{errors['frames_ok']:>6} of {errors['frames']}")
    session = out / "session"
    sources = Sources(out / "contacts.csv", out / "rig.json", session, session / "truth.json")
    title = f"vbaa demo: {truth.get('scene', 'scene')}"
    make_report(out / "report.html", sources, title=title, argv=argv, summary=rows, force=True)
    result = {"session": str(session), "seconds": round(seconds, 2), **errors}
    write_json(out / "summary.json", result, force=True)
    return result


def _score(rig: Rig, contacts: ContactTable, truth: Mapping[str, Any]) -> dict[str, Any]:
    """Root mean square errors over the located frames, and the calibration's errors. SI units.

    `frames_ok` counts the frames with the right status: located where there is contact, free where not. Force and
    direction are those across the antenna (y, z), the force's error over its true size. `nees` is the mean squared
    error of the contact point over its own covariance, per degree of freedom; 1 is honest.

    truth : truth.json's mapping.
    """
    from scipy.spatial.transform import Rotation

    from vbaa_calib.geometry import Pose
    from viz.scene.truth import true_contacts

    true = true_contacts(contacts, truth)
    touching = np.isfinite(true.distance_m)
    right = np.where(touching, contacts.located, contacts.status == "no_contact")
    both = touching & contacts.located
    force = np.stack([true.force_y_N[both], true.force_z_N[both]], axis=1)
    found = np.stack([contacts.force_y_N[both], contacts.force_z_N[both]], axis=1)
    off = (contacts.point_world_m - true.point_world_m)[both]
    weighted = np.linalg.solve(contacts.covariance_world_m2[both], off[..., None])[..., 0]
    across = force[:, 0] * found[:, 1] - force[:, 1] * found[:, 0]
    matrix, true_matrix = rig.camera.matrix, np.array(truth["camera"]["matrix"])
    T_true = Pose.from_dict(truth["T_antenna_camera"])
    rotation = Rotation.from_matrix(rig.T_antenna_camera.rotation @ T_true.rotation.T).magnitude()

    def rms(values: np.ndarray) -> float:
        known = values[np.isfinite(values)]  # of a rig without a moment sensor not every force is known
        return float(np.sqrt((known**2).mean()))

    return {
        "frames": len(contacts),
        "frames_ok": int(right.sum()),
        "contact_point_rmse_m": rms(np.linalg.norm(off, axis=1)),
        "distance_rmse_m": rms((contacts.distance_m - true.distance_m)[both]),
        "force_rmse_relative": rms(np.linalg.norm(found - force, axis=1) / np.linalg.norm(force, axis=1)),
        "direction_rmse_rad": rms(np.arctan2(across, (force * found).sum(axis=1))),
        "stiffness_relative_error": abs(rig.antenna.stiffness_Nm2 / truth["stiffness_Nm2"] - 1),
        "focal_relative_error": float(np.abs(np.diag(matrix)[:2] / np.diag(true_matrix)[:2] - 1).max()),
        "camera_position_error_m": float(np.linalg.norm(rig.T_antenna_camera.translation_m - T_true.translation_m)),
        "camera_rotation_error_rad": float(rotation),
        "nees": float((off * weighted).sum(axis=1).mean() / 3),
    }
