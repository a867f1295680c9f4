"""Small sessions, rendered once a test run or of tiny pictures, and wrong calls on them that must cost nothing."""

from __future__ import annotations

import hashlib
import io
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from vbaa_calib.cli.main import main
from vbaa_calib.core.files import read_yaml, write_json, write_text
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.sources.files import Picture
from vbaa_calib.wizard import flow
from vbaa_calib.wizard.questions import PICTURES
from vbaa_calib.wizard.session_state import SessionState
from vbaa_calib.wizard.steps import REPORT, RIG, PictureCheck, Progress, Step
from vbaa_calib.wizard.store import LOCK

from ..made_once import made_once
from ..small_scene import simulated, small_scene


def rendered() -> Path:
    """The session as a camera's program would leave it, with session.yaml and tables. Never to be written to."""
    return made_once("rendered", _render) / "session"


def _render(folder: Path) -> None:
    shutil.rmtree(simulated(folder, small_scene(noload=2, loads=(1, 8))) / "recording")


def answers(source: Path) -> dict[str, Any]:
    """All that the wizard asks about the small rig, its pictures in `source`."""
    board = read_yaml(source / "session.yaml")["board"]
    size_m = board["square_m"] * board["squares_x"], board["square_m"] * board["squares_y"]
    return answers_with(source / "session.yaml", size_m, source)


def answers_with(board: Path, size_m: tuple[float, float], source: Path) -> dict[str, Any]:
    """The same with a board of this file and size."""
    return {
        "board": str(board),
        "board_along_x_mm": 1e3 * size_m[0],
        "board_along_y_mm": 1e3 * size_m[1],
        "source": str(source),
        "antenna_length_mm": 240,
        "camera_distance_mm": 370,
        "camera_inclination_deg": 30,
        "plane_way": "jig",
        "jig_translation_mm": [28, 61, -9],
        "jig_board_x": "x",
        "jig_board_y": "-y",
        "jig_turn_deg": [0, 0, 1],
        "material": "stainless steel",
        "antenna_diameter_mm": 0.8,
    }


def answers_file(path: Path, given: Mapping[str, Any]) -> Path:
    """An answers file."""
    path.write_text(yaml.safe_dump(dict(given)))
    return path


def call(*argv: object) -> tuple[int, str]:
    """`vbaa wizard ... --batch` in this process: exit code, and what it said on stderr."""
    said = io.StringIO()
    with redirect_stderr(said):
        code = main(["wizard", *map(str, argv), "--batch"])
    return code, said.getvalue()


def tree(root: Path, besides: str = "aside/") -> dict[str, str]:
    """File → hash of everything that counts: the lock does not, nor what lies under `besides`."""
    found = {}
    for folder, _, names in os.walk(root):
        for path in (os.path.join(folder, name) for name in names if name != LOCK):
            name = os.path.relpath(path, root)
            if not (besides and name.startswith(besides)):
                with open(path, "rb") as stream:
                    found[name] = hashlib.sha256(stream.read()).hexdigest()
    return found


ROWS = {
    "noload": "image,pan_rad,tilt_rad,moment_Nm\n1.png,0,0,0.001\n2.png,0,0.3,0.002\n",
    "loads": "image,pan_rad,tilt_rad,moment_Nm,distance_m,force_y_N,force_z_N\n1.png,0,0,0.01,0.1,0,-0.05\n",
    "sweep": "image,pan_rad,tilt_rad\n1.png,0,0\n2.png,0.1,0\n",
}
"""Tables of the tiny source."""


def tiny_source(folder: Path) -> Path:
    """Folders of tiny pictures with their tables, for steps that do not look at them."""
    rng = np.random.default_rng(3)
    pictures = {"intrinsics": ("1", "2", "bad", "3"), "plane": "1", "noload": "12", "loads": "1", "sweep": "12"}
    for name, names in pictures.items():
        (folder / name).mkdir(parents=True)
        for path in (folder / name / f"{one}.png" for one in names):
            assert cv2.imwrite(str(path), rng.integers(0, 255, (12, 16), np.uint8))
            os.utime(path, (1e9, 1e9))
        if name in ROWS:
            (folder / name / f"{name}.csv").write_text(ROWS[name])
    board = read_yaml(bundled_scene("demo"))["board"]
    (folder / "session.yaml").write_text(yaml.safe_dump({"board": board}))
    return folder


def unseen_steps() -> dict[str, Step]:
    """Steps for which every picture is good but those named bad, and any number is enough: all but seeing."""

    def check(state: SessionState, picture: Picture, readings: Mapping[str, float] | None) -> PictureCheck:
        return PictureCheck("is bad" if picture.name.startswith("bad") else "")

    def progress(state: SessionState) -> Progress:
        return Progress(usable=True)

    steps = {name: replace(flow.STEP_BY_NAME[name], check=check, progress=progress) for name in PICTURES}
    return steps | {"sensor": replace(flow.STEP_BY_NAME["sensor"], progress=progress)}


def unseen_conclude(root: Path, *_: object) -> dict[str, Any]:
    """A verdict that only says which pictures there were."""
    write_json(root / RIG, {"pictures": sorted(name for name in tree(root) if name.endswith(".png"))})
    write_text(root / REPORT, "report")
    return {
        "words": "done",
        "headline": "done",
        "verdict": "trust",
        "session_findings": [],
        "findings": [],
        "numbers": {},
    }


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


def expect_line(outcome: tuple[int, str], *words: str) -> None:
    """Exit 2; the last line, and no other, is of an error, and holds these words and a remedy."""
    code, said = outcome
    last = said.strip().splitlines()[-1]
    assert code == 2, said
    assert said.count("vbaa: ") == 1
    assert last.startswith("vbaa: ")
    assert "; " in last, f"no remedy: {last}"
    assert "Traceback" not in said
    assert all(word in last for word in words), f"{words} not in {last!r}"


def expect_refused(tiny: Tiny, outcome: tuple[int, str], *words: str) -> None:
    """As `expect_line`, and every picture is still there."""
    expect_line(outcome, *words)
    if tiny.session.is_dir():
        assert pictures(tiny.session) >= pictures(tiny.source) - pictures(tiny.source / "sweep") - {bad(tiny.source)}


def bad(source: Path) -> str:
    """Hash of the picture that the wizard leaves."""
    return tree(source)["intrinsics/bad.png"]
