"""All questions, in the order in which they are asked; here those of board and lens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .catalogue_antenna import ANTENNA_QUESTIONS
from .catalogue_plane import PLANE_QUESTIONS
from .questions import Question

QUESTIONS = (
    Question(
        "board",
        "board",
        "Which board do you use? 'new' makes a sheet to print; or name the board.yaml of one that you have",
        "if unsure: new",
        kind="text",
        default="new",
    ),
    Question(
        "paper",
        "board",
        "What paper do you print on?",
        "the board is laid out to fill it",
        kind="choice",
        default="A4",
        choices=("A4", "A3", "Letter"),
        needed=lambda answers: answers.get("board") == "new",
    ),
    Question(
        "board_along_x_mm",
        "board",
        "How long is {measured_x}, as printed? It says {measure_x_mm:.6g} mm",
        "printers scale; a board 1 % off makes every distance 1 % wrong, and EI: use a caliper or a steel ruler",
        unit="mm",
        low=1.0,
        high=5000.0,
    ),
    Question(
        "board_along_y_mm",
        "board",
        "How long is {measured_y}? It says {measure_y_mm:.6g} mm",
        "some printers stretch one way only",
        unit="mm",
        low=1.0,
        high=5000.0,
    ),
    Question(
        "board_reading_std_mm",
        "board",
        "How exact are these two readings (one standard deviation)?",
        "a quarter of a millimetre with a ruler, 0.05 mm with a caliper; no length will be better than this",
        unit="mm",
        default=0.25,
        low=0.001,
        high=5.0,
    ),
    Question(
        "source",
        "lens",
        "Where do the pictures come from? camera:0, a folder that a program fills, a video, or a stream's URL",
        "from a camera, video or stream a picture is taken whenever you hold still",
        kind="text",
        default="camera:0",
        needed=lambda answers: "lens_source" not in answers,
    ),
    Question(
        "antenna_length_mm",
        "lens",
        "How long is the antenna, from the clamp to its tip?",
        "the lens has to be known where the antenna moves",
        unit="mm",
        low=1.0,
        high=10_000.0,
    ),
    Question(
        "camera_distance_mm",
        "lens",
        "About how far is the camera from the middle of the antenna?",
        "a rough number will do: it says where the board should be shown",
        unit="mm",
        low=5.0,
        high=20_000.0,
    ),
    Question(
        "camera_inclination_deg",
        "lens",
        "How far is the camera tilted from looking straight at the plane in which the antenna bends (plane C)?",
        "a rough number will do; 0: it looks straight at it",
        unit="degrees",
        default=0.0,
        low=0.0,
        high=80.0,
    ),
    *PLANE_QUESTIONS,
    *ANTENNA_QUESTIONS,
)


SOURCES = tuple(
    Question(
        f"{step}_source", step, f"Where do the pictures of the step {step} come from, if not from source?", kind="text"
    )
    for step in ("lens", "plane", "noload", "loads")
)
"""Never asked; flags and answers only."""
TABLES = tuple(
    Question(f"{step}_readings", step, f"CSV with what was read with each picture of the step {step}", kind="text")
    for step in ("plane", "noload", "loads")
)
"""Never asked as a whole; a picture's readings are asked one by one."""


BOARD_ANSWERS = (
    *(question.key for question in QUESTIONS if question.step == "board"),
    "measure_x_mm",
    "measure_y_mm",
    "board_given",
)
"""What is known of the board, with what follows from its answers; another board makes all of it void."""


def by_key() -> Mapping[str, Question]:
    """Key → question."""
    return {question.key: question for question in QUESTIONS}


def open_questions(step: str, answers: Mapping[str, Any]) -> list[Question]:
    """What a step still has to ask, given the answers so far."""
    return [q for q in QUESTIONS if q.step == step and q.key not in answers and q.needed(answers)]
