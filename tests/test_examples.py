"""The examples run, warn of nothing and draw their figure."""

from __future__ import annotations

import contextlib
import io
import runpy
import sys
import warnings
from pathlib import Path

import cv2
import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
LONG = ("06_calibrating_a_session", "09_the_ladder")
"""They take ten seconds."""


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG)) for path in EXAMPLES]
)
def test_it_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "argv", [str(path), "--figures", str(tmp_path)])
    monkeypatch.syspath_prepend(str(path.parent))
    with warnings.catch_warnings(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".torch.jit.script. is deprecated", DeprecationWarning)
        runpy.run_path(str(path), run_name="__main__")
    assert out.getvalue()
    assert err.getvalue() == ""
    assert cv2.imread(str(tmp_path / f"{path.stem}.png")) is not None
