"""The examples run, and draw the figures that docs/examples.md shows."""

from __future__ import annotations

import contextlib
import io
import runpy
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
LONG = ("06_calibrating_a_session", "09_the_ladder")
"""They take ten seconds."""
SHOWN = ROOT / "docs" / "images" / "examples"
BLUR_PX = 5
"""Wide against the strokes of letters, which other versions of the font renderer draw a little otherwise."""
ALIKE = 1.0
"""Grey levels, mean over a figure, up to which figures count as the same."""


@dataclass(frozen=True)
class Ran:
    """An example, what it printed, on stdout and on stderr, and where its figure lies."""

    path: Path
    printed: str
    complained: str
    figure: Path


@pytest.fixture(
    scope="module",
    params=[pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG)) for path in EXAMPLES],
)
def ran(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """Each example, run once in this process. It may warn of nothing."""
    path, folder = request.param, tmp_path_factory.mktemp("figures")
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.setattr(sys, "argv", [str(path), "--figures", str(folder)])
        patch.syspath_prepend(str(path.parent))
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".torch.jit.script. is deprecated", DeprecationWarning)
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            runpy.run_path(str(path), run_name="__main__")
    return Ran(path, out.getvalue(), err.getvalue(), folder / f"{path.stem}.png")


def picture(path: Path) -> np.ndarray:
    """A figure's pixels."""
    read = cv2.imread(str(path))
    assert read is not None, f"there is no figure {path}"
    return read


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Mean absolute difference of two figures in grey levels, letters blurred; infinite for other sizes."""
    if one.shape != other.shape:
        return np.inf
    first, second = (cv2.blur(figure, (BLUR_PX, BLUR_PX)).astype(float) for figure in (one, other))
    return float(np.abs(first - second).mean())


def test_runs_without_complaint(ran: Ran) -> None:
    assert ran.printed
    assert ran.complained == ""


def test_draws_the_figure_that_is_shown(ran: Ran) -> None:
    assert difference(picture(SHOWN / ran.figure.name), picture(ran.figure)) < ALIKE


def test_every_figure_shown_is_made_by_an_example() -> None:
    assert {path.stem for path in SHOWN.glob("*.png")} == {path.stem for path in EXAMPLES}
