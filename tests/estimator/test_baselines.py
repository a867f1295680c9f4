"""The paper's systems on the static rod: right where their assumptions hold, and silent or biased as theory says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.paper.baselines import Press, Wire, run_method
from estimator.paper.baselines.press import _world_turn
from estimator.paper.inclined import project
from vbaa_calib.antenna.rod import Rod, sample_shape
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.simulate.contact.touch import Touch, touch
from vbaa_calib.simulate.scene.objects import TouchObject

from . import vibrations

LENGTH_M, STIFFNESS_NM2, MASS_KG_M = vibrations.LENGTH, vibrations.EI, vibrations.DENSITY
WIRE = Wire(LENGTH_M, STIFFNESS_NM2, MASS_KG_M)
ROD = Rod(LENGTH_M, STIFFNESS_NM2, STIFFNESS_NM2 / 1.3, 0.0)
RADIUS_M = 4e-4


def knife(
    contact_m: float, normal_rad: float = 0.0, stiffness_N_m: float = np.inf, friction: float = 0.0
) -> TouchObject:
    """An edge across the antenna on its +y side, whose outward normal (yz plane) is turned from −y by an angle."""
    outward = np.array([0.0, -np.cos(normal_rad), -np.sin(normal_rad)])
    along = np.array([0.0, -np.sin(normal_rad), np.cos(normal_rad)])
    edge = np.array([contact_m, 0.0, 0.0]) - (RADIUS_M + 2e-4) * outward
    return TouchObject("knife_edge", edge, along, 2e-4, 0.2, stiffness_N_m, friction, wedge_world=-outward)


def pressed(obj: TouchObject, pan_rad: np.ndarray, tilt_rad: np.ndarray | float = 0.0) -> tuple[Touch, np.ndarray]:
    """The weightless rod at these joint angles (F,), and its base's rotations (F, 3, 3)."""
    rotations, _ = Kinematics().world_antenna(pan_rad, np.broadcast_to(tilt_rad, np.shape(pan_rad)))
    poses = [Pose(rotation, np.zeros(3)) for rotation in rotations]
    return touch(ROD, RADIUS_M, obj, poses, np.zeros(3)), rotations


def press_of(touched: Touch, rotations: np.ndarray, seed: int | None = None) -> Press:
    """The press as it is, or with a draw of `NOISE`."""
    moment = np.stack([touched.shape.clamp_moment_Nm[:, 2], -touched.shape.clamp_moment_Nm[:, 1]], axis=1)
    s = np.broadcast_to(np.linspace(0.005, 1.0, 200) * LENGTH_M, (len(touched.in_contact), 200))
    points, turn = sample_shape(touched.shape, s)[0][..., :2], _world_turn(rotations)
    if seed is None:
        return Press(WIRE, turn, moment, points)
    rng = np.random.default_rng(seed)
    moment = moment + rng.normal(0.0, NOISE["moment_std_Nm"], moment.shape)
    turn = turn + rng.normal(0.0, NOISE["turn_std_rad"], turn.shape)
    points = points + [0.0, 1.0] * rng.normal(0.0, NOISE["point_std_m"], points.shape)
    return Press(WIRE, turn, moment, points, **NOISE)


def ringing(contact: float, amplitudes_Nm: tuple[float, ...], noise_Nm: float, rng: np.random.Generator) -> np.ndarray:
    """(R, 2) 0.4 s at 1 kHz of the moment of a wire rung at a contact (in lengths): its modes, each at 1 % damping."""
    waves, _ = vibrations.modes(contact, len(amplitudes_Nm))
    time = np.arange(400) / 1000.0
    signal = 3e-4 + rng.normal(0.0, noise_Nm, len(time))
    for wave, amplitude in zip(waves, amplitudes_Nm, strict=True):
        omega = vibrations.frequency_rad_s(wave)
        signal += amplitude * np.exp(-0.01 * omega * time) * np.cos(omega * np.sqrt(1 - 0.01**2) * time + 0.4)
    return np.column_stack([time, signal])


PANS = np.radians(np.linspace(0.3, 2.0, 6))
NOISE = {"point_std_m": 5e-5, "moment_std_Nm": 2e-5, "turn_std_rad": 1e-5}


@pytest.mark.parametrize("contact_m", [0.06, 0.2])
def test_every_system_finds_a_rigid_edge_square_on(contact_m: float) -> None:
    touched, rotations = pressed(knife(contact_m), PANS)
    press = press_of(touched, rotations)
    for name in ("Active Antenna", "3D Active Antenna", "2D-VBAA", "2D-VBAA, pushing", "3D-VBAA, camera A"):
        found = run_method(name, press)
        # what is left is the square of the deflection's slope, some 2.0°·3/2
        assert found.distance_m == pytest.approx(touched.contact_m[-1], rel=4e-3), name
        assert found.force_N[1] == pytest.approx(touched.force_antenna_N[-1, 1], rel=1e-2), name
        assert np.isnan(found.distance_std_m), "noise was not told"


def test_the_3d_active_antenna_works_along_the_normal_and_names_a_slip_sideways() -> None:
    """Pushed by both joints along a normal at 35° it is exact; pushed by pan alone the antenna slips along the edge."""
    obj, turn = knife(0.14, np.radians(35.0)), PANS[:, None] * [np.cos(np.radians(35.0)), np.sin(np.radians(35.0))]
    along = run_method("3D Active Antenna", press_of(*pressed(obj, turn[:, 0], turn[:, 1])))
    assert along.distance_m == pytest.approx(0.14, rel=4e-3)
    assert np.arctan2(along.force_N[2], along.force_N[1]) == pytest.approx(np.radians(35.0 - 180.0), abs=0.01)
    aside = run_method("3D Active Antenna", press_of(*pressed(obj, PANS)))
    assert np.isnan(aside.distance_m)
    assert "slips sideways: the moment leans 35°" in aside.reason


def test_camera_a_and_b_find_the_force_out_of_plane_c() -> None:
    touched, rotations = pressed(knife(0.14, np.radians(40.0)), PANS)
    upright = press_of(touched, rotations)
    s = np.broadcast_to(np.linspace(0.005, 1.0, 200) * LENGTH_M, (len(PANS), 200))
    tilt = np.radians(30.0)
    image = np.asarray(project(sample_shape(touched.shape, s)[0], tilt))
    inclined = replace(upright, points_m=image, camera_tilt_rad=tilt)
    for name, press in (("3D-VBAA, camera A", upright), ("3D-VBAA, camera B", inclined)):
        found = run_method(name, press)
        assert found.distance_m == pytest.approx(touched.contact_m[-1], rel=4e-3), name
        np.testing.assert_allclose(found.force_N[1:], touched.force_antenna_N[-1, 1:], rtol=1e-2)
    wrong = run_method("3D-VBAA, camera A", inclined)
    assert wrong.distance_m == pytest.approx(touched.contact_m[-1], rel=4e-3), "two straight points hide the tilt"
    assert wrong.force_N[1] != pytest.approx(touched.force_antenna_N[-1, 1], rel=1e-2), "but not from the force"
    assert np.isnan(run_method("2D-VBAA", upright).force_N[2]), "vision alone does not see f_z"


@pytest.mark.parametrize("name", ["Active Antenna", "3D Active Antenna", "3D-VBAA, camera A", "3D-VBAA, camera B"])
def test_deviations_are_what_sampling_shows(name: str) -> None:
    touched, rotations = pressed(knife(0.14), PANS)
    drawn = [run_method(name, press_of(touched, rotations, seed)) for seed in range(250)]
    distance = np.array([each.distance_m for each in drawn])
    assert np.isfinite(distance).all()
    stated = np.sqrt(np.mean([each.distance_std_m**2 for each in drawn]))
    assert distance.std() == pytest.approx(stated, rel=0.12)
    force = np.array([each.force_N[1] for each in drawn])
    assert force.std() == pytest.approx(np.sqrt(np.mean([each.force_std_N[1] ** 2 for each in drawn])), rel=0.15)


def test_the_objects_stiffness_and_its_deviation() -> None:
    """150 pushes of 12 frames against 60 N/m: right on average, and as uncertain as stated."""
    touched, rotations = pressed(knife(0.12, stiffness_N_m=60.0), np.radians(np.linspace(0.5, 5.0, 12)))
    plain = run_method("2D-VBAA, pushing", press_of(touched, rotations))
    found = [run_method("2D-VBAA, pushing", press_of(touched, rotations, seed)) for seed in range(150)]
    compliance = np.array([1.0 / each.object_stiffness_N_m for each in found])
    stated = np.array([each.object_stiffness_std_N_m / each.object_stiffness_N_m**2 for each in found])
    assert np.isfinite(compliance).all()
    assert plain.object_stiffness_N_m == pytest.approx(60.0, rel=0.03)
    assert compliance.mean() == pytest.approx(1.0 / plain.object_stiffness_N_m, abs=0.7 * compliance.std())
    assert compliance.std() == pytest.approx(np.sqrt(np.mean(stated**2)), rel=0.25)
