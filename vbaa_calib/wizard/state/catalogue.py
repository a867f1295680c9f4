"""All questions, in the order in which they are asked; here those of board and lens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .questions import Answers, Question

AXES = ("x", "-x", "y", "-y", "z", "-z")


def keeps_jig(answers: Answers) -> bool:
    """Whether the jig is the one that came with the session, and no other was described."""
    return bool(answers.get("jig_given")) and "jig_translation_mm" not in answers


def _jig(answers: Answers) -> bool:
    return answers.get("plane_way") == "jig" and not keeps_jig(answers)


def _over(answers: Answers) -> bool:
    return answers.get("plane_way") == "over" and not answers.get("over_given")


PLANE_QUESTIONS = (
    Question(
        "plane_way",
        "plane",
        "How shall the camera's place on the antenna's base be found?",
        "jig: the board in a holder at a known place on the base, a few pictures; sweep: the board fixed in the world, "
        "10 pictures at other joint angles; over: the board flat under the free antenna, whose height is known",
        kind="choice",
        default="jig",
        choices=("jig", "sweep", "over"),
    ),
    Question(
        "jig_translation_mm",
        "plane",
        "Where does the jig hold the top left corner of the pattern, in the antenna frame: x, y, z?",
        "the frame begins at the clamp: x along the antenna, z out of plane C. Of the board's back: its thickness is "
        "asked for. Top left as one reads the print",
        kind="numbers",
        unit="mm",
        low=-5000.0,
        high=5000.0,
        length=3,
        needed=_jig,
    ),
    Question(
        "jig_board_x",
        "plane",
        "Along which axis of the antenna frame does the pattern's upper edge run, from left to right?",
        kind="choice",
        default="x",
        choices=AXES,
        needed=_jig,
    ),
    Question(
        "jig_board_y",
        "plane",
        "And its left edge, from the top down?",
        kind="choice",
        default="-y",
        choices=AXES,
        needed=_jig,
    ),
    Question(
        "jig_turn_deg",
        "plane",
        "By how much is the board turned out of these axes, about the antenna's x, y, z?",
        "zeros for a jig that is true; a rotation vector",
        kind="numbers",
        unit="degrees",
        default=[0.0, 0.0, 0.0],
        low=-180.0,
        high=180.0,
        length=3,
        needed=_jig,
    ),
    Question(
        "jig_std_mm",
        "plane",
        "How well is the jig's place on the base known (one standard deviation)?",
        "the contact's place in the world cannot be better",
        unit="mm",
        default=0.1,
        low=0.0,
        high=50.0,
        needed=_jig,
    ),
    Question(
        "jig_std_deg",
        "plane",
        "And its angles?",
        "0.1 degrees are 0.4 mm at the tip of an antenna of 240 mm, which the verdict will tell; a milled jig is good "
        "to 0.03",
        unit="degrees",
        default=0.1,
        low=0.0,
        high=20.0,
        needed=_jig,
    ),
    Question(
        "board_thickness_mm",
        "plane",
        "How thick is the board?",
        "the jig holds its back, the camera sees its face",
        unit="mm",
        default=0.0,
        low=0.0,
        high=200.0,
        needed=_jig,
    ),
    Question(
        "over_height_mm",
        "plane",
        "How high is the middle of the antenna above the printed face?",
        unit="mm",
        low=0.0,
        high=500.0,
        needed=_over,
    ),
)


ANTENNA_QUESTIONS = (
    Question(
        "antenna_diameter_mm",
        "noload",
        "How thick is the antenna?",
        "what it should weigh, and what EI should be: E·πd⁴/64",
        unit="mm",
        low=0.001,
        high=100.0,
    ),
    Question(
        "youngs_modulus_GPa",
        "noload",
        "Young's modulus of its material?",
        "only to see that the EI found is plausible",
        unit="GPa",
        default=193.0,
        low=1e-4,
        high=2000.0,
    ),
    Question(
        "density_kg_m3",
        "noload",
        "Density of its material?",
        "its weight makes it sag",
        unit="kg/m³",
        default=7900.0,
        low=10.0,
        high=30_000.0,
    ),
    Question(
        "gravity",
        "noload",
        "Which way is down in the world frame (z is the pan joint's axis)?",
        kind="choice",
        default="-z",
        choices=(*AXES, "none"),
        needed=lambda answers: not answers.get("gravity_given"),
    ),
    Question(
        "moment_std_mNm",
        "noload",
        "How far does the moment sensor scatter when nothing touches the antenna (one standard deviation)?",
        "what it shows later is held against this",
        unit="mN·m",
        default=0.02,
        low=1e-6,
        high=1e4,
    ),
    Question(
        "weights_g",
        "loads",
        "What masses can you hang on the antenna?",
        "three are enough; the wizard says which one to hang where",
        kind="numbers",
        unit="g",
        default=[5.0, 10.0, 20.0],
        low=0.001,
        high=100_000.0,
    ),
    Question(
        "distance_std_mm",
        "loads",
        "How exactly is a load's place along the antenna read off (one standard deviation)?",
        "half a millimetre with a ruler, a tenth with a caliper; it limits EI more than anything else",
        unit="mm",
        default=0.5,
        low=0.0,
        high=50.0,
    ),
    Question(
        "mass_std_percent",
        "loads",
        "And how well are the masses known?",
        unit="%",
        default=0.5,
        low=0.0,
        high=50.0,
    ),
)


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
