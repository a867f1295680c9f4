"""A finished session of tiny pictures, and wrong calls on it that must cost nothing."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from vbaa_calib.wizard import flow

from .small_session import answers, answers_file, call, tiny_source, tree, unseen_conclude, unseen_steps


@dataclass(frozen=True)
class Tiny:
    """A source, the answers that fit it, and a session that was finished with them."""

    source: Path
    answers: Path
    session: Path


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tiny]:
    """Made once a module, never to be written to; while it lives, no step looks at its pictures."""
    folder = tmp_path_factory.mktemp("tiny")
    source = tiny_source(folder / "source")
    made = Tiny(source, answers_file(folder / "answers.yaml", answers(source)), folder / "session")
    with pytest.MonkeyPatch.context() as patch:
        for name, step in unseen_steps().items():
            patch.setitem(flow.STEP_BY_NAME, name, step)
        patch.setattr(flow, "conclude", unseen_conclude)
        code, said = call(made.session, "--answers", made.answers)
        assert code == 0, said
        yield made


@pytest.fixture
def tiny(finished: Tiny, tmp_path: Path) -> Tiny:
    """One of the test's own: all three may be changed."""
    source = Path(shutil.copytree(finished.source, tmp_path / "source"))
    session = Path(shutil.copytree(finished.session, tmp_path / "session"))
    return Tiny(source, answers_file(tmp_path / "answers.yaml", answers(source)), session)


def pictures(root: Path) -> set[str]:
    """Hashes of all pictures in a session, those put aside too."""
    return {digest for name, digest in tree(root, "").items() if name.endswith(".png")}


def expect_refused(tiny: Tiny, outcome: tuple[int, str], *words: str) -> None:
    """Exit 2, one line with these words and a remedy, and every picture is still there."""
    code, said = outcome
    last = said.strip().splitlines()[-1]
    assert code == 2, said
    assert said.count("vbaa: ") == 1
    assert "; " in last, f"no remedy: {last}"
    assert "Traceback" not in said
    for word in words:
        assert word in last, f"{word!r} is not in {last!r}"
    if tiny.session.is_dir():
        assert pictures(tiny.session) >= pictures(tiny.source) - pictures(tiny.source / "sweep") - {bad(tiny.source)}


def bad(source: Path) -> str:
    """Hash of the picture that the wizard leaves."""
    return tree(source)["intrinsics/bad.png"]
