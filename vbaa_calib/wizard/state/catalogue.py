"""The steps, and all questions in the order in which they are asked."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from .questions import Answers, Question

STEPS = ("board", "lens", "plane", "noload", "loads", "sensor", "verdict")
PICTURES = {"lens": "for the lens", "plane": "for plane C", "noload": "of the free antenna", "loads": "of loads"}
"""Steps that take pictures, and of what those are."""
READINGS: Mapping[str, tuple[str, ...]] = {
    "sweep": ("pan_rad", "tilt_rad"),
    "noload": ("pan_rad", "tilt_rad", "moment_Nm"),
    "loads": ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N"),
}
"""Folder → what is read with each of its pictures."""


def keeps_jig(answers: Answers) -> bool:
    """Whether the jig is the one that came with the session, and no other was described."""
    return bool(answers.get("jig_given")) and "jig_translation_mm" not in answers


def _needed(only_if: Mapping[str, str], unless: str, answers: Answers) -> bool:
    known = keeps_jig(answers) if unless == "jig_kept" else answers.get(unless)
    return not known and all(answers.get(key) == value for key, value in only_if.items())


def _question(step: str, key: str, entry: dict[str, Any]) -> Question:
    low, high = entry.pop("range", (-float("inf"), float("inf")))
    entry["choices"] = tuple(entry.get("choices", ()))
    kind = entry.pop("kind", "choice" if entry["choices"] else "number")
    needed = partial(_needed, entry.pop("if", {}), entry.pop("unless", ""))
    return Question(key, step, kind=kind, low=float(low), high=float(high), needed=needed, **entry)


_FILE = yaml.safe_load(Path(__file__).with_name("questions.yaml").read_text(encoding="utf-8"))
QUESTIONS = tuple(_question(step, key, entry) for step, entries in _FILE.items() for key, entry in entries.items())
BY_KEY: Mapping[str, Question] = {question.key: question for question in QUESTIONS}
SOURCES = tuple(
    Question(
        f"{step}_source", step, f"Where do the pictures of the step {step} come from, if not from source?", kind="text"
    )
    for step in PICTURES
)
"""Never asked; flags and answers only."""
TABLES = tuple(
    Question(f"{step}_readings", step, f"CSV with what was read with each picture of the step {step}", kind="text")
    for step in ("plane", "noload", "loads")
)
"""Never asked as a whole; a picture's readings are asked one by one."""
BOARD_ANSWERS = (*_FILE["board"], "measure_x_mm", "measure_y_mm", "board_given")
"""What is known of the board; another board makes all of it void."""


def open_questions(step: str, answers: Answers) -> list[Question]:
    """What a step still has to ask, given the answers so far."""
    return [q for q in QUESTIONS if q.step == step and q.key not in answers and q.needed(answers)]
