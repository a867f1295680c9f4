"""What is asked of the way to plane C: jig, sweep, or the antenna over a board."""

from __future__ import annotations

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
