"""The estimator's antenna: against the static rod, one rung or eight at once, and blind to its neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna import linear
from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.antenna.shape import CONTACT, Curves, bend
from vbaa_calib.antenna.taper import UNIFORM
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core

LENGTH, EI, MASS = 0.24, 3.9e-3, 3.97e-3
STRAIGHT = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.log(EI), np.log(MASS), 0.0])
WEIGHTLESS = np.zeros((1, 3))


def cases(count: int, slope_deg: float, seed: int, nearest_m: float = 0.2 * LENGTH) -> dict[str, np.ndarray]:
    """Clamped askew, bowed, heavy, and loaded to about this slope at the contact."""
    rng = np.random.default_rng(seed)
    parameters = np.tile(STRAIGHT, (count, 1))
    parameters[:, :6] = rng.normal(size=(count, 6)) * [5e-4, 5e-4, 0.02, 0.02, 0.12, 0.12]
    gravity = rng.normal(size=(count, 3))
    contact = rng.uniform(nearest_m, LENGTH, count)
    angle = rng.uniform(-np.pi, np.pi, count)
    size = 2 * EI * np.tan(np.radians(slope_deg)) / contact**2
    return {
        "parameters": parameters,
        "gravity_m_s2": 9.80665 * gravity / np.linalg.norm(gravity, axis=1, keepdims=True),
        "contact_m": contact,
        "force_N": size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1),
    }


def rods(case: dict[str, np.ndarray], force_N: np.ndarray) -> list[RodShape]:
    """The same antennas as static rods with forces (B, 3)."""
    shapes = []
    for index, (y, z, about_y, about_z, bow_y, bow_z, log_stiffness, log_mass, _) in enumerate(case["parameters"]):
        stiffness = np.exp(log_stiffness)
        clamp = Pose(Rotation.from_rotvec([0.0, about_y, about_z]).as_matrix(), np.array([0.0, y, z]))
        rod = Rod(LENGTH, stiffness, stiffness / 1.3, np.exp(log_mass), clamp, np.array([bow_y, bow_z]))
        one = slice(index, index + 1)
        shapes.append(solve_rod(rod, case["gravity_m_s2"][one], case["contact_m"][one], force_N[one]))
    return shapes


def worst_error_m(curves: Curves, shapes: list[RodShape]) -> np.ndarray:
    """(B,) greatest distance between curve and rod at equal arc length."""
    at = [sample_shape(shape, s[None])[0][0] for shape, s in zip(shapes, curves.arclength_m, strict=True)]
    return np.linalg.norm(np.array(at) - curves.points_m, axis=2).max(axis=1)


def moments(shapes: list[RodShape]) -> np.ndarray:
    """(B,) the paper's τ_y: minus the right-handed moment about y."""
    return np.array([-shape.clamp_moment_Nm[0, 1] for shape in shapes])


@pytest.mark.parametrize("dead", [True, False])
def test_agrees_with_the_rod_at_twenty_degrees(dead: bool) -> None:
    case = cases(12, 20.0, seed=1)
    curves = {sweeps: bend(**case, length_m=LENGTH, dead=dead, sweeps=sweeps) for sweeps in (0, 1, 2, 3, 4)}
    lateral = np.concatenate([np.zeros((12, 1)), case["force_N"]], axis=1)
    if dead:
        np.testing.assert_allclose(curves[4].force_N, lateral, atol=1e-15)
    shapes = rods(case, curves[4].force_N)
    errors = {sweeps: np.median(worst_error_m(curve, shapes)) for sweeps, curve in curves.items()}
    for sweeps in (0, 1, 2):
        assert errors[sweeps + 1] < 0.2 * errors[sweeps], errors
    assert worst_error_m(curves[4], shapes).max() < 1e-5
    assert worst_error_m(curves[3], shapes).max() < 3e-5
    np.testing.assert_allclose(curves[4].moment_Nm, moments(shapes), atol=1e-7)


@pytest.mark.parametrize("slope_deg", [20.0, 35.0])
def test_friction_leans_the_force_and_leaves_an_equilibrium(slope_deg: float) -> None:
    """The rod under the dead force that bend came to is the same shape; the force leans by what it was told to."""
    case = cases(12, slope_deg, seed=8)
    lean = np.random.default_rng(9).uniform(-0.3, 0.3, 12)
    curves = bend(**case, length_m=LENGTH, sweeps=5, friction_rad=lean)
    assert worst_error_m(curves, rods(case, curves.force_N)).max() < 1e-7
    normal = np.linalg.norm(case["force_N"], axis=1)
    np.testing.assert_allclose(np.linalg.norm(curves.force_N, axis=1), normal / np.cos(lean), rtol=1e-12)
    along = (curves.tangents[:, CONTACT] * curves.force_N).sum(axis=1)
    np.testing.assert_allclose(along, -normal * np.tan(lean), rtol=0, atol=1e-9 * normal.max())


@pytest.mark.parametrize("contact", [0.05, 0.15, 0.239])
def test_tiny_loads_are_the_papers_beam(contact: float) -> None:
    force = np.array([[2e-6, -1e-6]])
    curves = bend(STRAIGHT[None], LENGTH, WEIGHTLESS, np.array([contact]), force)
    s = curves.arclength_m[0]
    for axis in (0, 1):
        beam = linear.deflection(s, contact, force[0, axis], EI)
        np.testing.assert_allclose(curves.points_m[0, :, 1 + axis], beam, atol=1e-6 * np.abs(beam).max())
    np.testing.assert_allclose(curves.points_m[0, :, 0], s, atol=1e-12)
    assert curves.moment_Nm[0] == pytest.approx(contact * force[0, 1], rel=1e-6)


def test_moment_is_plus_lever_times_force_z() -> None:
    """τ_y = + l·f_z for a force on a straight antenna, and the weight's τ_y has the sign of the weight's z."""
    touched = bend(STRAIGHT[None], LENGTH, WEIGHTLESS, np.array([0.1]), np.array([[0.0, 1e-4]]))
    assert touched.moment_Nm[0] == pytest.approx(1e-5, rel=1e-4)
    sagging = bend(STRAIGHT[None], LENGTH, np.array([[0.0, 0.0, -9.80665]]), np.array([0.1]), np.zeros((1, 2)))
    assert sagging.moment_Nm[0] == pytest.approx(-0.5 * MASS * 9.80665 * LENGTH**2, rel=1e-3)
    raised = STRAIGHT + np.array([0.0, 0.01, 0, 0, 0, 0, 0, 0, 0])
    lifted = bend(raised[None], LENGTH, WEIGHTLESS, np.array([0.1]), np.array([[0.0, 1e-4]]))
    assert lifted.moment_Nm[0] == pytest.approx(touched.moment_Nm[0], rel=1e-3)


@pytest.mark.parametrize("dead", [True, False])
def test_turning_everything_about_x_turns_the_shape(dead: bool) -> None:
    case = cases(4, 15.0, seed=7)
    angle = 1.1
    turn = Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()
    pairs = turn[1:, 1:].T
    parameters = case["parameters"].copy()
    for first in (0, 2, 4):
        parameters[:, first : first + 2] = parameters[:, first : first + 2] @ pairs
    turned = {
        "parameters": parameters,
        "gravity_m_s2": case["gravity_m_s2"] @ turn.T,
        "contact_m": case["contact_m"],
        "force_N": case["force_N"] @ pairs,
    }
    here, there = (bend(**which, length_m=LENGTH, dead=dead, sweeps=3) for which in (case, turned))
    np.testing.assert_allclose(there.points_m, here.points_m @ turn.T, atol=1e-10)
    np.testing.assert_allclose(there.force_N, here.force_N @ turn.T, atol=1e-10)


def test_a_clamp_that_gives_is_one_turned_by_the_moment_it_holds() -> None:
    """0.8 mm of give: the rod in a clamp that was turned by hand, by EI's worth of the moment, is the same shape."""
    case = cases(12, 15.0, seed=5)
    case["parameters"][:, 8] = 8e-4
    given = bend(**case, length_m=LENGTH, dead=True, sweeps=4)
    hard = case["parameters"].copy()
    hard[:, 8] = 0.0
    force = np.hstack([np.zeros((12, 1)), case["force_N"]])
    for _ in range(3):
        moment = np.concatenate([shape.clamp_moment_Nm for shape in rods(case | {"parameters": hard}, force)])
        hard[:, 2:4] = case["parameters"][:, 2:4] + 8e-4 / np.exp(hard[:, 6:7]) * moment[:, 1:]
    errors = worst_error_m(given, rods(case | {"parameters": hard}, force))
    assert errors.max() < 1e-5
    stiff = bend(**case | {"parameters": case["parameters"] * np.r_[np.ones(8), 0.0]}, length_m=LENGTH, dead=True)
    moved = np.linalg.norm(given.points_m - stiff.points_m, axis=-1).max(axis=1)
    assert moved.min() > 5 * errors.max()


LANES, NODES = 8, core.antenna.NODES_TO_CONTACT + core.antenna.NODES_BEYOND
GRAVITY = np.array([1.0, -3.0, -9.0])


def bent(rung: int, press: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Points, tangents, force and moment, as whole batches are bent: the last axis is the batch."""
    parameters, force = press["parameters"].T, press["force_N"].T
    gravity = np.tile(GRAVITY, (LANES, 1))
    wires, pushes = (parameters, LENGTH, UNIFORM.pieces), (press["contact_m"], force, press["friction_rad"])
    made = core.antenna.curves(rung, wires, gravity, pushes)
    return [each.T for each in made]


def leaning(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.3, 0.3, count)


def numbers_of(curve: Curves) -> dict[str, np.ndarray]:
    """Its arrays by name, without the radius, which bends nothing."""
    return {name: values for name, values in vars(curve).items() if name != "radius_m"}


def test_the_papers_rung_is_the_papers_beam() -> None:
    """Whatever clamp, bow and weight are; τ_y = l·f_z; the tangents are the curve's."""
    case = cases(6, 10.0, seed=13)
    paper = curves("paper", **case, length_m=LENGTH, friction_rad=np.full(6, 0.2))
    contact = case["contact_m"][:, None]
    for axis in (0, 1):
        beam = linear.deflection(paper.arclength_m, contact, case["force_N"][:, axis, None], EI)
        np.testing.assert_allclose(paper.points_m[..., 1 + axis], beam, rtol=1e-12)
    np.testing.assert_allclose(paper.points_m[..., 0], paper.arclength_m, rtol=1e-14)
    np.testing.assert_allclose(paper.contact_m[:, 0], case["contact_m"], rtol=2e-6)
    np.testing.assert_allclose(paper.moment_Nm, case["contact_m"] * case["force_N"][:, 1], rtol=2e-6)
    np.testing.assert_allclose(np.linalg.norm(paper.tangents, axis=-1), 1.0, rtol=1e-14)
    slopes = np.gradient(paper.points_m[0, :CONTACT, 1], paper.arclength_m[0, :CONTACT])[1:-1]
    np.testing.assert_allclose((paper.tangents[0, :, 1] / paper.tangents[0, :, 0])[1 : CONTACT - 1], slopes, rtol=1e-2)


def scaled(case: dict[str, np.ndarray], share: float) -> dict[str, np.ndarray]:
    """Loads, clamp errors and bow by a share; lengths, stiffness and directions as they are."""
    parameters = case["parameters"].copy()
    parameters[:, :6] *= share
    return case | {
        "parameters": parameters,
        "gravity_m_s2": share * case["gravity_m_s2"],
        "force_N": share * case["force_N"],
    }


def apart(a: Curves, b: Curves) -> dict[str, float]:
    return {name: np.abs(getattr(a, name) - getattr(b, name)).max() for name in numbers_of(a) if name != "arclength_m"}


@pytest.mark.parametrize("what", ["clamp", "bow", "weight", "force", "give", "friction", "all"])
def test_the_linear_rung_is_bend_to_first_order(what: str) -> None:
    """Half the loads leave a quarter of the difference, and the difference is small: no term or sign is missing.

    Friction leans by as much whatever the load: what it does to the shape is of second order in the load.
    """
    case = cases(20, 6.0, seed=14)
    case["parameters"][:, 8] = 5e-4
    kept = {"clamp": slice(0, 4), "bow": slice(4, 6)}.get(what, slice(0, 0))
    if what != "all":
        only = np.tile(STRAIGHT, (20, 1))
        only[:, kept] = case["parameters"][:, kept]
        only[:, 8] = 5e-4 if what == "give" else 0.0
        case["parameters"] = only
    if what not in ("all", "weight", "give"):
        case["gravity_m_s2"] = 0.0 * case["gravity_m_s2"]
    if what not in ("all", "force", "give", "friction"):
        case["force_N"] = 0.0 * case["force_N"]
    lean = leaning(20, 3) if what in ("all", "friction") else None
    differences = []
    for share in (1.0, 0.5, 0.25):
        here = scaled(case, share) | {"length_m": LENGTH, "friction_rad": lean}
        exact = bend(**here, sweeps=8)
        differences.append(apart(curves("linear", **here), exact))
    extent = np.abs(exact.points_m[..., 1:]).max()
    assert differences[-1]["points_m"] < 0.1 * extent
    for name in ("points_m", "tangents", "force_N", "moment_Nm"):
        first, second, third = (difference[name] for difference in differences)
        if first > 1e-13:
            assert 3.5 < first / second < 9.0, (name, first, second)
            assert 3.5 < second / third < 9.0, (name, second, third)


@pytest.mark.parametrize("rung", RUNGS)
def test_without_friction_the_force_stands_across_the_antenna(rung: str) -> None:
    """Also where the antenna is taken as bending little: the direction of the force is not of second order."""
    parameters = np.zeros((1, 9))
    parameters[:, 6:8] = np.log([3.9e-3, 1e-9])
    force = np.array([[0.02, 0.03]])
    curve = curves(rung, parameters, 0.24, np.zeros((1, 3)), np.array([0.15]), force)
    along = (curve.force_N * curve.tangents[:, CONTACT]).sum() / np.linalg.norm(curve.force_N)
    assert abs(along) < 1e-6
    assert curve.force_N[0, 0] < -1e-4
