"""Where to touch next: what is proposed can be made as it says, and tells more than touches drawn at random."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.setup import drawn_truth
from benchmarks.object.scenes import CASES, RIGID, SETUP, Recorded, contacts, play
from benchmarks.recording import lengthened, played
from estimator.contact.common_errors import shared_errors
from estimator.object.next_touch import JointLimits, NextTouch, next_touch
from estimator.object.next_touch.plan import _Options, _places, _surface_std, _touches_within
from estimator.object.surface import touches_of
from estimator.object.surface.build import fitted, surely_known_m
from estimator.object.surface.fit import SurfaceFit
from estimator.table.contacts import ContactTable
from estimator.table.files import write_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.scene.scene import Joints

CALIBRATED = replace(SETUP, exact=False).rig()
LIMITS = JointLimits((-0.6, 0.6), (-0.6, 0.6))
RANDOM = 4
"""Touches drawn at random, beside the proposed one."""


@cache
def given(frames: int) -> tuple[ContactTable, Rig]:
    """The first strokes of a rigid sphere, by a rig that is off by a draw of its covariance."""
    rng = np.random.default_rng(1)
    rig = drawn_truth(CALIBRATED, rng).with_covariance(CALIBRATED.covariance)
    return contacts(lengthened(played("sphere", RIGID, 0.3), frames).noisy(rng, rig)), rig


def made(one: NextTouch, rig: Rig) -> Recorded:
    """The touch of the sphere as the true rig and the static rod make it: nine frames to the press, and back."""
    begin, press = np.array(one.begin_rad), np.array(one.press_rad)
    path = [begin + share * (press - begin) for share in (*np.linspace(0.0, 1.0, 9), 0.7, 0.4, 0.1, -0.1)]
    obj = next(each for each in CASES if each.name == "sphere").make(RIGID, 0.3)
    return play(SETUP.rig(), obj, [[Joints(*map(float, each)) for each in path]]).noisy(np.random.default_rng(7), rig)


def chosen(options: _Options) -> list[NextTouch]:
    """The best touch, then some at random."""
    possible = np.flatnonzero(np.isfinite(options.std_after))
    best = int(np.nanargmin(options.std_after))
    return [options.chosen(int(i)) for i in (best, *np.random.default_rng(3).choice(possible, RANDOM, replace=False))]


def solved(table: ContactTable, rig: Rig) -> SurfaceFit:
    return fitted(touches_of(table, shared_errors(rig, table)), 0.5 * rig.antenna.diameter_m)[0]


def surface_deviation(table: ContactTable, rig: Rig, place: SurfaceFit, options: _Options) -> float:
    """Rms over where an earlier fit was touched, and could have been."""
    found, square = solved(table, rig), []
    for index, (one, x) in enumerate(zip(place.patches, _places(place, options.reach), strict=True)):
        if one.wide:
            points, normals, _ = place.heights(index, x)
        else:
            points = place.along_curve(index, x[:, 0])[0]
            normals = np.repeat(one.frame[2:], len(x), axis=0)
        away = [
            np.min(np.linalg.norm(points[:, None] - found.point_m[m.members], axis=2), axis=1) for m in found.patches
        ]
        patch = np.argmin(away, axis=0)
        square.append(_surface_std(found, patch, points, normals) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(square))))


@pytest.mark.slow
def test_the_proposed_touch_tells_more_of_the_surface_than_random_ones() -> None:
    """The surface's deviation before, and after the best touch and each of the random ones, simulated."""
    table, rig = given(74)
    options = _touches_within(table, rig, "surface", LIMITS)
    tables, place = [table], solved(table, rig)
    for more in (contacts(made(one, rig)) for one in chosen(options)):
        later = replace(more, frame=more.frame + len(table), time_s=more.time_s + table.time_s[-1] + 1.0)
        tables.append(ContactTable.joined([table, later]))
    before, *rest = (surface_deviation(one, rig, place, options) for one in tables)
    after = np.array(rest)
    assert after[0] < 0.9 * before
    assert before - after[0] > 1.5 * (before - np.median(after[1:]))
    assert before == pytest.approx(options.std, rel=1e-6)
    assert after[0] == pytest.approx(np.nanmin(options.std_after), rel=0.3)


def test_all_of_a_touch_lies_within_the_limits_and_on_what_is_known() -> None:
    table, rig = given(37)
    whole = _touches_within(table, rig, "surface", LIMITS).reach
    narrow = replace(LIMITS, tilt_rad=(-0.6, float(np.median(whole.joints_rad[:, 1]))))
    reach = _touches_within(table, rig, "surface", narrow).reach
    assert 0 < len(reach) < len(whole)
    for joints in (reach.joints_rad, reach.begin_rad):
        assert narrow.hold(*joints.T).all()
    found = solved(table, rig)
    shown = np.array([surely_known_m(found, index) for index in range(len(found.patches))])
    assert (_surface_std(found, whole.patch, whole.point_m, whole.normal) <= shown[whole.patch]).all()
    with pytest.raises(InputError, match="joint limits"):
        next_touch(table, rig, "surface", limits=JointLimits((0.5, 0.6), (0.5, 0.6)))


def test_a_tapered_antenna_touches_with_its_own_radius_there() -> None:
    table, rig = given(37)
    antenna = replace(rig.antenna, profile=((0.0, rig.antenna.diameter_m), (rig.antenna.length_m, 1e-4)))
    thin = replace(rig, antenna=antenna)
    reach = _touches_within(table, thin, "surface", LIMITS).reach
    touches = touches_of(table, shared_errors(thin, table))
    found = fitted(touches, antenna.radius_at(touches.distance_m))[0]
    (patch,) = found.patches
    local = (reach.point_m - patch.center_m) @ patch.frame.T
    off = np.sum((reach.point_m - found.along_curve(0, local[:, 0])[0]) * reach.normal, axis=1)
    give = found.state.compliance_m_N * np.linalg.norm(reach.force_N, axis=1)
    radius = antenna.radius_at(reach.unknowns[:, 0] * antenna.length_m)
    np.testing.assert_allclose(off + give, radius, atol=2e-6)


@pytest.mark.slow
def test_the_verb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, rig = given(74)
    contacts_csv, rig_json, output = tmp_path / "contacts.csv", tmp_path / "rig.json", tmp_path / "next.json"
    write_contacts(contacts_csv, table.rows())
    rig_json.write_text(json.dumps(rig.to_dict()))
    call = ["next", str(contacts_csv), "--rig", str(rig_json), "-o", str(output), "--json"]
    assert main([*call, "--pan", "-35", "35", "--tilt", "-35", "35", "--degrees"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["std_after"] < said["std"]
    assert json.loads(output.read_text())["press_rad"] == said["press_rad"]
    assert main(call) == 2
    assert main([*call, "--force", "--pan", "1", "-1"]) == 2
    assert main([*call, "--force", "--pan", "-20", "20"]) == 2
