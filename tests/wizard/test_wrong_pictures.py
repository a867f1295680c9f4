"""Pictures that are of no use: each is left with its reason, and where too few remain the step says what is missing."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.core.images import read_gray

from .small_session import answers, answers_file, call, expect_line, rendered

Change = Callable[[np.ndarray], np.ndarray]


def repainted(tmp_path: Path, folder: str, change: Change, which: slice = slice(None)) -> Path:
    """A copy of the rendered rig with pictures of a folder changed; answers.yaml fits it."""
    source = Path(shutil.copytree(rendered(), tmp_path / "source"))
    for path in sorted((source / folder).glob("*.png"))[which]:
        assert cv2.imwrite(str(path), change(read_gray(path)))
    answers_file(tmp_path / "answers.yaml", answers(source))
    return source


def expect(outcome: tuple[int, str], count: int, reason: str, last: Iterable[str]) -> None:
    """Exit 2; so many pictures were left for this reason; the last line holds these words."""
    expect_line(outcome, *last)
    left = [line.strip() for line in outcome[1].splitlines() if line.strip().startswith("left ")]
    assert len(left) == count
    assert all(reason in line for line in left), left


@pytest.mark.slow
def test_the_lens(tmp_path: Path) -> None:
    source = repainted(tmp_path, "intrinsics", lambda picture: np.ascontiguousarray(picture[:, ::-1]))
    for number in range(4):
        (source / "intrinsics" / f"board_00{number}.png").unlink()
    outcome = call(tmp_path / "session", "--answers", tmp_path / "answers.yaml")
    expect(outcome, 1, "mirror", ("Lens", "intrinsics", "add pictures there and run it again"))


@pytest.mark.slow
def test_no_antenna(tmp_path: Path) -> None:
    repainted(tmp_path, "noload", lambda picture: np.full_like(picture, 90))
    outcome = call(tmp_path / "session", "--answers", tmp_path / "answers.yaml")
    expect(outcome, 2, "antenna", ("Free antenna", "noload", "add pictures there"))
