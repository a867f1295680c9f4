"""An answer means the same whether it is typed, written or clicked."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vbaa_calib.wizard.questions import QUESTIONS, Question

RNG_SEED = 11


@pytest.mark.parametrize("question", [q for q in QUESTIONS if q.kind == "number"], ids=lambda question: question.key)
def test_a_number_typed_is_the_number_written(question: Question) -> None:
    rng = np.random.default_rng(RNG_SEED)
    for value in rng.uniform(question.low, question.high, 20).tolist():
        assert question.read(repr(value)) == question.read(value) == value
        assert question.read(f"  {value!r} ") == value


def test_answers_can_be_kept() -> None:
    """Whatever is read goes into JSON and comes back the same, and reads the same again."""
    for question in QUESTIONS:
        value = question.read(
            {"number": question.low, "choice": (question.choices or ("",))[0]}.get(
                question.kind,
                [max(question.low, 1.0)] * (question.length or 2) if question.kind == "numbers" else "text",
            )
        )
        assert question.read(json.loads(json.dumps(value))) == value
