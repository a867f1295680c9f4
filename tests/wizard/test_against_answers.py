"""Typed jig and material against pictures of them: what would fit is named, and nothing is enough until it is right."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from vbaa_calib.antenna.materials import MATERIALS
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import read_gray, read_picture
from vbaa_calib.wizard import steps
from vbaa_calib.wizard.against_answers import (
    antenna_diagnoses,
    camera_place,
    draw_axes,
    entries_that_show_it,
)
from vbaa_calib.wizard.asking import change
from vbaa_calib.wizard.session_state import SessionState, still_of
from vbaa_calib.wizard.store import Store
from vbaa_calib.wizard.ui import Ui

from .small_session import answers, answers_file, call, rendered

MADE_OF, OTHER = "stainless steel", "nylon"
RIGHT = {"jig_translation_mm": [28.0, 61.0, -9.0], "jig_board_x": "x", "jig_board_y": "-y"}


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wizard's session up to the free antenna, all answers right; never to be written to."""
    folder = tmp_path_factory.mktemp("answers")
    source = Path(shutil.copytree(rendered(), folder / "source", ignore=shutil.ignore_patterns("loads")))
    given = answers(source) | {"material": MADE_OF}
    call(folder / "session", "--answers", answers_file(folder / "answers.yaml", given))
    return folder / "session"


@pytest.fixture
def state(taken: Path, tmp_path: Path) -> Iterator[SessionState]:
    with Store(Path(shutil.copytree(taken, tmp_path / "session"))) as store:
        yield SessionState(store)


def named(state: SessionState) -> str:
    """What is said of the first free picture, found where the answers put it or not; "" where all is well."""
    first = state.store.journal.of("noload").taken[0]
    path = state.store.path(first)
    still, image = still_of("noload", path, first.readings), read_picture(path)
    try:
        state.observe(still, "noload", image)
    except InputError:
        return entries_that_show_it(state, still, "noload", image)
    return " ".join(one.remedy for one in antenna_diagnoses(state, together=False))


def test_right_answers_are_not_questioned(state: SessionState) -> None:
    assert named(state) == ""
    assert antenna_diagnoses(state) == []
    assert camera_place(state, state.plane().estimates[0].T_antenna_camera)[1] == []


SLIPS: list[dict[str, Any]] = [
    {"jig_translation_mm": [28.0, 61.0, 9.0]},
    {"jig_translation_mm": [28.0, -61.0, -9.0]},
    {"jig_translation_mm": [-28.0, 61.0, -9.0]},
    {"jig_translation_mm": [61.0, 28.0, -9.0]},
    {"jig_translation_mm": [2.8, 6.1, -0.9]},
    {"jig_translation_mm": [28.0 / 25.4, 61.0 / 25.4, -9.0 / 25.4]},
    {"jig_board_x": "-x", "jig_board_y": "y"},
    {"jig_board_x": "y", "jig_board_y": "x"},
]


def expect_named(slip: dict[str, Any], state: SessionState) -> None:
    state.store.answer(slip)
    words = named(state)
    for key in slip:
        right = RIGHT[key]
        if isinstance(right, str):
            assert f"`{key} = {right}`" in words
        else:
            entries = re.findall(rf"`{key} = ([^`]*)`", words)
            assert any(np.allclose([float(one) for one in entry.split(",")], right, atol=0.02) for entry in entries)


@pytest.mark.parametrize("slip", [SLIPS[index] for index in np.random.default_rng(4).permutation(len(SLIPS))[:1]])
def test_a_slip_in_the_jig_is_named_with_the_entry_that_fits(slip: dict[str, Any], state: SessionState) -> None:
    expect_named(slip, state)


@pytest.mark.slow
@pytest.mark.parametrize("slip", SLIPS)
def test_every_slip_in_the_jig_is_named(slip: dict[str, Any], state: SessionState) -> None:
    expect_named(slip, state)


def test_another_material_is_named_and_nothing_is_enough_before(state: SessionState) -> None:
    """And once it is right, the step goes on: the numbers that follow from the material are others, too."""
    right = state.session.antenna
    assert change(state, Ui(), "material", OTHER)
    assert state.session.antenna.youngs_modulus_Pa == pytest.approx(MATERIALS[OTHER].youngs_modulus_Pa)
    (doubt,) = [one for one in antenna_diagnoses(state) if "material" in one.name]
    assert MADE_OF in doubt.remedy
    now = steps.STEP_BY_NAME["noload"].progress(state)
    assert not now.enough
    assert "more will not help" not in now.next
    assert change(state, Ui(), "material", MADE_OF)
    assert state.session.antenna == right
    assert antenna_diagnoses(state) == []


def test_the_axes_are_drawn_where_the_answers_put_them(state: SessionState) -> None:
    """The drawing differs from the picture along the antenna as typed, and there alone beside the board's axes."""
    image = read_gray(state.store.path(state.taken("plane")[-1]))
    path, drawn = draw_axes(state, image, in_jig=True)
    assert path.exists()
    assert cv2.imread(str(path)).shape == drawn.shape
    coloured = np.ptp(drawn.astype(int), axis=2) > 60
    pose = state.plane().estimates[0].T_antenna_camera.inverse()
    scale = drawn.shape[1] / image.shape[1]
    along = np.linspace(0.05, 0.9, 12) * state.session.antenna.length_m
    pixels, _ = state.lens().camera.project(pose @ np.pad(along[:, None], ((0, 0), (0, 2))))
    inside = pixels[state.lens().camera.in_picture(pixels)]
    assert len(inside) > 3
    for u, v in (scale * (inside + 0.5) - 0.5).round().astype(int):
        assert coloured[max(v - 2, 0) : v + 3, max(u - 2, 0) : u + 3].any()
    assert coloured.mean() < 0.1
