"""Pictures that are of no use: each is left with its reason, and where too few remain the step says what is missing."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.core.images import read_gray
from vbaa_calib.wizard import flow

from .small_session import answers, answers_file, call, expect_line, rendered, unseen_steps

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


LENS: dict[str, tuple[Change, str]] = {
    "mirrored": (lambda picture: np.ascontiguousarray(picture[:, ::-1]), "mirror"),
    "grey": (lambda picture: np.full_like(picture, 90), "no marker of the board is seen; show the whole board"),
    "black": (np.zeros_like, "the picture is dark"),
}


@pytest.mark.parametrize("name", LENS)
def test_the_lens(name: str, tmp_path: Path) -> None:
    change, reason = LENS[name]
    source = repainted(tmp_path, "intrinsics", change)
    for number in range(4):
        (source / "intrinsics" / f"board_00{number}.png").unlink()
    outcome = call(tmp_path / "session", "--answers", tmp_path / "answers.yaml")
    expect(outcome, 1, reason, ("Lens", "intrinsics", "add pictures there and run it again"))


def test_no_antenna(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    repainted(tmp_path, "noload", lambda picture: np.full_like(picture, 90))
    outcome = call(tmp_path / "session", "--answers", tmp_path / "answers.yaml")
    expect(outcome, 2, "antenna", ("Free antenna", "noload", "add pictures there"))


def test_files_that_are_no_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is named, and passed by; what is cut off would be half a picture."""
    for name, step in unseen_steps().items():
        monkeypatch.setitem(flow.STEP_BY_NAME, name, step)
    source = repainted(tmp_path, "intrinsics", lambda picture: picture, slice(0))
    for name, content in (("a.png", b""), ("b.png", b"text"), ("c.jpg", b"\xff\xd8\xff\xe0")):
        (source / "intrinsics" / name).write_bytes(content)
    whole = (source / "intrinsics" / "board_000.png").read_bytes()
    (source / "intrinsics" / "d.png").write_bytes(whole[: len(whole) // 2])
    (source / "plane").joinpath("jig_000.png").unlink()
    code, said = call(tmp_path / "session", "--answers", tmp_path / "answers.yaml")
    assert code == 2
    for name in ("a.png", "b.png", "c.jpg", "d.png"):
        assert sum(f"/{name}: " in line or f" {name}: " in line for line in said.splitlines()) == 1, said
    assert said.strip().splitlines()[-1].endswith("files into it")
