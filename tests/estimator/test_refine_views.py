"""A second camera: what is edge-on to one is seen from the side by the other."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.setup import ACROSS, Setup, drawn_truth
from benchmarks.object.scenes import AXIS, CASES, CENTRE, RIGID, Recorded, contacts, play
from benchmarks.recording.recording import bound_m, measured
from estimator.recording import Refined, View, refine
from estimator.table.contacts import ContactTable, Measured
from estimator.table.files import read_contacts, write_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.simulate.scene.objects import TouchObject

from ..recordings import SESSION

# the first looks along plane C's normal: pushes along it (ξ = 90°) leave its picture straight
SETUPS = [Setup("brown", tilt_rad, ACROSS, swing_m=0.06, real=True) for tilt_rad in (0.0, 1.0)]
PUSHED_AWAY = [stroke for case in CASES if case.name == "sphere" for stroke in case.strokes if stroke.press == "tilt"]


@cache
def shown() -> list[Recorded]:
    ball = TouchObject("sphere", CENTRE, AXIS, 0.03, 1.0, RIGID, 0.3)
    return [play(setup.rig(), ball, PUSHED_AWAY) for setup in SETUPS]


@cache
def seen(seed: int) -> tuple[list[Recorded], ContactTable, list[list[Measured]]]:
    """The recording by both cameras, each with a calibration of its own, and what the first finds frame by frame."""
    rng = np.random.default_rng((31, seed))
    both = [
        one.noisy(rng, drawn_truth(replace(setup, exact=False).rig(), rng))
        for one, setup in zip(shown(), SETUPS, strict=True)
    ]
    return both, contacts(both[0]), [measured(each) for each in both]


@cache
def alone(seed: int) -> Refined:
    both, table, lines = seen(seed)
    return refine(table, both[0].given, lines[0])


@cache
def together(seed: int) -> Refined:
    both, table, lines = seen(seed)
    return refine(table, both[0].given, lines[0], views=[View(both[1].given, lines[1])])


@pytest.mark.parametrize("draws", [3, pytest.param(12, marks=pytest.mark.slow)])
def test_what_is_edge_on_to_one_camera_is_located_at_the_bound_by_two(draws: int) -> None:
    square, allowed, held = [], [], []
    for seed in range(draws):
        both, table, lines = seen(seed)
        found, truth = together(seed), both[0].truth
        blind = np.flatnonzero(truth.in_contact & ~table.located)
        assert len(blind) > 10
        assert np.mean(found.refined[blind]) > 0.9
        rows = blind[found.refined[blind]]
        off = (found.contacts.point_world_m - truth.point_world_m)[rows]
        true = replace(both[1].true, covariance=both[1].given.covariance)
        bound = bound_m(found.contacts, both[0], lines[0], rows, [View(true, lines[1])])
        std = found.contacts.distance_std_m[rows]
        square.append(np.sum(off**2, axis=1))
        allowed.append(bound**2)
        held.append(np.abs(found.contacts.distance_m[rows] - truth.distance_m[rows]) < 1.96 * std)
    assert np.sqrt(np.concatenate(square).mean() / np.concatenate(allowed).mean()) < 1.15
    assert np.concatenate(held).mean() > 0.9


def test_another_view_of_the_same_frames_tells_more() -> None:
    """Of frames that the first camera locates, too: no deviation grows, most shrink."""
    rows = np.flatnonzero(alone(0).refined & together(0).refined)
    ratio = together(0).contacts.distance_std_m[rows] / alone(0).contacts.distance_std_m[rows]
    assert ratio.max() < 1.05
    assert np.median(ratio) < 0.8


def test_a_camera_that_saw_nothing_changes_nothing() -> None:
    both, table, lines = seen(0)
    dark = [replace(each, points_px=np.zeros((0, 2)), sigma_px=np.zeros(0)) for each in lines[1]]
    found = refine(table, both[0].given, lines[0], views=[View(both[1].given, dark)])
    before, rows = alone(0).contacts, alone(0).refined
    assert (found.refined == rows).all()
    std = before.distance_std_m[rows]
    assert np.abs(found.contacts.distance_m - before.distance_m)[rows] / std == pytest.approx(0.0, abs=1e-3)
    assert found.contacts.distance_std_m[rows] == pytest.approx(std, rel=1e-3)


def written(recorded: Recorded, lines: list[Measured], folder: Path) -> tuple[Path, Path]:
    """rig.json and session of a camera."""
    session = folder / "session"
    (session / "recording").mkdir(parents=True)
    (session / "session.yaml").write_text(SESSION.replace("drift: lab\n", ""))
    (folder / "rig.json").write_text(json.dumps(recorded.given.to_dict()))
    rows, points = ["frame,time_s,pan_rad,tilt_rad,moment_Nm"], ["frame,u_px,v_px,sigma_px"]
    for frame, each in enumerate(lines):
        rows.append(f"{frame},{each.time_s!r},{each.pan_rad!r},{each.tilt_rad!r},{each.moment_Nm!r}")
        pixels = each.points_px[np.isfinite(each.points_px).all(axis=1)].tolist()
        points += [f"{frame},{u!r},{v!r},{recorded.sigma_px}" for u, v in pixels]
    (session / "recording" / "recording.csv").write_text("\n".join(rows) + "\n")
    (session / "recording" / "centrelines.csv").write_text("\n".join(points) + "\n")
    return folder / "rig.json", session


def test_the_command_takes_two_cameras(tmp_path: Path) -> None:
    both, table, lines = seen(0)
    places = [written(one, seen_by, tmp_path / name) for one, seen_by, name in zip(both, lines, "ab", strict=True)]
    (rig, session), (other_rig, other_session) = places
    write_contacts(tmp_path / "contacts.csv", table.rows())
    call = f"refine {tmp_path}/contacts.csv --rig {rig} --session {session} -o {tmp_path}/refined.csv --view"
    assert main([*call.split(), str(other_rig), str(other_session)]) == 0
    found, expected = read_contacts(tmp_path / "refined.csv"), together(0).contacts
    rows = together(0).refined
    off = np.abs(found.distance_m - expected.distance_m)[rows] / expected.distance_std_m[rows]
    assert off.max() < 0.05
