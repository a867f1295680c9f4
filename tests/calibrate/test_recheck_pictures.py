"""The check of one new picture each, with rig.json alone or its session; its numbers by another way to them."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from vbaa_calib.calibrate.check.assessment import Assessment, _plane_map, assess
from vbaa_calib.calibrate.check.finding import Discrepancy, Finding
from vbaa_calib.core.least_squares import change_test, products
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.write import _session_yaml

from .checked_rigs import QUALITY, answers, one_picture_each, rig_document, rig_of, scene


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A rig.json that records board and jig, one that does not, session.yaml, and two pictures of an unchanged rig."""
    folder = tmp_path_factory.mktemp("pictures")
    (folder / "rig.json").write_text(json.dumps(rig_document(scene())))
    (folder / "old.json").write_text(json.dumps(rig_of(scene()).to_dict() | {"quality": QUALITY}))
    (folder / "session").mkdir()
    (folder / "session" / "session.yaml").write_text(_session_yaml(scene()))
    new = one_picture_each(scene(), folder)
    return SimpleNamespace(folder=folder, rig=folder / "rig.json", old=folder / "old.json", new=new)


def answer(found: Assessment, name: str) -> Finding:
    return next(one for one in found.session.findings if one.name == name)


def test_rig_json_alone_says_which_board_and_which_jig(made: SimpleNamespace) -> None:
    found = assess(made.rig, None, made.new)
    assert found.verdict == "holds", found.words
    levels = answers(found)
    assert levels["camera_pose"] == levels["free_antenna"] == levels["sensor_offset"] == "holds"
    assert levels["stiffness"] == levels["sensor_gain"] == "not given"
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["session"]["given"] == ["plane", "noload"]


def test_unknowns_of_the_data_alone_are_what_further_parameters_would_be() -> None:
    """Data with unknowns of their own say what all say together when those are solved for, known to one deviation."""
    rng = np.random.default_rng(5)
    jacobian, residuals, unknown = rng.normal(size=(40, 3)), rng.normal(size=40), 3.0 * rng.normal(size=(40, 2))
    found = products(jacobian, residuals, unknown)
    whole = np.vstack([np.hstack([jacobian, unknown]), np.hstack([np.zeros((2, 3)), np.eye(2)])])
    right = np.concatenate([residuals, [0.0, 0.0]])
    np.testing.assert_allclose(np.linalg.inv(found[:3, :3]), np.linalg.inv(whole.T @ whole)[:3, :3], rtol=1e-9)
    step = np.linalg.lstsq(whole, right, rcond=None)[0][:3]
    np.testing.assert_allclose(np.linalg.solve(found[:3, :3], found[:3, 3]), step, rtol=1e-9)


def test_the_map_on_plane_c_is_what_sampling_gives() -> None:
    """Rigs drawn from the joint covariance: points on plane C scatter as the map says."""
    rig = rig_of(scene())
    rng, pixels = np.random.default_rng(0), np.array([[200.0, 300.0], [480.0, 360.0], [800.0, 600.0]])
    covariance = rig.plane_covariance()
    draws = rng.multivariate_normal(np.zeros(len(covariance)), covariance, size=200, method="eigh")
    found = np.array([moved(rig, draw).camera_on_plane().project(pixels)[0] for draw in draws])
    worst_std = [np.sqrt(np.linalg.eigvalsh(np.cov(found[:, index].T))[-1]) for index in range(3)]
    jacobian = rig.camera_on_plane().calibration_jacobian(pixels)
    own = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    np.testing.assert_allclose(worst_std, np.sqrt(np.linalg.eigvalsh(own)[:, -1]), rtol=0.12)
    grid_px, std_mm = _plane_map(rig)
    row, column = 18, 24
    again = rig.camera_on_plane().calibration_jacobian(grid_px[row, column][None])[0]
    expected = 1e3 * np.sqrt(np.linalg.eigvalsh(again @ covariance @ again.T)[-1])
    assert std_mm[row, column] == pytest.approx(expected)


def moved(rig: Rig, draw: np.ndarray) -> Rig:
    """Lens and camera pose off by one draw."""
    return replace(rig, camera=rig.camera.moved(draw[:-6]), T_antenna_camera=rig.T_antenna_camera.retract(draw[-6:]))


def test_a_change_is_estimated_as_plain_least_squares_does_it() -> None:
    """Against the textbook's generalised least squares with the whole (N, N) covariance; 300 draws for the spread."""
    rng = np.random.default_rng(1)
    jacobian = rng.normal(size=(40, 5))
    root = rng.normal(size=(5, 5)) * np.array([1, 0.1, 2, 0.5, 1])[:, None]
    covariance, wanted, scale = root @ root.T, np.array([1, 3]), np.full(5, 3.0)
    whole = np.eye(40) + jacobian @ covariance @ jacobian.T
    loosened = covariance + np.diag([0, 0, 0, 0, (100 * 3.0) ** 2])
    distances = []
    for _ in range(300):
        residuals = jacobian @ (root @ rng.normal(size=5)) + rng.normal(size=40)
        found = change_test(products(jacobian, residuals), covariance, wanted, scale)
        design = np.linalg.solve(whole, jacobian[:, wanted])
        expected = np.linalg.solve(jacobian[:, wanted].T @ design, design.T @ residuals)
        np.testing.assert_allclose(found.values, expected, rtol=1e-6, atol=1e-9)
        distances.append(found.distance_std**2)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(jacobian[:, wanted].T @ design), rtol=1e-6)
    assert found.freedom == 2
    # χ² with two degrees of freedom has the mean 2; its mean over 300 draws scatters by 0.12
    assert np.mean(distances) == pytest.approx(2.0, abs=0.45)
    free = change_test(products(jacobian, residuals), covariance, wanted, scale, (4,))
    design = np.linalg.solve(np.eye(40) + jacobian @ loosened @ jacobian.T, jacobian[:, wanted])
    expected = np.linalg.solve(jacobian[:, wanted].T @ design, design.T @ residuals)
    np.testing.assert_allclose(free.values, expected, rtol=1e-5)


def test_a_difference_counts_only_when_improbable_and_large() -> None:
    def level(distance: float, size: float) -> str:
        return Discrepancy(distance, 6, size, 0.1, "mm").level

    assert Discrepancy(0.0, 1, 0.0, 0.1, "mm").limits_std == (
        pytest.approx(3.55, abs=0.01),
        pytest.approx(5.0, abs=0.01),
    )
    assert level(100.0, 0.09) == level(2.0, 5.0) == "holds"
    assert level(100.0, 0.15) == level(5.5, 5.0) == "look at"
    assert level(100.0, 0.3) == "does not hold"
