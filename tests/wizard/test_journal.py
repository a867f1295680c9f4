"""What the wizard was told and shown, to wizard.json and back."""

from __future__ import annotations

import json
from pathlib import Path

from vbaa_calib.wizard.state.catalogue import QUESTIONS
from vbaa_calib.wizard.state.journal import AcceptedPicture, Journal, RefusedPicture, StepRecord


def full() -> Journal:
    """One of everything: every question answered by its default or its lowest value."""
    lowest = {
        "number": lambda q: q.low,
        "numbers": lambda q: [q.low] * max(q.length, 1),
        "choice": lambda q: q.choices[0],
    }
    answers = {q.key: q.default if q.default is not None else lowest[q.kind](q) for q in QUESTIONS}
    readings = {"pan_rad": 0.1 + 0.2, "tilt_rad": -1e-300, "moment_Nm": 5.0}
    load = readings | {"distance_m": 0.1, "force_y_N": 0.0, "force_z_N": -1.0}
    taken = {
        "lens": ("intrinsics", {}),
        "plane": ("sweep", readings),
        "noload": ("noload", readings),
        "loads": ("loads", load),
    }
    steps = {
        step: StepRecord(
            taken=(AcceptedPicture(file=f"{folder}/0001.png", source="Bild ä 1.png", sha256="ab", readings=row),),
            left=(RefusedPicture(source="b", sha256="cd", why="blurred"),),
            closed="enough",
        )
        for step, (folder, row) in taken.items()
    }
    answers |= {"measure_x_mm": 165.0, "jig_given": False}
    return Journal(answers=answers, steps=steps, redone=("lens", "board"))


def test_file_and_back(tmp_path: Path) -> None:
    (tmp_path / "wizard.json").write_text(json.dumps(full().to_dict()))
    assert Journal.read(tmp_path / "wizard.json") == full()


def test_changes_make_new_ones() -> None:
    journal = full()
    before = journal.to_dict()
    changed = journal.with_answers({"gravity": "x"}).with_step("lens", taken=(), left=())
    assert journal.to_dict() == before
    assert changed.answers == {"gravity": "x"}
    assert changed.of("lens").judged == frozenset()
    assert changed.of("plane") == journal.of("plane")
    assert changed.of("board") == StepRecord()


def test_judged_is_what_was_taken_or_refused() -> None:
    assert full().of("lens").judged == {"Bild ä 1.png", "b"}
