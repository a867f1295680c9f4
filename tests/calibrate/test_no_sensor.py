"""A session without a moment sensor: what the pictures determine is found as with one that tells nothing."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.residual_checks import check
from vbaa_calib.calibrate.antenna.session_rig import make_rig, solve_antenna
from vbaa_calib.diagnose.session import still_diagnoses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig

from .clean_sessions import CleanSession, clean_session


def without_sensor(drawn: CleanSession) -> CleanSession:
    """The same pictures, nothing read with them."""
    unread = [replace(one, still=replace(one.still, moment_Nm=nan)) for one in drawn.observations]
    return replace(drawn, session=replace(drawn.session, moment_std_Nm=inf), observations=unread)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_sensor_is_one_that_tells_nothing(seed: int) -> None:
    """As the sensor's noise grows without bound, pose, antenna and covariance go to those without a sensor."""
    drawn = clean_session(seed)
    silent = without_sensor(drawn)
    alone = solve_antenna(silent.session, silent.observations, silent.before)
    noisy = solve_antenna(replace(drawn.session, moment_std_Nm=1e6), drawn.observations, drawn.before)
    rig = slice(0, 15)
    std = np.sqrt(np.diag(noisy.covariance))[rig]
    np.testing.assert_allclose(alone.parameters[rig] / std, noisy.parameters[rig] / std, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(alone.covariance))[rig], std, rtol=1e-4)


def test_the_rig_is_honest_and_can_be_stored() -> None:
    """EI within its deviation over drawn rigs; the stored rig says null and comes back the same; nothing is doubted."""
    off = []
    for seed in range(12):
        drawn = clean_session(seed)
        silent = without_sensor(drawn)
        joint = solve_antenna(silent.session, silent.observations, silent.before)
        rig = make_rig(silent.session, Kinematics(), joint, silent.observations)
        log_stiffness = np.log(rig.antenna.stiffness_Nm2)
        off.append((log_stiffness - drawn.world.parameters[6]) / rig.std("log_stiffness_Nm2"))
        assert not any(one.grave for one in still_diagnoses(silent.session, Kinematics(), joint))
        assert check(joint).to_dict()["noise_Nm"] is None
        data = rig.to_dict()
        again = Rig.from_dict(data)
        assert data["moment_sensor"] is None
        assert not again.moment_sensor.exists
        assert not rig.covariance[15:17].any()
        assert not rig.drifted().covariance[15:17].any()
        assert again.to_dict()["moment_sensor"] is None
        np.testing.assert_array_equal(again.covariance, rig.covariance)
    assert np.abs(off).max() < 3.5
