"""`assess`: everything that `vbaa check` reports about a rig, alone or against new pictures."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from targets.board import corner_points
from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.calibrate.antenna.session_rig import ExpectedAntenna, observe
from vbaa_calib.calibrate.lens.board_shape import SHAPE_NAMES, BoardShape
from vbaa_calib.calibrate.lens.uncertainty import pixel_grid, projection_uncertainty
from vbaa_calib.calibrate.pose.settings import PoseSettings
from vbaa_calib.core.arrays import check_angle
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import at, read_json, sha256
from vbaa_calib.core.images import list_images
from vbaa_calib.detect.board.board_file import with_ids
from vbaa_calib.detect.board.corners import detect_files
from vbaa_calib.geometry.covariance import largest_std
from vbaa_calib.rig import POSE_PARAMETERS, Rig
from vbaa_calib.session import (
    NominalAntenna,
    Session,
    Still,
    check_pictures,
    load_session,
    read_loads,
    read_noload,
    read_pose,
)

from .antenna import CheckedStill, check_antenna, check_stills
from .boards import check_lens, check_pose
from .finding import FAILS, HOLDS, LOOK, UNANSWERED, Finding, worst
from .settings import CheckSettings


def _rig_maps(rig: Rig) -> dict[str, Any]:
    """Maps of standard deviations for check.json: of the projection, net of camera rotation, and on plane C."""
    camera, projection = rig.camera, None
    if camera.covariance is not None:
        pixels, _, std_px = projection_uncertainty(camera, compensated=True, grid=CheckSettings.map_grid)
        projection = _map_document(pixels, std_px, "px")
    pixels, std_mm = _plane_map(rig)
    along = zip(*_along(rig), strict=True)
    return {
        "projection": projection,
        "plane": _map_document(pixels, std_mm, "mm"),
        "has_ray": np.asarray(camera.unproject(pixels)[1]).tolist(),
        "along_antenna": [
            {"arclength_m": float(s), "u_px": _rounded(u), "v_px": _rounded(v), "std_mm": _rounded(1e3 * std)}
            for s, (u, v), std in along
        ],
    }


def _plane_map(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (R, C, 2) on a grid, and the worst-direction standard deviation (R, C) mm of the point on plane C seen
    there; NaN where that is beyond the antenna's reach."""
    pixels = pixel_grid(rig.camera.image_size, CheckSettings.map_grid)
    points, seen = rig.on_plane_C(pixels)
    near = seen & (np.linalg.norm(np.nan_to_num(points), axis=-1) <= CheckSettings.reach_lengths * rig.antenna.length_m)
    return pixels, np.where(near, 1e3 * _plane_std_m(rig, pixels), np.nan)


def _map_document(pixels: np.ndarray, std: np.ndarray, unit: str) -> dict[str, Any]:
    known = std[np.isfinite(std)]
    return {
        "unit": unit,
        "columns_px": pixels[0, :, 0].tolist(),
        "rows_px": pixels[:, 0, 1].tolist(),
        "std": [[_rounded(value) for value in row] for row in std.tolist()],
        "median": float(np.median(known)) if len(known) else None,
        "largest": float(known.max()) if len(known) else None,
    }


def _along(rig: Rig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Along the antenna's axis: arc lengths (S,) m, pixels (S, 2), NaN outside the picture, and standard deviations
    (S,) m."""
    s = rig.antenna.length_m * np.array(CheckSettings.along)
    pixels, seen = rig.camera.project(rig.T_antenna_camera.inverse() @ (s[:, None] * np.array([1.0, 0.0, 0.0])))
    inside = seen & rig.camera.in_picture(pixels)
    std = np.full(len(s), np.nan)
    std[inside] = _plane_std_m(rig, pixels[inside])
    return s, np.where(inside[:, None], pixels, np.nan), std


def _plane_std_m(rig: Rig, pixels: np.ndarray) -> np.ndarray:
    jacobian = rig.plane_C_jacobian(pixels)
    return largest_std(jacobian @ rig.plane_covariance() @ np.swapaxes(jacobian, -1, -2))


def _rounded(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None


def _number_at(data: Any, *keys: str) -> float | None:
    """The finite number at a path of keys; None where there is none."""
    value = at(data, *keys)
    usable = isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    return float(value) if usable else None


def _rig_numbers(rig: Rig, nominal_Nm2: float | None) -> dict[str, Any]:
    """Numbers of camera, lens, antenna (EI and the nominal EI where known) and sensor, with standard deviations."""
    camera, antenna, sensor = rig.camera, rig.antenna, rig.moment_sensor
    lens_std = None if camera.covariance is None else np.sqrt(np.diag(camera.covariance).clip(0.0)).tolist()
    pose_std = [rig.std(name) for name in POSE_PARAMETERS]
    region = camera.valid_region()
    shape = zip(ANTENNA_PARAMETERS[:6], antenna.parameters[:6].tolist(), strict=True)
    return {
        "lens": {
            "model": camera.model,
            "image_size": list(camera.image_size),
            "parameters": list(camera.parameter_names),
            "values": camera.parameters.tolist(),
            "std": lens_std,
            "image_fraction": region.image_fraction,
            "half_angle_rad": region.half_angle_rad,
        },
        "camera_pose": {
            "translation_m": rig.T_antenna_camera.translation_m.tolist(),
            "translation_std_m": pose_std[3:],
            "view_axis": rig.T_antenna_camera.rotation[:, 2].tolist(),
            "rotation_std_rad": pose_std[:3],
        },
        "antenna": {
            "length_m": antenna.length_m,
            "diameter_m": antenna.diameter_m,
            "stiffness_Nm2": antenna.stiffness_Nm2,
            "stiffness_std_Nm2": antenna.stiffness_Nm2 * rig.std("log_stiffness_Nm2"),
            "nominal_stiffness_Nm2": nominal_Nm2,
            "mass_per_length_kg_m": antenna.mass_per_length_kg_m,
            "mass_per_length_std_kg_m": antenna.mass_per_length_kg_m * rig.std("log_mass_per_length_kg_m"),
            "free_shape": [{"name": name, "value": value, "std": rig.std(name)} for name, value in shape],
        },
        "moment_sensor": {
            "gain": sensor.gain,
            "gain_std": rig.std("moment_gain"),
            "offset_Nm": sensor.offset_Nm,
            "offset_std_Nm": rig.std("moment_offset_Nm"),
            "std_Nm": sensor.std_Nm,
        }
        if sensor.exists
        else None,
    }


def _rig_findings(rig: Rig, quality: Mapping[str, Any], nominal_Nm2: float | None) -> list[Finding]:
    """Findings on the questions that rig.json answers without new pictures."""
    # the calibration repeats what its lens' verdict says
    lines = dict.fromkeys(line for at_ in ((), ("lens",)) for line in _listed(at(quality, *at_, "warnings")))
    noted = {str(one) for one in rig.verdict.findings if one.severity == "note"}
    remedy = "do what they say, then calibrate again"
    wrong = rig.verdict.severity == "wrong" or at(quality, "lens", "grade") == "do not use"
    limits = (0, 0 if wrong else np.inf)
    doubts = _graded("doubts", len(lines.keys() - noted), limits, "; ".join(lines) or "none", remedy)
    doubts = doubts if quality else Finding("doubts", UNANSWERED, "not recorded")
    name, ratio = "planar_ambiguity", _number_at(quality, "plane_second_solution_ratio")
    if ratio is not None:
        remedy = "take the board in the jig from a steeper angle, calibrate again"
        words = f"its second pose fits {ratio:.1f} times worse"
        second = _graded(name, -ratio, (-PoseSettings.ambiguous, np.inf), words, remedy)
    elif _number_at(quality, "plane_rms_px") is None:
        second = Finding(name, UNANSWERED, "not recorded")
    else:
        second = Finding(name, HOLDS, "no: only one pose of the board fits the picture")
    sensor = [_sensor(rig)] if rig.moment_sensor.exists else []
    return [_plane_c(rig), _lens_region(rig), _stiffness(rig, nominal_Nm2), *sensor, second, doubts]


def _listed(found: Any) -> list[str]:
    return [str(line) for line in found] if isinstance(found, list) else []


def _graded(name: str, value: float, limits: tuple[float, float], words: str, remedy: str) -> Finding:
    """A finding that grades a standard deviation by the limits from which it is `LOOK` and `FAILS`."""
    look, fail = limits
    level = HOLDS if value <= look else LOOK if value <= fail else FAILS
    return Finding(name, level, words, None if level == HOLDS else remedy)


def _plane_c(rig: Rig) -> Finding:
    if rig.camera.covariance is None:
        words = "the lens has no covariance in rig.json: its share of the uncertainty on plane C is not known"
        return Finding("plane_c", LOOK, words, "calibrate again with vbaa calibrate")
    *_, std_m = _along(rig)
    seen = np.isfinite(std_m)
    if not seen.any():
        words = "the camera does not see the antenna's axis"
        return Finding("plane_c", FAILS, words, "turn the camera to the antenna, then calibrate again")
    largest_mm = 1e3 * float(std_m[seen].max())
    std = np.sqrt(np.diag(rig.covariance)[:6])
    turned_m = float(std[:3].max()) * float(np.linalg.norm(rig.T_antenna_camera.translation_m))
    remedy = "add pictures of the board near the antenna, tilted by 30 to 45 degrees"
    if 1e3 * max(turned_m, float(std[3:].max())) > CheckSettings.plane_look_mm / 2:
        remedy = "know the jig's place and angles, and the print's size, better, or take a sweep of the joints besides"
    words = f"to {largest_mm:.3f} mm (1 std, worst direction) or better along the antenna"
    found = _graded("plane_c", largest_mm, (CheckSettings.plane_look_mm, CheckSettings.plane_fail_mm), words, remedy)
    if seen.all():
        return found
    words += f"; {int((~seen).sum())} of {len(seen)} places along it are outside the picture"
    return Finding("plane_c", found.level if found.is_bad else LOOK, words, remedy)


def _lens_region(rig: Rig) -> Finding:
    share = rig.camera.valid_region().image_fraction
    if share == 1.0:
        return Finding("lens_region", HOLDS, "the lens maps the whole picture one to one")
    rays = np.asarray(rig.camera.unproject(pixel_grid(rig.camera.image_size, CheckSettings.map_grid))[1])
    words = f"in {100 * share:.1f} % of the picture; {int((~rays).sum())} of {rays.size} places in the rest have no ray"
    return Finding("lens_region", LOOK, words, "add views of the board near the picture's border, calibrate again")


def _stiffness(rig: Rig, nominal_Nm2: float | None) -> Finding:
    name, relative = "stiffness_known", rig.std("log_stiffness_Nm2")
    limits = CheckSettings.stiffness_look, CheckSettings.stiffness_fail
    remedy = "add known loads, heavier or further out"
    words = f"EI = {rig.antenna.stiffness_Nm2:.5g} N·m² ± {100 * relative:.2g} %"
    if nominal_Nm2 is None or nominal_Nm2 <= 0:
        return _graded(name, relative, limits, words + "; the nominal E·πd⁴/64 is not recorded", remedy)
    off = rig.antenna.stiffness_Nm2 / nominal_Nm2 - 1
    words += f", {100 * off:+.1f} % from E·πd⁴/64 = {nominal_Nm2:.4g} N·m²"
    found = _graded(name, relative, limits, words, remedy)
    if abs(off) > max(CheckSettings.nominal_look, 3 * relative):
        remedy = "check the antenna's diameter, the loads and their unit"
        return Finding(name, found.level if found.is_bad else LOOK, words, remedy)
    return found


def _sensor(rig: Rig) -> Finding:
    sensor, std = rig.moment_sensor, rig.std("moment_gain")
    words = (
        f"gain {sensor.gain:.4f} ± {std:.2g}, offset {1e3 * sensor.offset_Nm:.3f} ± "
        f"{1e3 * rig.std('moment_offset_Nm'):.2g} mN·m"
    )
    # a sensor of several axes reads the right-handed moment, the negative
    if sensor.gain <= 0 and rig.wrench_sensor is None:
        return Finding("sensor_known", FAILS, words, "its sign is turned round: check the wiring, calibrate again")
    remedy = "add known loads that leave plane C (force_z_N)"
    return _graded(
        "sensor_known", std / abs(sensor.gain), (CheckSettings.gain_look, CheckSettings.gain_fail), words, remedy
    )


_PARTS = ("intrinsics", "plane", "noload", "loads")  # folders of a session that a rig is checked against
_NO_JIG = "session.yaml does not say where the jig is"  # why the camera's pose is left open


@dataclass(frozen=True, eq=False)
class Assessment:
    """Result of `assess`: findings, numbers and maps."""

    rig: Rig
    path: Path
    findings: tuple[Finding, ...]  # on the rig by itself
    quality: Mapping[str, Any]  # of rig.json, as it is there
    session_findings: tuple[Finding, ...]  # on new pictures
    session: Mapping[str, Any] | None  # the entry of check.json; None without new pictures
    nominal_Nm2: float | None = None  # E·πd⁴/64, from rig.json or the session
    own_pictures: bool = False  # the session's pictures are those of the calibration

    @property
    def answers(self) -> list[Finding]:
        """All findings, those on new pictures first."""
        return [*self.session_findings, *self.findings]

    @property
    def verdict(self) -> str:
        """The worst level of all answered questions."""
        return worst(self.answers)

    @property
    def headline(self) -> str:
        """The verdict in a sentence."""
        if self.own_pictures and self.verdict == HOLDS:
            return "This rig fits its calibration's pictures."
        return {
            HOLDS: "This rig holds.",
            LOOK: "Look at this rig before you rely on it.",
            FAILS: "This rig does not hold.",
            UNANSWERED: "There is nothing to judge this rig by.",
        }[self.verdict]

    @property
    def words(self) -> str:
        """The verdict, and the questions with another answer than "holds"."""
        sentences = [self.headline]
        for level, start in ((FAILS, "Does not hold"), (LOOK, "Look at")):
            found = [
                f"{one.question} {one.words[:1].upper()}{one.words[1:]}." for one in self.answers if one.level == level
            ]
            sentences += [f"{start}: {' '.join(found)}"] if found else []
        if self.session is None:
            sentences.append("Judged by rig.json alone; new pictures show whether the rig is still valid.")
        if self.own_pictures:
            sentences.append("These are the calibration's own pictures; new ones show whether the rig is still valid.")
        return " ".join(sentences)

    def to_dict(self) -> dict[str, Any]:
        """The document check.json, from which the report is made."""
        return {
            "schema": "vbaa.check/1",
            "rig": str(self.path),
            "verdict": self.verdict,
            "headline": self.headline,
            "words": self.words,
            "findings": [finding.to_dict() for finding in self.findings],
            "numbers": _rig_numbers(self.rig, self.nominal_Nm2),
            "maps": _rig_maps(self.rig),
            "quality": dict(self.quality),
            "session_findings": [finding.to_dict() for finding in self.session_findings],
            "session": None if self.session is None else dict(self.session),
            "own_pictures": self.own_pictures,
        }


def assess(
    path: Path,
    session_root: Path | None = None,
    board: Path | None = None,
    free: Still | None = None,
    camera: str | None = None,
) -> Assessment:
    """Judge a rig.json by itself, and against the pictures of a session or new ones.

    New pictures replace the session's; it then only describes jig and board. Without a session rig.json's own record
    describes them.

    board, free : new pictures, of the board in its jig and of the free antenna with the readings at it.
    camera : of a rig of several cameras, the one that is judged, by its pictures; the first by default.

    Raises InputError for a broken rig or session, pictures of another size than the lens', a session without any of
    `_PARTS`, a new picture that the rig was calibrated from, and a camera that the rig does not have.
    """
    path = Path(path)
    data = read_json(path)
    rig, quality = Rig.from_dict(data, path), data.get("quality", {})
    session = None if session_root is None else load_session(Path(session_root))
    if camera is not None and camera != rig.camera_name:
        if camera not in rig.others:
            raise InputError(f"no camera {camera}", where=path, remedy=f"it has {', '.join(rig.cameras)}")
        rig, quality = rig.others[camera], {}  # what is recorded of the pictures is the first camera's
    if session is not None and session.cameras:
        if rig.camera_name not in session.cameras:
            remedy = f"it has {', '.join(session.cameras)}"
            raise InputError(f"no camera {rig.camera_name}", where=session.root / "session.yaml", remedy=remedy)
        session = session.of_camera(rig.camera_name)
    nominal = _number_at(quality, "antenna", "nominal_stiffness_Nm2")
    if nominal is None and session is not None:
        nominal = session.antenna.stiffness_Nm2
    own = _rig_findings(rig, quality, nominal)
    recorded = at(data, "inputs_sha256")
    used = set(recorded.values()) if isinstance(recorded, Mapping) else set()
    if session is not None:
        for name in ("length_m", "diameter_m"):
            own_m, other_m = getattr(rig.antenna, name), getattr(session.antenna, name)
            if abs(own_m - other_m) > 1e-3 * own_m:
                what, where = f"antenna.{name} is {other_m:g}, the rig's {own_m:g}", session.root / "session.yaml"
                raise InputError(what, where=where, remedy="check a rig with its own antenna")
    new = [picture for picture in (board, None if free is None else free.image) if picture is not None]
    inputs = None if session is None or new else _from_session(session)
    if new:
        _refuse_calibration_pictures(used, new, path)
        no_jig = _NO_JIG if session else "rig.json does not record the jig: name its session"
        inputs = _from_pictures(session or _recorded_session(data, rig, path), board, free, no_jig)
    found, document = ((), None) if inputs is None else _check_pictures(rig, quality, inputs)
    pictures = [] if inputs is None else inputs.pictures
    its_own = bool(pictures) and all(sha256(picture) in used for picture in pictures)
    return Assessment(rig, path, tuple(own), quality, found, document, nominal, its_own)


@dataclass(frozen=True, eq=False)
class _Inputs:
    """The pictures that a rig is checked against, with the session data needed to read them."""

    session: Session  # board, jig, antenna and gravity; nothing more is read from its folder
    parts: tuple[str, ...]
    boards: Mapping[str, Sequence[Path]]  # part → its pictures
    stills: Sequence[Still]  # of the free and the loaded antenna; `moment_Nm` NaN where not read
    no_jig: str = _NO_JIG  # why the jig's place is not known, where it is not

    @property
    def pictures(self) -> list[Path]:
        boards = [path for paths in self.boards.values() for path in paths]
        return boards + [still.image for still in self.stills if still.image is not None]


def _from_session(session: Session) -> _Inputs:
    parts = tuple(part for part in _PARTS if (session.root / part).exists())
    if not parts:
        what = f"has none of {', '.join(_PARTS)}"
        raise InputError(what, where=session.root, remedy="one picture in plane/ and one in noload/ will do")
    noload = read_noload(session) if "noload" in parts else []
    loads = read_loads(session) if "loads" in parts else []
    boards = {part: list_images(session.folder(part)) for part in _PARTS[:2] if part in parts}
    return _Inputs(session, parts, boards, [*noload, *loads])


def _from_pictures(session: Session, board: Path | None, free: Still | None, no_jig: str) -> _Inputs:
    """The new pictures, with the session that describes what is in them. Raises InputError for impossible readings."""
    boards = {} if board is None else {"plane": [board]}
    stills = [] if free is None else [free]
    for still in stills:
        check_angle(still.pan_rad, "pan_rad")
        check_angle(still.tilt_rad, "tilt_rad")
        if math.isinf(still.moment_Nm):
            what, remedy = f"moment_Nm is {still.moment_Nm:g}", "give the sensor's reading in N·m, or leave it"
            raise InputError(what, remedy=remedy)
    return _Inputs(session, (*boards, *(["noload"] if stills else [])), boards, stills, no_jig)


def _recorded_session(document: Mapping[str, Any], rig: Rig, path: Path) -> Session:
    """A session with board and jig as rig.json records them and the rest from the rig; the antenna's material is
    unknown."""
    board, jig = at(document, "quality", "lens", "board"), at(document, "quality", "jig")
    remedy = "name the session that the rig was calibrated from: `vbaa check rig.json SESSION --jig …`"
    if board is None:
        raise InputError("quality.lens.board is not recorded", where=path, remedy=remedy)
    return Session(
        root=path,
        board=with_ids(board, path, "quality.lens.board", remedy),
        antenna=NominalAntenna(
            rig.antenna.length_m,
            rig.antenna.diameter_m,
            math.nan,
            math.nan,
            profile=rig.antenna.profile,
            stiffness_profile=rig.antenna.stiffness_profile,
        ),
        T_antenna_board=jig and read_pose(at(jig, "T_antenna_board"), path, "quality.jig.T_antenna_board"),
        kinematics=rig.kinematics,
        gravity_world_m_s2=rig.gravity_world_m_s2,
        moment_std_Nm=rig.moment_sensor.std_Nm,
    )


def _refuse_calibration_pictures(used: Collection[str], new: Sequence[Path], path: Path) -> None:
    """Raises InputError for pictures that the rig was calibrated from, because these fit whatever has changed since.
    used : SHA-256 sums of the calibration's pictures."""
    for picture in new:
        if picture.is_file() and sha256(picture) in used:
            what = f"is one of the pictures that {path} was calibrated from"
            raise InputError(what, where=picture, remedy="take a new one: an old one cannot show what has changed")


def _check_pictures(
    rig: Rig, quality: Mapping[str, Any], inputs: _Inputs
) -> tuple[tuple[Finding, ...], dict[str, Any]]:
    """Checks the lens, then the camera's pose, then antenna and sensor, each with the changes found before it."""
    session, parts = inputs.session, inputs.parts
    check_pictures(progress(inputs.pictures, "reading the pictures"), rig.camera.image_size, "the rig's lens is")
    # the board's shape as the calibration found it
    recorded_shape = [_number_at(quality, "lens", "board_shape", "parameters", name) or 0.0 for name in SHAPE_NAMES]
    shape = replace(BoardShape.flat(corner_points(session.board)), parameters=np.array(recorded_shape))
    boards = [(part, view) for part, paths in inputs.boards.items() for view in detect_files(paths, session.board)]
    recorded = _number_at(quality, "lens", "rms_inliers_px") or _number_at(quality, "lens_rms_px")
    lens, of_lens = check_lens(rig.camera, boards, shape, recorded, _number_at(quality, "plane_rms_px"))
    lens_holds = not any(finding.is_bad for finding in lens)
    in_jig = [view for part, view in boards if part == "plane"]
    pose, of_pose, current = check_pose(rig, in_jig, session, inputs.no_jig, shape, lens_holds)
    stills: list[CheckedStill] = []
    if inputs.stills:
        where = rig.camera, current.T_antenna_camera, rig.antenna.parameters
        expected = ExpectedAntenna(session.antenna, *where, rig.image.paint)
        seen, _ = observe(session, rig.kinematics, inputs.stills, expected, "antenna")
        stills = check_stills(current, seen, session.load_readings)
    antenna, of_antenna = check_antenna(current, stills, camera_known=of_pose["camera_pose"] is not None)
    parts_asked = {"given": list(parts), "not_given": [part for part in _PARTS if part not in parts]}
    return (*lens, *pose, *antenna), {**parts_asked, **of_lens, **of_pose, **of_antenna}
