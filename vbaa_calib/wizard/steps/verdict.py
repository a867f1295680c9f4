"""The end: everything in one solve, rig.json, and a report that says whether to trust it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from viz.check_page import page

from ...calibrate.calibrate_cli import rig_document
from ...calibrate.calibration import calibrate
from ...calibrate.calibration_report import doubts
from ...calibrate.recheck import assess
from ...files import write_json, write_text
from ...session import load_session
from ..journal import PICTURES
from ..known import Known
from ..progress import Progress
from .step import Step

RIG, REPORT = "rig.json", "check.html"


def conclude(root: Path) -> dict[str, Any]:
    """Calibrate the session from its files, write rig.json and check.html beside them. Returns check.json's content.

    rig.json is the same for the same session: how the wizard was called is not in it. Raises InputError and SolveError
    as `calibrate` does.
    """
    session = load_session(root)
    calibration = calibrate(session)
    write_json(root / RIG, rig_document(session, calibration, doubts(calibration), ["vbaa", "wizard"]))
    document = assess(root / RIG, root).to_dict()
    write_text(root / REPORT, page(document))
    return document


def look(known: Known) -> Progress:
    """What is there for the verdict."""
    counts = [f"{len(known.taken(step))} {words}" for step, words in PICTURES.items()]
    return Progress(seen=(f"pictures: {', '.join(counts)}",), next="everything is solved together; this takes a minute")


STEP = Step(
    "verdict",
    "Verdict",
    "Nothing to do: lens, plane C, antenna and sensor are solved together from all pictures.",
    "What one step calls certain another may contradict; the report says what to trust, and how far.",
    look,
)
