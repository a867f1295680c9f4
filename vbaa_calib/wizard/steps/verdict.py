"""The end: everything in one solve, rig.json, and a report that says whether to trust it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from vbaa_calib.calibrate.check.assessment import assess
from vbaa_calib.calibrate.pipeline import calibrate
from vbaa_calib.calibrate.report import doubts, rig_document
from vbaa_calib.core.files import write_json, write_text
from vbaa_calib.session import load_session
from vbaa_calib.wizard.state.questions import PICTURES
from vbaa_calib.wizard.state.session_state import SessionState

from .step import Progress, Step

RIG, REPORT = "rig.json", "check.html"
Report = Callable[[dict[str, Any]], str]
"""From check.json's content to its page: what draws stands above the wizard."""


def conclude(root: Path, report: Report) -> dict[str, Any]:
    """Calibrate the session from its files, write rig.json and check.html beside them. Returns check.json's content.

    rig.json is the same for the same session: how the wizard was called is not in it. Raises InputError and SolveError
    as `calibrate` does.
    """
    session = load_session(root)
    calibration = calibrate(session)
    write_json(root / RIG, rig_document(calibration, doubts(calibration), ["vbaa", "wizard"]))
    document = assess(root / RIG, root).to_dict()
    write_text(root / REPORT, report(document))
    return document


def _progress(state: SessionState) -> Progress:
    counts = [f"{len(state.taken(step))} {words}" for step, words in PICTURES.items()]
    return Progress(seen=(f"pictures: {', '.join(counts)}",), next="everything is solved together; this takes a minute")


STEP = Step(
    "verdict",
    "Verdict",
    "Nothing to do: lens, plane C, antenna and sensor are solved together from all pictures.",
    "What one step calls certain another may contradict; the report says what to trust, and how far.",
    _progress,
)
