"""Inputs moved by 1e-12 of themselves, and in another order, move no answer: rounding decides nothing.

The answers of every stage, from detected corners to the object felt: no reported number by more than `MOST` of its
deviation, and no status. A short form here; all scenes, lenses and photo sets among the slow tests.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import vbaa_calib.calibrate.pipeline as calibration
import vbaa_calib.calibrate.plane_c as session_plane
from benchmarks.estimator.hard import CASES, Hard
from benchmarks.processors import WAYS, Report, apart, of_budget, of_contacts, of_lens, of_rig, simulated
from estimator import ContactEstimator
from estimator.budget.budget import error_budget
from estimator.contact.recording import estimate_pictures
from estimator.table.contacts import ContactRow, ContactTable
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.calibrate.pipeline import calibrate
from vbaa_calib.cli.main import main
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.rig import Rig
from vbaa_calib.session import Session, load_session, read_recording
from viz.cli.demo import SCENES

from .calibrate.photo_sets import detected
from .small_scene import small_rig, small_scene

MOVED, MOST, MOST_OF_LENS = 1e-12, 1e-4, 1e-6
"""Part of themselves by which the inputs are moved, and part of its deviation by which a number may move."""
Rng = np.random.Generator


def moved(values: np.ndarray, rng: Rng) -> np.ndarray:
    return values * (1.0 + MOVED * rng.uniform(-1.0, 1.0, np.shape(values)))


def held(one: Report, other: Report, most: float = MOST) -> None:
    found = apart(one, other)
    assert found.statuses == []
    assert found.most <= most, f"{found.most:.1e} at {found.where}"


# corners to lens


def moved_view(view: BoardView, rng: Rng) -> BoardView:
    """Every corner moved by nothing, and all of them in another order."""
    order = rng.permutation(len(view.ids))
    return replace(view.picked(order), corners_px=moved(view.corners_px, rng)[order])


LENSES = [
    ("gopro", "auto"),
    ("gopro", "rational"),
    *(
        pytest.param(name, model, marks=pytest.mark.slow)
        for name in ("realsense", "gopro", "ucl_left", "ucl_right")
        for model in ("auto", *LENS_MODELS)
        if (name, model) not in {("gopro", "auto"), ("gopro", "rational")}
    ),
]


@pytest.mark.parametrize(("name", "model"), LENSES)
def test_lenses_of_real_photographs(name: str, model: str) -> None:
    views, spec = detected(name)
    least = 20 if spec.legacy_pattern else 6
    one = of_lens(solve_intrinsics(views, spec, model, least))
    for seed in range(2):
        rng = np.random.default_rng(seed)
        order = rng.permutation(len(views))
        others = [moved_view(views[index], rng) for index in order]
        held(one, of_lens(solve_intrinsics(others, spec, model, least)), MOST_OF_LENS)


# sessions to rigs, contacts, budgets and objects


@dataclass(frozen=True, eq=False)
class Done:
    """A session and a rig that was calibrated for its camera."""

    session: Session
    rig: Rig


def short_session(folder: Path) -> Path:
    """The demo's scene, small; what `small_rig` is calibrated from, with a longer recording."""
    scene = small_scene(noload=3, loads=(1, 3, 8, 9))
    scene["recording"]["sweeps"][0] |= {"frames": 6, "free_frames": 1}
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    assert main(["simulate", str(folder / "scene.yaml"), "-o", str(folder / "session")]) == 0
    return folder / "session"


@pytest.fixture(
    scope="module", params=["short", *(pytest.param(name, marks=pytest.mark.slow) for name in (*SCENES, WAYS))]
)
def done(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Done:
    folder = tmp_path_factory.mktemp("stable")
    if request.param == "short":
        return Done(load_session(short_session(folder)), Rig.load(small_rig() / "rig.json"))
    session = load_session(simulated(folder, [request.param])[request.param])
    return Done(session, calibrate(session).rig)


@pytest.fixture
def moving_corners(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Rng], list[BoardView]]]:
    """What makes every corner that is detected come out moved by nothing, in another order; and the views so moved."""

    def begin(rng: Rng) -> list[BoardView]:
        given: list[BoardView] = []
        for module, name in (
            (calibration, "detect_folder"),
            (session_plane, "detect_folder"),
            (session_plane, "detect_files"),
        ):
            plain = getattr(module, name)

            def detect(*args: Any, plain: Callable[..., Any] = plain) -> list[BoardView]:
                views = [moved_view(view, rng) for view in plain(*args)]
                given.extend(views)
                return views

            monkeypatch.setattr(module, name, detect)
        return given

    return begin


@pytest.mark.slow
def test_calibration(done: Done, moving_corners: Callable[[Rng], list[BoardView]]) -> None:
    """From corners moved by nothing: the antenna is looked for in its pictures along a path that moved by as little."""
    found = calibrate(done.session)
    given = moving_corners(np.random.default_rng(1))
    other = calibrate(done.session)
    assert len(given) > 5
    assert not np.array_equal(found.lens.camera.parameters, other.lens.camera.parameters), "nothing was moved"
    held(of_lens(found.lens), of_lens(other.lens))
    held(of_rig(found.rig), of_rig(other.rig))
    assert found.joint.kept.tolist() == other.joint.kept.tolist()
    assert [str(one) for one in found.still_diagnoses] == [str(one) for one in other.still_diagnoses]


def moved_rig(rig: Rig, rng: Rng) -> Rig:
    """Camera, pose, antenna and sensor moved by nothing, and the covariance so that it stays one."""
    sensor = rig.moment_sensor
    values = [np.ones(6), rig.antenna.parameters, [sensor.gain, sensor.offset_Nm], rig.camera.parameters]
    step = MOVED * rng.uniform(-1.0, 1.0, sum(map(len, values))) * np.concatenate(values)
    turn = 1.0 + MOVED * rng.uniform(-1.0, 1.0, len(rig.covariance))
    return replace(rig.moved(step), covariance=rig.covariance * np.outer(turn, turn))


@cache
def table(rig: Rig, session: Session) -> ContactTable:
    frames = list(read_recording(session))
    found = estimate_pictures(ContactEstimator(rig), frames)
    rows = [ContactRow.of(each.frame, each.contact) for each in found]
    return ContactTable.from_rows(rows)


def test_pictures_to_contacts_and_the_budget(done: Done) -> None:
    """With a rig moved by nothing."""
    other = moved_rig(done.rig, np.random.default_rng(2))
    held(of_contacts(table(done.rig, done.session)), of_contacts(table(other, done.session)))
    held(of_budget(error_budget(done.rig)), of_budget(error_budget(other)))


# centrelines to contacts


def estimated(hard: Hard, rig: Rig, order: Sequence[int], points: Callable[[int], np.ndarray], rng: Rng) -> Report:
    """Frames in an order, points of each as `points` picks them, all of it moved by nothing; reported as they came."""
    scenes = hard.scenes
    lines = [moved(np.asarray(hard.points_px[index], float)[points(index)], rng) for index in order]
    readings = moved(scenes.moment_Nm, rng)[order] if hard.with_moment else None
    found = ContactEstimator(rig).estimate_batch(
        lines, readings, scenes.pan_rad[order], scenes.tilt_rad[order], sigma_px=scenes.sigma_px
    )
    back = np.argsort(order)
    report = of_contacts(found)
    numbers = {name: (values[back], std[back]) for name, (values, std) in report.numbers.items()}
    return Report(numbers, {"status": [report.statuses["status"][index] for index in back]})


@pytest.mark.parametrize("count", [4, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", CASES)
def test_hard_cases_of_the_estimator(name: str, count: int) -> None:
    """Pixels and readings moved by nothing, points and frames in another order."""
    hard = CASES[name](count, np.random.default_rng(7))
    size, rng = hard.points_px.shape[1], np.random.default_rng(4)
    one = estimated(hard, hard.scenes.rig, np.arange(count), lambda _: np.arange(size), rng)
    held(one, estimated(hard, hard.scenes.rig, rng.permutation(count), lambda _: rng.permutation(size), rng))
