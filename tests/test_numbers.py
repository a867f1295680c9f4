"""What numbers a call takes: every kind that is a number, in sizes that its unit allows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from estimator import ContactEstimator, Measured
from vbaa_calib.core.arrays import as_floats
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams import Reading, Taken

from .estimator.contact_scenes import RIG

SOUND: tuple[Any, ...] = (
    *(1, 1.0, np.float32(1.0), np.int8(1), np.array(1.0, np.float16), [1, 2.0, None], (1, np.float64(2.0))),
    *(np.ma.array([1.0, 2.0], mask=[True, False]), [], np.array([1, None], object)),
)
WRONG: tuple[Any, ...] = (
    *("1", True, 1j, ["1"], [True, 1.0], [1j], b"1", np.array(["1"]), np.array([True]), np.array([1j]), {}, {1: 2}),
    *([[1.0], [1.0, 2.0]], object(), [np.datetime64(0, "s")], np.array([10**400], object), lambda: 1.0),
)


@pytest.mark.parametrize("values", SOUND, ids=lambda value: type(value).__name__)
def test_numbers_of_every_kind_are_taken(values: Any) -> None:
    found = as_floats(values, "it", "give numbers")
    assert found.dtype == np.float64
    assert type(found) is np.ndarray


def test_what_is_masked_is_missing() -> None:
    found = as_floats(np.ma.array([[1, 2], [3, 4]], mask=[[0, 1], [0, 0]]), "it", "give numbers")
    np.testing.assert_array_equal(found, [[1.0, np.nan], [3.0, 4.0]])


@pytest.mark.parametrize("values", WRONG, ids=lambda value: type(value).__name__)
def test_what_is_no_number_is_refused(values: Any) -> None:
    with pytest.raises(InputError, match="it is"):
        as_floats(values, "it", "give numbers")


POINTS = np.column_stack([np.linspace(100.0, 500.0, 60), np.full(60, 240.0)])


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pan": 12.0}, "pans.0. is 12.*radians"),
        ({"tilt": -57.3}, "tilts.0. is -57.3.*radians"),
        ({"tilt": np.nan}, "tilts"),
        ({"pan": True}, "pans"),
        ({"tilt": "0"}, "tilts"),
        ({"moment": 1020.0}, "moments.0. is 1020.*N·m"),
        ({"moment": np.inf}, "moments.* is inf"),
        ({"moment_z": -np.inf}, "moments_z.* is -inf"),
        ({"moment": False}, "moments"),
        ({"moment": 1j}, "moments"),
        ({"centreline_px": np.zeros((3, 5))}, "centreline_px has shape"),
        ({"centreline_px": np.zeros(8)}, "centreline_px has shape"),
        ({"centreline_px": 1e9 * POINTS}, "centrelines_px"),
        ({"centreline_px": POINTS.astype(str)}, "centreline_px"),
        ({"centreline_px": POINTS + 1j}, "centreline_px"),
        ({"sigma_px": "0.1"}, "sigma_px"),
        ({"sigma_px": -0.1}, "sigma_px"),
        ({"sigma_px": np.full(7, 0.1)}, "sigma_px has shape"),
        ({"sigma_px": 0.0}, "not everywhere positive"),
        ({"sigma_px": np.nan}, "not everywhere positive"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_the_estimator_takes_nothing_in_silence(changed: dict[str, Any], words: str) -> None:
    call: dict[str, Any] = {"centreline_px": POINTS, "moment": 0.001, "pan": 0.1, "tilt": 0.0} | changed
    with pytest.raises(InputError, match=words):
        ContactEstimator(RIG).estimate(call.pop("centreline_px"), **call)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pan_rad": 12.0}, "pan_rad is 12.*radians"),
        ({"tilt_rad": 1e300}, "tilt_rad"),
        ({"pan_rad": "0"}, "pan_rad"),
        ({"moment_Nm": 1020.0}, "moment_Nm is 1020.*N·m"),
        ({"moment_Nm": True}, "moment_Nm"),
        ({"moment_z_Nm": np.inf}, "moment_z_Nm"),
        ({"time_s": "1"}, "time_s"),
        ({"points_px": 1e300 * POINTS}, "points_px"),
        ({"points_px": POINTS.T}, "shapes"),
        ({"sigma_px": np.full(3, 0.1)}, "shapes"),
        ({"sigma_px": np.full(60, -0.1)}, "positive"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_frames_of_a_recording_take_nothing_in_silence(changed: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"points_px": POINTS, "sigma_px": np.full(60, 0.1), "moment_Nm": 0.0}
    with pytest.raises(InputError, match=words):
        Measured(**(given | {"pan_rad": 0.1, "tilt_rad": 0.0} | changed))


@pytest.mark.parametrize(
    "call",
    [
        *(lambda: Reading(1.0, "pan_deg", 12.0, 1.0), lambda: Reading(1.0, "pan_rad", "0.1", 1.0)),  # type: ignore[arg-type]
        *(lambda: Reading(1.0, "pan_rad", True, 1.0), lambda: Reading("1", "pan_rad", 0.1, 1.0)),  # type: ignore[arg-type]
        *(lambda: Taken(1.0, None, 1.0), lambda: Taken(1.0, [[0]], 1.0)),  # type: ignore[arg-type]
        *(lambda: Taken(1.0, np.zeros((9, 9, 2), np.uint8), 1.0), lambda: Taken(1.0, np.zeros((9, 9), object), 1.0)),
        *(lambda: Taken("1", np.zeros((9, 9), np.uint8), 1.0), lambda: ContactEstimator("rig.json")),  # type: ignore[arg-type]
        *(lambda: ContactEstimator(RIG, jobs=True), lambda: ContactEstimator(RIG, friction=11.5)),
        lambda: ContactEstimator(RIG).estimate_batch(None, None, [0.0], [0.0]),  # type: ignore[arg-type]
        lambda: ContactEstimator(RIG).estimate_batch([POINTS], None, 0.0, [0.0]),  # type: ignore[arg-type]
        lambda: next(ContactEstimator(RIG).run([POINTS])),  # type: ignore[list-item]
    ],
)
def test_other_calls_take_nothing_in_silence(call: Callable[[], Any]) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_tensors_are_numbers() -> None:
    torch = pytest.importorskip("torch")
    given = torch.ones(3, requires_grad=True)
    np.testing.assert_array_equal(as_floats(given, "it", "give numbers"), np.ones(3))
    with pytest.raises(InputError):
        as_floats([torch.tensor(True)], "it", "give numbers")


def test_masked_points_and_readings_are_missing_ones() -> None:
    estimator = ContactEstimator(RIG)
    few = POINTS.copy()
    few[::2] = np.nan
    masked = np.ma.array(POINTS, mask=np.isnan(few))
    plain, same = (estimator.estimate(points, moment=None, pan=0.1, tilt=0.0) for points in (few, masked))
    assert (plain.status, plain.distance_m) == (same.status, same.distance_m) or np.isnan(plain.distance_m)
