"""Two contacts of one frame: the rod touched twice against SciPy, and both contacts out of pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import fsolve

from benchmarks.estimator.scenes import gravity, random_scenes, seen
from benchmarks.estimator.setup import ACROSS, LENGTH_M, SIGMA_PX, Setup, drawn_truth
from estimator import ContactEstimator
from estimator.contact.common_errors import shared_errors
from estimator.table.contacts import Contact
from estimator.table.files import read_contacts
from vbaa_calib.antenna.rod import Rod
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.native import core
from vbaa_calib.rig import Rig

EI = 3.9e-3
STEPS = 24


def touched_twice(rod: Rod, loads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (N, 4, 3) and the solution (5,) of one rod."""
    nodes, solution, left = core.antenna.solve_touched_twice(
        rod.numbers, loads[None], rod.clamp_give_m, np.zeros((1, 5)), STEPS
    )
    assert left[0] < 1e-8
    return nodes[0], solution[0]


@pytest.mark.parametrize(("first", "second"), [(0.08, 0.05), (-0.12, 0.04), (0.2, -0.06)])
def test_a_rod_touched_twice_is_that_of_scipy(first: float, second: float) -> None:
    """In a plane, both forces normal to the bent rod: θ' = κ, EI κ' = −(F_y cos θ − F_x sin θ), κ(L) = 0."""
    at, push = (0.09, 0.19), (first, second)
    loads = np.array([0.0, 0.0, 0.0, at[0], push[0], 0.0, 0.0, at[1], push[1], 0.0, 0.0])
    nodes, _ = touched_twice(Rod(LENGTH_M, EI, EI / 1.3, 0.0), loads)

    def shot(unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is left of the tip's moment and the forces' directions, and where the tip is."""
        state, bounds, left = np.array([0.0, 0.0, 0.0, unknowns[0]]), (0.0, *at, LENGTH_M), []
        along = EI / LENGTH_M**2 * unknowns[1:]
        for part in range(3):
            f_x, f_y = along[part:].sum(), sum(push[part:])

            def slope(_: float, y: np.ndarray, f_x: float = f_x, f_y: float = f_y) -> list[float]:
                return [np.cos(y[2]), np.sin(y[2]), y[3], -(f_y * np.cos(y[2]) - f_x * np.sin(y[2])) / EI]

            state = solve_ivp(slope, bounds[part : part + 2], state, rtol=1e-11, atol=1e-13).y[:, -1]
            if part < 2:
                left.append(along[part] * np.cos(state[2]) + push[part] * np.sin(state[2]))
        return np.array([state[3], *left]), state[:2]

    found = fsolve(lambda x: shot(x)[0], [sum(a * f for a, f in zip(at, push, strict=True)) / EI, 0.0, 0.0])
    np.testing.assert_allclose(nodes[-1, 0, :2], shot(found)[1], atol=1e-7 * LENGTH_M)


def frame(
    rig: Rig, rng: np.random.Generator, roll: Callable[[], float]
) -> tuple[dict[str, np.ndarray], float, np.ndarray, np.ndarray]:
    """A noisy frame of two contacts: pixels by camera, moment, distances (2,) m, and forces (2, 3) N."""
    rod, lengths = rig.antenna.rod, np.array([rng.uniform(0.3, 0.5), rng.uniform(0.75, 0.95)])
    slopes = rng.uniform(0.12, 0.3, 2) * rng.choice([-1.0, 1.0], 2)
    forces = 2.0 * slopes * rod.bending_stiffness_Nm2 / (lengths * LENGTH_M) ** 2
    lateral = [(force * np.cos(angle), force * np.sin(angle)) for force, angle in ((f, roll()) for f in forces)]
    down = gravity(rig, np.zeros(1), np.zeros(1))[0]
    touches = [[length * LENGTH_M, *own, 0.0] for length, own in zip(lengths, lateral, strict=True)]
    loads = np.concatenate([down, *touches])
    nodes, solution = touched_twice(rod, loads)
    bounds = [0.0, *(lengths * LENGTH_M), LENGTH_M]
    arcs = np.concatenate([np.linspace(*bounds[k : k + 2], STEPS, endpoint=False) for k in range(3)] + [[LENGTH_M]])
    points = CubicHermiteSpline(arcs, nodes[:, 0], nodes[:, 1])(LENGTH_M * (np.arange(200) + 0.5) / 200)
    turn, unit = rod.T_antenna_clamp.rotation, rod.bending_stiffness_Nm2 / LENGTH_M
    on = np.array([turn @ [unit / LENGTH_M * x, *own] for x, own in zip(solution[3:], lateral, strict=True)])
    total = on.sum(axis=0) + rod.mass_kg * down
    about = unit * solution[:3] + np.cross(rod.T_antenna_clamp.translation_m, total)
    sensor = rig.moment_sensor
    read = -sensor.gain * about[1] + sensor.offset_Nm + sensor.std_Nm * rng.normal()
    pixels = {
        name: seen(one.camera, one.T_antenna_camera, points) + SIGMA_PX * rng.normal(size=(200, 2))
        for name, one in rig.cameras.items()
    }
    return pixels, float(read), lengths * LENGTH_M, on


def judged(found: list[Contact], distances_m: np.ndarray, forces_N: np.ndarray) -> list[float]:
    """The errors of what is stated, in stated standard deviations."""
    errors = list[float]()
    for contact, distance, force in zip(found, distances_m, forces_N, strict=True):
        errors.append(float(contact.distance_m - distance) / contact.distance_std_m)
        errors += ((contact.force_N - force)[1:] / contact.force_std_N[1:]).tolist()
    return [error for error in errors if np.isfinite(error)]


@pytest.mark.parametrize("count", [3, pytest.param(6, marks=pytest.mark.slow)])
def test_both_contacts_are_found_by_a_calibrated_rig(count: int) -> None:
    """Of the default errors of a calibration, where both forces lie in the picture's plane."""
    rig, rng = Setup("brown", swing_m=0.1, real=True, exact=False).rig(), np.random.default_rng(3)
    estimator, errors, two = ContactEstimator(rig), list[float](), 0
    for _ in range(count):
        pixels, moment, distances, forces = frame(drawn_truth(rig, rng), rng, lambda: 0.0)
        found = estimator.estimate_two(pixels["camera"], moment=moment, pan=0.0, tilt=0.0, sigma_px=SIGMA_PX)
        if len(found) == 2:
            two += 1
            errors += judged(found, distances, forces)
            assert all(np.isfinite(each.covariance_world_m2).all() for each in found)
    assert two >= 2 * count // 3
    assert np.abs(errors).max() < 4.0
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_two_cameras_see_forces_in_any_direction(count: int) -> None:
    """Both components of both forces, which one camera does not determine."""
    front, side = (Setup("brown", tilt, ACROSS, swing_m=0.1, real=True).rig() for tilt in (-0.7, 0.7))
    rig, rng = replace(front, others={"side": side}), np.random.default_rng(1)
    estimator, two = ContactEstimator(rig), 0
    for _ in range(count):
        pixels, moment, distances, forces = frame(rig, rng, lambda: float(rng.uniform(-np.pi, np.pi)))
        found = estimator.estimate_two(pixels, moment=moment, pan=0.0, tilt=0.0, sigma_px=SIGMA_PX)
        if len(found) == 2:
            two += 1
            assert all(np.isfinite(each.force_N).all() for each in found)
            assert np.abs(judged(found, distances, forces)).max() < 4.0
    assert two >= -(-3 * count // 4)


def test_one_contact_stays_one() -> None:
    rig, rng = Setup("brown", swing_m=0.1).rig(), np.random.default_rng(0)
    pixels, moment, *_ = frame(rig, rng, lambda: 0.0)
    scene = random_scenes(rig, 1, rng)
    estimator = ContactEstimator(rig)
    read = {"moment": float(scene.moment_Nm[0]), "pan": float(scene.pan_rad[0]), "tilt": float(scene.tilt_rad[0])}
    (found,) = estimator.estimate_two(scene.points_px[0], **read, sigma_px=SIGMA_PX)
    assert found.distance_m == estimator.estimate(scene.points_px[0], **read, sigma_px=SIGMA_PX).distance_m
    # a shape of neither one nor two contacts is none
    bent = pixels["camera"] + 3.0 * np.sin(np.linspace(0.0, 25.0, 200))[:, None] * [0.0, 1.0]
    (found,) = estimator.estimate_two(bent, moment=moment, pan=0.0, tilt=0.0, sigma_px=SIGMA_PX)
    assert found.status == "failed"


def test_a_cone_is_refused() -> None:
    estimator = ContactEstimator(Setup(tip=0.5).rig())
    with pytest.raises(InputError, match="uniform"):
        estimator.estimate_two(np.zeros((9, 2)), moment=0.0, pan=0.0, tilt=0.0)


def test_pairs_are_rows_of_the_table(tmp_path: Path) -> None:
    """Of `vbaa estimate --two`; a surface takes both, a verb for single contacts neither."""
    rig, rng = Setup("brown", swing_m=0.1, real=True).rig(), np.random.default_rng(3)
    rig.save(tmp_path / "rig.json")
    lines, readings, truth = ["frame,u_px,v_px,sigma_px"], ["frame,time_s,moment_Nm,pan_rad,tilt_rad"], {}
    for number in range(3):
        pixels, moment, distances, forces = frame(rig, rng, lambda: 0.0)
        truth[number] = distances, forces
        lines += [f"{number},{u:.4f},{v:.4f},{SIGMA_PX}" for u, v in pixels["camera"]]
        readings.append(f"{number},{number},{moment:.9g},0,0")
    for name, text in (("lines", lines), ("readings", readings)):
        (tmp_path / f"{name}.csv").write_text("\n".join(text) + "\n")
    out, call = tmp_path / "contacts.csv", ["estimate", "--no-report", "--force", "--rig", str(tmp_path / "rig.json")]
    call += ["--centrelines", str(tmp_path / "lines.csv"), "--readings", str(tmp_path / "readings.csv"), "-o", str(out)]
    assert main(call) == 0
    assert "failed" in read_contacts(out).status
    assert main([*call, "--two"]) == 0
    table = read_contacts(out, several=True)
    assert table.paired.sum() >= 4
    for row in table.picked(table.paired).rows():
        distances, _ = truth[row.frame]
        assert abs(row.distance_m - distances[row.contact]) < 4.0 * row.distance_std_m
    assert read_contacts(out).frame.tolist() == [0, 1, 2]
    assert not read_contacts(out).located[np.isin([0, 1, 2], table.frame[table.paired])].any()
    assert np.isfinite(shared_errors(rig, table).point_m[table.located]).all()
