"""Is this rig still right? What rig.json says of itself, and what a session's pictures say of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.calibrate.antenna.session_rig import observe
from vbaa_calib.calibrate.lens.board_flex import Bend
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json
from vbaa_calib.detect.board.corners import BoardView, detect_files
from vbaa_calib.detect.whisker.paint import Paint
from vbaa_calib.rig import Rig
from vbaa_calib.session import Load, Session, check_pictures, load_session

from .antenna import AntennaEvidence, antenna_findings, check_antenna, free_table, loads_table
from .finding import FAILS, HOLDS, LOOK, NOT_GIVEN, Finding, not_given, worst
from .lens import LensEvidence, check_lens, lens_findings
from .pictures import (
    PARTS,
    NewPictures,
    Taken,
    from_pictures,
    from_session,
    recorded_bend,
    recorded_session,
    refuse_calibrations_own,
)
from .pose import PoseEvidence, check_pose, pose_finding, rig_now
from .rig import along_antenna, number_at, plane_map, projection_map, rig_findings, rig_numbers
from .stills import HeldStill, hold

SCHEMA = "vbaa.check/1"
VERDICTS = {
    HOLDS: "This rig holds.",
    LOOK: "Look at this rig before you rely on it.",
    FAILS: "This rig does not hold.",
    NOT_GIVEN: "There is nothing to judge this rig by.",
}


@dataclass(frozen=True, eq=False)
class SessionCheck:
    """A rig against a session. `parts` are those of `PARTS` that the session has."""

    parts: tuple[str, ...]
    findings: tuple[Finding, ...]
    lens: LensEvidence | None
    pose: PoseEvidence | None
    rig_now: Rig
    antenna: AntennaEvidence

    def to_dict(self) -> dict[str, Any]:
        """For check.json."""
        lens, pose = self.lens, self.pose
        return {
            "given": list(self.parts),
            "not_given": [part for part in PARTS if part not in self.parts],
            "boards": [] if lens is None else [view.to_dict() for view in lens.views],
            "boards_dropped": [] if lens is None else [{"name": d.name, "reason": d.reason} for d in lens.dropped],
            "boards_rms_px": None if lens is None else lens.rms_px,
            "boards_expected_rms_px": None if lens is None else lens.expected_px,
            "camera_pose": None if pose is None else pose.to_dict(),
            "noload": free_table(self.rig_now, self.antenna),
            "loads": loads_table(self.rig_now, self.antenna),
        }


@dataclass(frozen=True, eq=False)
class Assessment:
    """Everything that `vbaa check` says.

    Attributes
    ----------
    verdict : the worst level of all findings. words : in a sentence or two.
    findings : of the rig by itself; those of a session are in `session`.
    quality : of rig.json, as it is there. nominal_Nm2 : E·πd⁴/64, from there or from the session.
    """

    rig: Rig
    path: Path
    findings: tuple[Finding, ...]
    quality: Mapping[str, Any]
    session: SessionCheck | None
    nominal_Nm2: float | None = None

    @property
    def verdict(self) -> str:
        """The worst level of all questions that were answered."""
        return worst([*self.findings, *(self.session.findings if self.session else ())])

    @property
    def words(self) -> str:
        """The verdict, and the questions that were not answered with "holds"."""
        asked = [*(self.session.findings if self.session else ()), *self.findings]
        sentences = [VERDICTS[self.verdict]]
        for level, start in ((FAILS, "Does not hold"), (LOOK, "Look at")):
            found = [f"{one.name.replace('_', ' ')} ({one.words})" for one in asked if one.level == level]
            if found:
                sentences.append(f"{start}: {'; '.join(found)}.")
        if self.session is None:
            sentences.append("Judged by rig.json alone; give new pictures to see whether it is still so.")
        return " ".join(sentences)

    def to_dict(self) -> dict[str, Any]:
        """check.json: from this alone the report is made."""
        projection, plane, along = projection_map(self.rig), plane_map(self.rig), along_antenna(self.rig)
        rays = np.asarray(self.rig.camera.unproject(plane.pixels)[1])
        return {
            "schema": SCHEMA,
            "rig": str(self.path),
            "verdict": self.verdict,
            "headline": VERDICTS[self.verdict],
            "words": self.words,
            "findings": [finding.to_dict() for finding in self.findings],
            "numbers": rig_numbers(self.rig, self.nominal_Nm2),
            "maps": {
                "projection": None if projection is None else projection.to_dict(),
                "plane": plane.to_dict(),
                "has_ray": rays.tolist(),
                "along_antenna": along.to_dict(),
            },
            "quality": dict(self.quality),
            "session_findings": [finding.to_dict() for finding in self.session.findings] if self.session else [],
            "session": None if self.session is None else self.session.to_dict(),
        }


def assess(path: Path, session_root: Path | None = None, new: NewPictures | None = None) -> Assessment:
    """Judge a rig.json, and hold it against a session, or against new pictures, where they are given.

    With new pictures the session is the one that the rig was calibrated from: it says where the jig is, and which board
    lies in it; its own pictures are not read. Without a session rig.json's record of both serves.

    Raises InputError for a broken rig or session, pictures of another size than the lens', a session without any of
    `PARTS`, and a new picture that the rig was calibrated from.
    """
    path = Path(path)
    data = read_json(path)
    rig, quality = Rig.from_dict(data, path), data.get("quality", {})
    session = None if session_root is None else load_session(Path(session_root))
    nominal = number_at(quality, "antenna", "nominal_stiffness_Nm2")
    if nominal is None and session is not None:
        nominal = session.antenna.stiffness_Nm2
    own = rig_findings(rig, quality, plane_map(rig), along_antenna(rig), nominal)
    taken = _taken(data, rig, path, session, new)
    checked = None if taken is None else _check_taken(rig, quality, taken)
    return Assessment(rig, path, tuple(own), quality, checked, nominal)


def _taken(
    data: Mapping[str, Any], rig: Rig, path: Path, session: Session | None, new: NewPictures | None
) -> Taken | None:
    if session is not None:
        _refuse_other_antenna(rig, session)
    if new is None:
        return None if session is None else from_session(session)
    refuse_calibrations_own(data, new, path)
    if session is not None:
        return from_pictures(session, new)
    return from_pictures(recorded_session(data, rig, path), new, "rig.json does not record the jig: name its session")


def _check_taken(rig: Rig, quality: Mapping[str, Any], taken: Taken) -> SessionCheck:
    """The lens, then the camera's pose, then the antenna and the sensor, each in the light of those before."""
    check_pictures(progress(list(taken.pictures()), "reading the pictures"), rig.camera.image_size, "the rig's lens is")
    spec = taken.session.board
    boards = [(part, view) for part, paths in taken.boards.items() for view in detect_files(paths, spec)]
    recorded = number_at(quality, "lens", "rms_inliers_px") or number_at(quality, "lens_rms_px")
    bent = recorded_bend(quality)
    lens = check_lens(rig.camera, boards, spec, bent, recorded) if boards else None
    why = "no usable picture of the board" if boards else "no picture of the board (intrinsics/, plane/)"
    findings = lens_findings(lens, rig.camera, why)
    lens_holds = all(finding.level in (HOLDS, NOT_GIVEN) for finding in findings)
    pose, pose_answer = _pose(rig, taken, [view for part, view in boards if part == "plane"], bent, lens_holds)
    now = rig_now(rig, pose, pose_answer)
    free, loaded = _held(now, taken)
    antenna = check_antenna(now, free, loaded)
    findings += [pose_answer, *antenna_findings(now, antenna, camera_known=pose is not None)]
    return SessionCheck(taken.parts, tuple(findings), lens, pose, now, antenna)


def _pose(
    rig: Rig, taken: Taken, views: Sequence[BoardView], bent: Bend | None, lens_holds: bool
) -> tuple[PoseEvidence | None, Finding]:
    name, question = "camera_pose", "Is the camera where it was?"
    if not views:
        return None, not_given(name, question, "no picture of the board in the jig (plane/)")
    jig = taken.session.T_antenna_board
    if jig is None:
        return None, not_given(name, question, taken.no_jig)
    found = check_pose(rig, views, taken.session.board, jig, bent)
    return found, pose_finding(found, lens_holds)


def _held(rig: Rig, taken: Taken) -> tuple[list[HeldStill], list[HeldStill]]:
    """Free and loaded stills against the rig."""
    if not taken.stills:
        return [], []
    seen = observe(
        taken.session,
        rig.kinematics,
        taken.stills,
        rig.camera,
        rig.T_antenna_camera,
        rig.antenna.parameters,
        "antenna",
        Paint(rig.image.bright, rig.image.weights),
    )
    held = hold(rig, seen, taken.session.load_readings)
    free = [one for one in held if not isinstance(one.still, Load)]
    return free, [one for one in held if isinstance(one.still, Load)]


def _refuse_other_antenna(rig: Rig, session: Session) -> None:
    for name in ("length_m", "diameter_m"):
        own, other = getattr(rig.antenna, name), getattr(session.antenna, name)
        if abs(own - other) > 1e-3 * own:
            what = f"antenna.{name} is {other:g}, the rig's {own:g}"
            raise InputError(what, where=session.root / "session.yaml", remedy="check a rig with its own antenna")
