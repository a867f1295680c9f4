"""rig.json: what is written is what is read, and what is not a rig is refused by key."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator import Contact, ContactEstimator
from estimator.table.contacts import LOCATED, STATUSES
from tests.estimator.drawn_frames import path_px, rig_of, shape
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.geometry.covariance import is_covariance
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor, Rig, Tip, WrenchSensor
from vbaa_calib.session import DRIFTS

SIZE = len(RIG_PARAMETERS)


def make_rig(seed: int = 0) -> Rig:
    """An inclined camera with distortion, and a full joint covariance in the parameters' own units."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(SIZE, SIZE)) * np.geomspace(1e-6, 1e-2, SIZE)[:, None]
    lens = rng.normal(size=(8, 8))
    return Rig(
        camera=Camera(
            "opencv",
            (960, 720),
            np.array([[1004.0, 0, 476.5], [0, 1001.0, 363.2], [0, 0, 1]]),
            np.array([-0.182, 0.061, 0.0007, -0.0005]),
            covariance=lens @ lens.T,
        ),
        T_antenna_camera=Pose(
            Rotation.from_euler("xyz", [170 + rng.uniform(-20, 20), rng.uniform(-20, 20), 3], degrees=True).as_matrix(),
            np.array([0.12, 0.03, 0.35]) + rng.normal(size=3) * 0.01,
        ),
        antenna=Antenna(
            0.24,
            0.0008,
            np.array([*rng.normal(size=6) * 0.01, math.log(3.9e-3 * rng.uniform(0.9, 1.1)), math.log(3.97e-3), 1e-4]),
        ),
        moment_sensor=MomentSensor(1.0 + rng.normal() * 0.05, rng.normal() * 1e-4, 2e-5),
        kinematics=Kinematics(
            Pose.from_rotvec(rng.normal(size=3) * 0.1, rng.normal(size=3) * 0.01), rng.normal(size=3)
        ),
        gravity_world_m_s2=np.array([0.0, 0.0, -9.80665]),
        image=AntennaImage(0.1, 1.3, False),
        covariance=factor @ factor.T,
    )


@pytest.fixture
def good() -> dict[str, Any]:
    return make_rig().to_dict()


def test_a_sensor_that_cannot_be_is_refused_with_its_file(good: dict[str, Any]) -> None:
    good["wrench_sensor"] = WrenchSensor.about_z(MomentSensor(1.0, 0.0, 2e-5)).to_dict() | {"covariance": [[1.0], []]}
    with pytest.raises(InputError, match=r"^some/rig.json: .*rows of different lengths"):
        Rig.from_dict(good, "some/rig.json")


def nodes(data: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Paths to every mapping in a rig."""
    if not isinstance(data, dict):
        return []
    return [path, *(found for key, value in data.items() for found in nodes(value, (*path, key)))]


def at(data: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        data = data[key]
    return data


@pytest.mark.parametrize("path", nodes(make_rig().to_dict()))
def test_keys_of_later_versions_are_ignored_everywhere(good: dict[str, Any], path: tuple[str | int, ...]) -> None:
    expected = Rig.from_dict(good).to_dict()
    at(good, path)["added_by_a_later_version"] = {"any": "thing"}
    assert Rig.from_dict(good).to_dict() == expected


def leaves(data: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Paths to everything in a rig that holds nothing itself; rows of the joint covariance count as one."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    within = [found for key, value in items for found in leaves(value, (*path, key))]
    return within if within and path[:2] != ("joint", "covariance") else [path]


def mutant(value: Any, rng: np.random.Generator) -> Any:
    """Something else in its place: for a number one that is off by anything from a little to out of this world."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return (None, "x", [], {}, 7, [1.0])[rng.integers(6)]
    scaled = (value or 1.0) * 10.0 ** rng.uniform(-12, 12)
    slightly = (value or 1.0) * 10.0 ** rng.uniform(-1, 1)
    return (scaled, slightly, slightly, -value, 0, 1e300, -1e-300)[rng.integers(7)]


def fate(path: Path, pixels: np.ndarray) -> Contact | None:
    """What one frame becomes with the rig in a file; None where the rig is refused."""
    try:
        return ContactEstimator(Rig.load(path)).estimate(pixels, moment=-2e-3, pan=0.0, tilt=0.0)
    except InputError:
        return None


@pytest.mark.parametrize("count", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_a_rig_out_of_this_world_is_refused_or_leads_to_an_honest_contact(count: int, tmp_path: Path) -> None:
    """Rigs with one to three values changed: an InputError or a status, never a traceback or a NaN in a contact."""
    rig = replace(rig_of((320, 240)), wrench_sensor=WrenchSensor.about_z(MomentSensor(1.0, 0.0, 2e-5)))
    pixels, data, rng = path_px(rig, shape(rig))[::20], rig.to_dict(), np.random.default_rng(6)
    places = np.array(leaves(data), object)
    path, refusals = tmp_path / "rig.json", 0
    for _ in range(count):
        changed = copy.deepcopy(data)
        for place in rng.choice(places, rng.integers(1, 4), replace=False):
            at(changed, place[:-1])[place[-1]] = mutant(at(data, place), rng)
        path.write_text(json.dumps(changed))
        contact = fate(path, pixels)
        refusals += contact is None
        if contact is None:
            continue
        assert contact.status in STATUSES
        if contact.status in LOCATED:
            numbers = [contact.distance_m, contact.distance_std_m, *contact.force_N, *contact.point_world_m]
            assert np.isfinite([*numbers, *contact.covariance_world_m2.flat]).all()
            assert contact.distance_m > 0
    assert count / 3 < refusals < 0.9 * count


def test_a_tip_is_written_and_read_and_goes_with_the_rig() -> None:
    """With a lens that counts as exact, too: what drifts is added to it, and the tip stays the tip."""
    rig = replace(make_rig(), drift=DRIFTS["lab"])
    across = 3e-4 * rig.covariance @ (0.02 / np.sqrt(np.diag(rig.covariance)))
    rig = replace(rig, tip=Tip(1e-4, 3e-4, across))
    read = Rig.from_dict(rig.to_dict())
    assert (read.tip.offset_m, read.tip.std_m) == (1e-4, 3e-4)
    np.testing.assert_array_equal(read.covariance_with_tip, rig.covariance_with_tip)
    for known in (rig, rig.with_covariance(rig.covariance_with_tip)):
        drifted = known.drifted()
        assert drifted.tip.std_m == pytest.approx(3e-4)
        assert is_covariance(drifted.covariance_with_tip)
        assert len(drifted.covariance_with_tip) == len(drifted.covariance) + 1
    moved = rig.moved(np.append(np.zeros(SIZE), 2e-4))
    assert moved.tip.offset_m == pytest.approx(3e-4)
    assert moved.camera.parameters.tolist() == rig.camera.parameters.tolist()
