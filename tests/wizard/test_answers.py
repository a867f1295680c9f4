"""Answers: they mean the same typed, written or clicked, and every one that cannot be is refused in one line."""

from __future__ import annotations

import datetime
import json
from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.questions import BY_KEY, QUESTIONS, SOURCES, TABLES, Question

RNG_SEED = 11


@pytest.mark.parametrize("question", [q for q in QUESTIONS if q.kind == "number"], ids=lambda question: question.key)
def test_a_number_typed_is_the_number_written(question: Question) -> None:
    rng = np.random.default_rng(RNG_SEED)
    for value in rng.uniform(question.low, question.high, 20).tolist():
        assert question.read(repr(value)) == question.read(value) == value
        assert question.read(f"  {value!r} ") == value


@pytest.mark.parametrize(
    ("key", "unit", "per_unit"),
    [
        *(
            ("jig_translation_mm", unit, per_mm)
            for unit, per_mm in (("m", 1e-3), ("cm", 0.1), ("mm", 1.0), ("in", 1 / 25.4))
        ),
        ("weights_g", "kg", 1e-3),
        ("jig_turn_deg", "rad", np.pi / 180),
    ],
)
def test_a_unit_may_be_typed(key: str, unit: str, per_unit: float) -> None:
    """Behind each number, or behind the last for all, however they are separated."""
    question = BY_KEY[key]
    for value in np.random.default_rng(RNG_SEED).uniform(1.0, 100.0, (20, 3)):
        numbers = [repr(float(one)) for one in per_unit * value]
        for text in (f"{' '.join(numbers)} {unit}", f"{', '.join(numbers)}{unit}", f"{unit}; ".join(numbers) + unit):
            assert question.read(text) == pytest.approx(value.tolist(), rel=1e-12)
        assert replace(question, kind="number").read(numbers[0] + unit) == pytest.approx(value[0])


def test_answers_can_be_kept() -> None:
    """Whatever is read goes into JSON and comes back the same, and reads the same again."""
    for question in QUESTIONS:
        value = question.read(
            {"number": question.low, "choice": (question.choices or ("",))[0], "yesno": "yes"}.get(
                question.kind,
                [max(question.low, 1.0)] * (question.length or 2) if question.kind == "numbers" else "text",
            )
        )
        assert question.read(json.loads(json.dumps(value))) == value


EVERY = (*QUESTIONS, *SOURCES, *TABLES)
TYPED = {
    "number": ["240 miles", "24 24", "0,8", "nan", "-inf", "", " ", "ten", "1e400", "٢٤", "1_0", "0x10", "1e7", "-1e7"],
    "numbers": ["a,b,c", "1,2,x", "", ",", "1e400,1,1", "nan,1,1", "1,2,3 miles", "about 1 2 3"],
    "choice": ["purple", "", "-"],
    "sides": ["", "half", "2 x", "-2", "1.5", "1x2x3"],
    "yesno": ["", "maybe", "2"],
    "text": ["", "  "],
}
WRITTEN: dict[str, list[object]] = {
    "number": [None, True, [], [1.0], {"value": 1}, float("nan"), 10**400, datetime.date(2026, 1, 1)],
    "numbers": [None, True, [], {"x": 1}, [[1], 2, 3], [1, 2, None], [float("inf"), 1, 1]],
    "choice": [None, True, 3, ["x"], {"x": 1}],
    "sides": [None, True, 1.5, -2, [2, 1]],
    "yesno": [None, 3, ["yes"], {"x": 1}],
    "text": [None, 3, {"path": "x"}, "x" * 5000],
}


def ranges(question: Question) -> tuple[float, ...]:
    """Just beyond the limits, which are answers themselves."""
    assert question.read(question.low) == question.low
    assert question.read(str(question.high)) == question.high
    return question.low - 1e-9 - 1e-6 * abs(question.low), question.high * 1.001


@pytest.mark.parametrize("question", EVERY, ids=lambda question: question.key)
def test_every_answer(question: Question) -> None:
    beyond = ranges(question) if question.kind == "number" else ()
    for given in [*TYPED[question.kind], *WRITTEN[question.kind], *beyond]:
        with pytest.raises(InputError, match=question.key) as raised:
            question.read(given)
        assert raised.value.remedy.startswith("give ")
        assert question.unit in raised.value.remedy
