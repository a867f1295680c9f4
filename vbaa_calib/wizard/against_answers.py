"""Consistency of the pictures with the typed entries on jig, camera and material."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from vbaa_calib.antenna.materials import MATERIALS
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.calibrate.antenna.session_rig import bow_std_per_m, nominal_parameters
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.calibrate.pose.board_pose import solve_board_pose
from vbaa_calib.calibrate.pose.fusion import fused
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError
from vbaa_calib.core.images import read_picture
from vbaa_calib.core.polyline import arc_lengths, normals
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.whisker.corridor import free_curve
from vbaa_calib.geometry import Pose
from vbaa_calib.session import Still
from vbaa_calib.session.jig import jig_alternatives, jig_doubts
from vbaa_calib.wizard.questions import DIRECTIONS, keeps_jig, typed
from vbaa_calib.wizard.session_state import SessionState


@dataclass(frozen=True)
class _ContradictionSettings:
    """Thresholds from which a picture contradicts what was typed."""

    moved_px: float = 2.0  # median shift of the corners from which the jig has moved
    times_lens_rms: float = 4.0  # scatter of the jig's corners, over that of the lens' own pictures
    least_rms_px: float = 1.0  # least scatter from which it is reported
    in_view: float = 0.25  # least share of the antenna in the picture
    distance_ratio: float = 1.3  # ratio of the camera's distance as seen to that typed, to 20 %
    contradicts_std: float = 2.0  # of the free antenna from which it contradicts an answer: probability 1e-3 by chance
    fits_std: float = 1.3  # standard deviations up to which a corrected answer fits
    softer: tuple[float, ...] = (0.5, 1.0, 3.0)  # factors by which EI may be smaller: another material or diameter
    other_material: float = 1.5  # ratio of Young's moduli from which on the sag tells materials apart
    sag_std: float = 4.0  # standard deviation of the logarithm of EI over mass by the sag
    hidden_std: float = 0.03  # standard deviation of the unseen share of the free antenna
    alike_std: float = 0.8  # entries between which the picture cannot decide


_LIMITS = _ContradictionSettings()


def jig_moved(state: SessionState, corners_px: np.ndarray, ids: np.ndarray) -> str:
    """Distance of corners (N, 2) px with ids (N,) from those in the jig's first picture, in words ("by 59 px"); ""
    if they are at rest."""
    taken = state.views("plane")
    if not taken:
        return ""
    _, here, there = np.intersect1d(ids, taken[0].ids, return_indices=True)
    off_px = np.linalg.norm(corners_px[here] - taken[0].corners_px[there], axis=-1)
    if len(off_px) and np.median(off_px) <= _LIMITS.moved_px:
        return ""
    return f"by {np.median(off_px):.0f} px" if len(off_px) else "wholly"


def jig_refusal(state: SessionState, view: BoardView, fast: bool) -> str:
    """The reason why a picture cannot be of the board in its jig; "" if it can. fast : without solving for the
    board's pose."""
    if how := jig_moved(state, view.corners_px, view.ids):
        first = state.views("plane")[0].name
        moved = f"the board has moved {how} since {first}, and the jig stands still"
        return f"{moved}: is it of the jig? If {first} is not, type redo"
    if fast:
        return ""
    lens = state.lens()
    try:
        board = solve_board_pose([view], lens.board_shape, lens.camera)
    except VbaaError as error:
        return f"the lens does not explain this picture of the board: {error}"
    if board.rms_px > max(_LIMITS.times_lens_rms * lens.rms_px, _LIMITS.least_rms_px):
        return (
            f"its corners are {board.rms_px:.2f} px off this lens (its own pictures {lens.rms_px:.2f} px): "
            "has focus, zoom or the board changed?"
        )
    jig = state.session.T_antenna_board
    assert jig is not None
    share = _share_in_view(state, jig @ board.T_camera_board.inverse())
    if share >= _LIMITS.in_view:
        return ""
    fitting = [
        entry
        for _, entry, pose in _others(state, board.T_camera_board)
        if _share_in_view(state, pose) > 1 - _LIMITS.in_view and pose.translation_m[2] > 0
    ]
    remedy = f"{' or '.join(fitting[:3])} would put it there. C" if fitting else "c"
    return (
        f"by what was typed about the jig {100 * share:.0f} % of the antenna would be in the picture; {remedy}orrect "
        "jig_translation_mm, jig_board_x, jig_board_y or board_thickness_mm: type `key = value`"
    )


def _share_in_view(state: SessionState, T_antenna_camera: Pose) -> float:
    """Fraction of the straight antenna that is in the picture."""
    camera, along = state.lens().camera, np.linspace(0.0, state.session.antenna.length_m, 41)
    pixels, valid = camera.project(T_antenna_camera.inverse() @ np.pad(along[:, None], ((0, 0), (0, 2))))
    return float(np.mean(valid & camera.in_picture(pixels)))


def _others(state: SessionState, T_camera_board: Pose) -> Iterator[tuple[str, str, Pose]]:
    """Alternative entries on the jig: for each the wrong entry, the corrected one, and T_antenna_camera with it."""
    session, answers = state.session, state.store.journal.answers
    jig, board = session.T_antenna_board, session.board
    if jig is None:
        return
    # from the board's first corner to where that is with the board turned round
    opposite_m = board.outline_m[0] + board.outline_m[2]
    turn = Pose.from_rotvec(np.radians(answers.get("jig_turn_deg") or [0.0] * 3), np.zeros(3)).rotation
    for words, other in jig_alternatives(jig, opposite_m, board.thickness_m):
        if words.endswith("taken for m") and not keeps_jig(answers):
            continue  # answers are in mm
        pose, normal = other @ T_camera_board.inverse(), other.rotation[:, 2]
        back_m = np.round(other.translation_m + board.thickness_m * normal, 6)
        thickness_m = board.thickness_m + float((jig.translation_m - other.translation_m) @ normal)
        axes = [
            next((name for name, way in DIRECTIONS.items() if np.allclose(turn.T @ column, way, atol=1e-6)), "")
            for column in other.rotation.T[:2]
        ]
        if keeps_jig(answers):
            entries = {"board.thickness_m": f"{thickness_m:g}"}
            if "thickness" not in words:
                entries = {f"jig.T_antenna_board.{key}": typed(value) for key, value in other.to_dict().items()}
                entries["jig.T_antenna_board.translation_m"] = typed(back_m.tolist())
            words += ", in session.yaml"
        elif "thickness" in words:
            entries = {"board_thickness_mm": f"{1e3 * thickness_m:g}"}
        else:
            entries = {
                "jig_translation_mm": typed((1e3 * back_m).tolist()),
                "jig_board_x": axes[0],
                "jig_board_y": axes[1],
            }
        if all(entries.values()):
            changed = [f"`{key} = {now}`" for key, now in entries.items() if now != typed(answers.get(key, ""))]
            yield words, f"{' and '.join(changed)} ({words})", pose


def camera_place(state: SessionState, T_antenna_camera: Pose) -> tuple[str, list[Diagnosis]]:
    """The camera's position relative to the antenna in words, from plane C and the typed entries, and what
    contradicts these or is impossible."""
    answers, session = state.store.journal.answers, state.session
    doubts = [] if session.T_antenna_board is None else jig_doubts(session.T_antenna_board, session.antenna.length_m)
    if T_antenna_camera.translation_m[2] < 0:
        words = (
            f"the camera is behind plane C, at z = {1e3 * T_antenna_camera.translation_m[2]:.0f} mm: the antenna's z "
            "axis points away from it"
        )
        remedy = "is jig_board_x or jig_board_y turned round? If z does point away from the camera, all is well"
        doubts.append(Diagnosis("camera_behind_plane", words, remedy))
    middle = np.array([0.5 * session.antenna.length_m, 0.0, 0.0])
    seen_mm = 1e3 * float(np.linalg.norm(T_antenna_camera.translation_m - middle))
    words = f"the camera is {seen_mm:.0f} mm from the antenna's middle"
    if (typed_mm := answers.get("camera_distance_mm")) is None:
        return words, doubts
    words += f", {typed_mm:g} mm was typed"
    if not 1 / _LIMITS.distance_ratio < seen_mm / typed_mm < _LIMITS.distance_ratio:
        remedy = f"check jig, square size and antenna_length_mm; or type `camera_distance_mm = {seen_mm:.0f}`"
        doubts.append(Diagnosis("camera_distance", words, f"{remedy} if that is so"))
    return words, doubts


def _misfit_std(state: SessionState, seen: Observation, T_antenna_camera: Pose) -> float:
    """`_misfit_of` at the best of the possible stiffnesses: an antenna of another material sags differently."""
    nominal = nominal_parameters(state.session.antenna)
    stiffness = np.eye(len(nominal))[6]  # its logarithm
    softer = (nominal - np.log(factor) * stiffness for factor in _LIMITS.softer)
    return min(_misfit_of(state, seen, T_antenna_camera, parameters) for parameters in softer)


def _misfit_of(state: SessionState, seen: Observation, T_antenna_camera: Pose, parameters: np.ndarray) -> float:
    """Distance of the detected free antenna from its prediction under a camera pose, in standard deviations of a
    careful assembly: clamp offset and angle, bow, length, and the part that is not visible."""
    antenna, camera = state.session.antenna, state.lens().camera
    shape = free_curve(parameters, antenna.length_m, seen.gravity_m_s2, antenna.taper).points_m[0]
    at_m = np.linspace(0.0, antenna.length_m, 201)
    in_camera = T_antenna_camera.inverse() @ np.stack(
        [np.interp(at_m, arc_lengths(shape), each) for each in shape.T], axis=1
    )
    pixels, valid = camera.project(in_camera)
    if not valid.all() or not np.diff(pixels, axis=0).any(axis=1).all():
        return np.inf
    px_per_m = camera.matrix[0, 0] / in_camera[:, 2]
    apart = seen.points_px[:, None] - pixels
    nearest = np.linalg.norm(apart, axis=-1).argmin(axis=1)
    if np.ptp(nearest) < len(at_m) / 2:
        return np.inf
    lateral_m = (apart[np.arange(len(nearest)), nearest] * normals(pixels)[nearest]).sum(axis=1) / px_per_m[nearest]
    std = (
        0.5 * bow_std_per_m(antenna.length_m),
        AntennaSettings.clamp_angle_std_rad,
        AntennaSettings.clamp_offset_std_m,
    )
    off = np.polyfit(at_m[nearest], lateral_m, 2) / std
    if np.isfinite(seen.tip_std_px):
        end = pixels[-1] - pixels[-2]
        short_m = (seen.tip_px - pixels[-1]) @ end / np.linalg.norm(end) / px_per_m[-1]
        off = np.append(
            off,
            short_m
            / np.hypot(AntennaSettings.clamp_offset_std_m, antenna.tip_std_m or AntennaSettings.clamp_offset_std_m),
        )
    off = np.append(off, (1.0 - np.ptp(nearest) / (len(at_m) - 1)) / _LIMITS.hidden_std)
    return float(np.sqrt(off @ off / len(off)))


def entries_that_show_it(state: SessionState, still: Still, step: str, image: np.ndarray) -> str:
    """Alternative entries on material or jig with which the free antenna is found in a picture where they predict
    it, in words; "" without any. Materials come first."""
    board, antenna = state.plane().jig, state.session.antenna
    of_materials, tried = list[tuple[float, str]](), [antenna.youngs_modulus_Pa]
    for other in MATERIALS.values() if antenna.material else ():
        modulus_Pa = other.youngs_modulus_Pa
        if min(abs(np.log(modulus_Pa / one)) for one in tried) > np.log(_LIMITS.other_material):
            tried.append(modulus_Pa)
            another = replace(antenna, youngs_modulus_Pa=modulus_Pa, density_kg_m3=other.density_kg_m3)
            with suppress(InputError):
                seen, pose = state.observe(still, step, image, antenna=another), fused(state.plane().estimates)
                of_materials.append((_misfit_of(state, seen, pose, nominal_parameters(another)), other.name))
    if of_materials and (best := min(of_materials)[0]) < _LIMITS.fits_std:
        alike = [name for misfit, name in of_materials if misfit < best + _LIMITS.alike_std]
        return " or ".join(f"`material = {name}`" for name in alike[:3])
    found = list[tuple[bool, float, str]]()
    for _, entry, pose in _others(state, board.T_camera_board) if board is not None else ():
        if _share_in_view(state, pose) > 1 - _LIMITS.in_view:
            with suppress(InputError):
                misfit = _misfit_std(state, state.observe(still, step, image, pose), pose)
                found.append((pose.translation_m[2] < 0, misfit, entry))
    most = min(_LIMITS.fits_std, min((misfit for _, misfit, _ in found), default=0.0) + _LIMITS.alike_std)
    # the camera is seldom behind plane C; else the commoner first
    close = sorted((one for one in found if one[1] < most), key=itemgetter(0))
    return " or ".join(entry for *_, entry in close[:3])


def antenna_diagnoses(state: SessionState, together: bool = True) -> list[Diagnosis]:
    """Diagnoses of jig, material, the antenna's pictures and their readings; materials first.

    together : also by the solution of all pictures, which needs more than one.
    """
    first = _first_doubts(state)
    if not together:
        return first
    found = state.static_frame_diagnoses()
    if any(one.name.startswith("antenna_contradicts") for one in first):
        found = [one for one in found if one.name != "antenna_contradicts_plane"]
    elif not any(one.grave or "material" in one.name for one in found):
        first += _material_by_sag(state)
    return [*first, *found]


def _material_by_sag(state: SessionState) -> list[Diagnosis]:
    """Diagnosis of a material for which the free antenna sags too much or too little (EI over mass), with the
    materials that would fit."""
    antenna, joint = state.session.antenna, state.joint()
    ratio = np.array([1.0, -1.0])
    log_ei_mass = joint.parameters[ANTENNA][6:8] @ ratio
    std = float(np.sqrt(ratio @ joint.covariance[ANTENNA, ANTENNA][6:8, 6:8] @ ratio))
    known = MATERIALS.get(antenna.material or "")
    factor = float(np.exp(log_ei_mass - nominal_parameters(antenna)[6:8] @ ratio))
    if (
        known is None
        or std > 0.2
        or any(
            known.has_modulus(antenna.youngs_modulus_Pa * factor * np.exp(way * _LIMITS.sag_std * std))
            for way in (-1, 0, 1)
        )
    ):
        return []
    modulus_Pa = factor * antenna.youngs_modulus_Pa
    names = [
        one.name
        for one in MATERIALS.values()
        if one.has_modulus(modulus_Pa * one.density_kg_m3 / antenna.density_kg_m3)
    ]
    words = f"the free antenna sags as if {known.name} had {1e-9 * modulus_Pa:.3g} GPa instead of "
    words += f"{1e-9 * antenna.youngs_modulus_Pa:.3g}"
    remedy = f"is it {' or '.join(names)}? Type `material = …`; " if names else ""
    remedy += f"or is it {1e3 * antenna.diameter_m * np.sqrt(factor):.3g} mm thick, or does gravity point elsewhere?"
    return [Diagnosis("material_by_sag", words, remedy, "wrong")]


def _first_doubts(state: SessionState) -> list[Diagnosis]:
    """Diagnoses of material and jig that need no solution from all pictures."""
    antenna, taken = state.session.antenna, state.taken("noload")
    found = antenna.material_doubts
    board, jig = state.plane().jig if taken else None, state.session.T_antenna_board
    if board is None or jig is None:
        return found

    def made() -> list[Diagnosis]:
        seen, image = state.observation("noload", taken[0]), read_picture(state.store.path(taken[0]))
        misfit = _misfit_std(state, seen, jig @ board.T_camera_board.inverse())
        wrong = misfit > _LIMITS.contradicts_std
        entries = entries_that_show_it(state, seen.still, "noload", image) if wrong else ""
        words = (
            f"the free antenna is {misfit:.1f} standard deviations from where the answers about jig and material put it"
        )
        remedy = f"it is where {entries} puts it: type that"
        name = "antenna_contradicts_material" if "material" in entries else "antenna_contradicts_jig"
        return [Diagnosis(name, words, remedy, "wrong")] if entries else []

    return [*found, *state.cached("jig", state.inputs("lens", "plane", "noload"), made)]
