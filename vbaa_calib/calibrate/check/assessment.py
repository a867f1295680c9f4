"""`assess`: everything that `vbaa check` reports about a rig, alone or against new pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vbaa_calib.calibrate.antenna.session_rig import ExpectedAntenna, observe
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json
from vbaa_calib.detect.board.corners import detect_files
from vbaa_calib.detect.whisker.paint import Paint
from vbaa_calib.rig import Rig
from vbaa_calib.session import Session, check_pictures, load_session

from .antenna import check_antenna
from .finding import FAILS, HOLDS, LOOK, NOT_GIVEN, Checked, Finding, worst
from .inputs import (
    PARTS,
    CheckInputs,
    NewPictures,
    from_pictures,
    from_session,
    recorded_bend,
    recorded_session,
    refuse_calibration_pictures,
)
from .lens import check_lens
from .pose import check_pose
from .rig import number_at, rig_findings, rig_maps, rig_numbers
from .stills import CheckedStill, check_stills

SCHEMA = "vbaa.check/1"
_VERDICTS = {
    HOLDS: "This rig holds.",
    LOOK: "Look at this rig before you rely on it.",
    FAILS: "This rig does not hold.",
    NOT_GIVEN: "There is nothing to judge this rig by.",
}


@dataclass(frozen=True, eq=False)
class Assessment:
    """The result of `assess`.

    findings : on the rig by itself; those on new pictures are in `session`.
    quality : of rig.json, as it is there. nominal_Nm2 : E·πd⁴/64, from there or from the session.
    """

    rig: Rig
    path: Path
    findings: tuple[Finding, ...]
    quality: Mapping[str, Any]
    session: Checked | None
    nominal_Nm2: float | None = None

    @property
    def verdict(self) -> str:
        """The worst level of all answered questions."""
        return worst([*self.findings, *(self.session.findings if self.session else ())])

    @property
    def words(self) -> str:
        """The verdict, and the questions that were not answered with "holds"."""
        asked = [*(self.session.findings if self.session else ()), *self.findings]
        sentences = [_VERDICTS[self.verdict]]
        for level, start in ((FAILS, "Does not hold"), (LOOK, "Look at")):
            found = [f"{one.name.replace('_', ' ')} ({one.words})" for one in asked if one.level == level]
            if found:
                sentences.append(f"{start}: {'; '.join(found)}.")
        if self.session is None:
            sentences.append("Judged by rig.json alone; give new pictures to see whether it is still so.")
        return " ".join(sentences)

    def to_dict(self) -> dict[str, Any]:
        """check.json: the report is made from this alone."""
        return {
            "schema": SCHEMA,
            "rig": str(self.path),
            "verdict": self.verdict,
            "headline": _VERDICTS[self.verdict],
            "words": self.words,
            "findings": [finding.to_dict() for finding in self.findings],
            "numbers": rig_numbers(self.rig, self.nominal_Nm2),
            "maps": rig_maps(self.rig),
            "quality": dict(self.quality),
            "session_findings": [finding.to_dict() for finding in self.session.findings] if self.session else [],
            "session": None if self.session is None else dict(self.session.document),
        }


def assess(path: Path, session_root: Path | None = None, new: NewPictures | None = None) -> Assessment:
    """Judge a rig.json by itself, and against a session or new pictures where they are given.

    With new pictures the session is the one that the rig was calibrated from: it describes the jig and the board in it;
    its own pictures are not read. Without a session, rig.json's record of both is used.

    Raises InputError for a broken rig or session, pictures of another size than the lens', a session without any of
    `inputs.PARTS`, and a new picture that the rig was calibrated from.
    """
    path = Path(path)
    data = read_json(path)
    rig, quality = Rig.from_dict(data, path), data.get("quality", {})
    session = None if session_root is None else load_session(Path(session_root))
    nominal = number_at(quality, "antenna", "nominal_stiffness_Nm2")
    if nominal is None and session is not None:
        nominal = session.antenna.stiffness_Nm2
    own = rig_findings(rig, quality, nominal)
    if session is not None:
        _refuse_other_antenna(rig, session)
    inputs = None if session is None else from_session(session) if new is None else from_pictures(session, new)
    if new is not None:
        refuse_calibration_pictures(data, new, path)
        if session is None:
            no_jig = "rig.json does not record the jig: name its session"
            inputs = from_pictures(recorded_session(data, rig, path), new, no_jig)
    checked = None if inputs is None else _check_pictures(rig, quality, inputs)
    return Assessment(rig, path, tuple(own), quality, checked, nominal)


def _check_pictures(rig: Rig, quality: Mapping[str, Any], inputs: CheckInputs) -> Checked:
    """The lens, then the camera's pose, then the antenna and the sensor, each after those before."""
    check_pictures(progress(inputs.pictures, "reading the pictures"), rig.camera.image_size, "the rig's lens is")
    session, parts, bent = inputs.session, inputs.parts, recorded_bend(quality)
    boards = [(part, view) for part, paths in inputs.boards.items() for view in detect_files(paths, session.board)]
    recorded = number_at(quality, "lens", "rms_inliers_px") or number_at(quality, "lens_rms_px")
    lens = check_lens(rig.camera, boards, session.board, bent, recorded)
    lens_holds = not any(finding.is_bad for finding in lens.findings)
    in_jig = [view for part, view in boards if part == "plane"]
    pose, current = check_pose(rig, in_jig, inputs, bent, lens_holds)
    stills: list[CheckedStill] = []
    if inputs.stills:
        where = rig.camera, current.T_antenna_camera, rig.antenna.parameters
        expected = ExpectedAntenna(session.antenna, *where, Paint(rig.image.bright, rig.image.weights_bgr))
        seen = observe(session, rig.kinematics, inputs.stills, expected, "antenna")
        stills = check_stills(current, seen, session.load_readings)
    antenna = check_antenna(current, stills, camera_known=pose.document["camera_pose"] is not None)
    document = {"given": list(parts), "not_given": [part for part in PARTS if part not in parts]}
    return Checked(
        (*lens.findings, *pose.findings, *antenna.findings),
        {**document, **lens.document, **pose.document, **antenna.document},
    )


def _refuse_other_antenna(rig: Rig, session: Session) -> None:
    for name in ("length_m", "diameter_m"):
        own, other = getattr(rig.antenna, name), getattr(session.antenna, name)
        if abs(own - other) > 1e-3 * own:
            what = f"antenna.{name} is {other:g}, the rig's {own:g}"
            raise InputError(what, where=session.root / "session.yaml", remedy="check a rig with its own antenna")
