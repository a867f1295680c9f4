"""What people and hardware get wrong in a session, over rigs of every size: named first, with its value."""

from __future__ import annotations

import re

import pytest

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.diagnose.session import _session_diagnoses as session_diagnoses
from vbaa_calib.geometry import Kinematics

from .reported_sessions import MISTAKES, session_with

ALWAYS = (
    *(("length 1 %", 1), ("board - 4 %", 1), ("nitinol as steel", 1)),
    *(("moment: sign", 1), ("clean", 0), ("y and z exchanged", 1), ("pan and tilt exchanged", 1)),
    *(("gravity upward", 1), ("no gravity", 1), ("clamp slipped 3 mm", 1), ("one distance 3 mm", 1)),
)
SELDOM = [(name, seed) for name in MISTAKES for seed in range(6) if (name, seed) not in ALWAYS]
UNSEEN = ("length 1 %", "one distance 3 mm", "all distances 3 mm", "tilt's sign", "clamp turned 1 mrad")
"""What the pictures of some rigs do not show: a millimetre at half a metre, before a lens of 300 px."""


def diagnosed(name: str, seed: int) -> tuple[list[Diagnosis], str | float]:
    drawn, words = session_with(name, seed)
    return session_diagnoses(drawn.session, Kinematics(), drawn.observations, drawn.before), words


def is_named(name: str, found: list[Diagnosis], words: str | float) -> bool:
    """Whether the first diagnosis is the mistake, with its rows or its value."""
    first = found[0]
    if isinstance(words, str):
        return first.name in MISTAKES[name].names and all(part in str(first) for part in words.split("|"))
    numbers = [abs(float(number)) for number in re.findall(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", first.words)]
    near = min(numbers, key=lambda number: abs(number - abs(words)), default=0.0)
    return first.name in MISTAKES[name].names and near == pytest.approx(abs(words), rel=0.006 if words > 50 else 0.4)


@pytest.mark.parametrize(("name", "seed"), [*ALWAYS, *(pytest.param(*one, marks=pytest.mark.slow) for one in SELDOM)])
def test_a_mistake_is_named_first_and_nothing_else_is_wrong(name: str, seed: int) -> None:
    found, words = diagnosed(name, seed)
    if not MISTAKES[name].names:
        assert [one for one in found if one.severity != "note"] == []
        return
    if name in UNSEEN and not found:
        pytest.skip("the pictures of this rig do not show it")
    assert found
    assert is_named(name, found, words)
