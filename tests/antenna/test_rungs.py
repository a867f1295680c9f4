"""The ladder of antenna models: each rung against what it stands for."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.antenna import linear
from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.antenna.shape import Curves, bend

from .test_shape import EI, LENGTH, STRAIGHT, cases, moments, rods, worst_error_m


def leaning(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.3, 0.3, count)


def numbers_of(curve: Curves) -> dict[str, np.ndarray]:
    """Its arrays by name, without the radius, which bends nothing."""
    return {name: values for name, values in vars(curve).items() if name != "radius_m"}


@pytest.mark.parametrize("rung", RUNGS)
def test_a_batch_is_a_loop(rung: str) -> None:
    case = cases(5, 60.0, seed=12) | {"friction_rad": leaning(5, 2)}
    together = curves(rung, **case, length_m=LENGTH)
    for index in range(5):
        alone = curves(rung, **{name: values[index : index + 1] for name, values in case.items()}, length_m=LENGTH)
        for name, values in numbers_of(alone).items():
            np.testing.assert_allclose(getattr(together, name)[index], values[0], atol=1e-14, err_msg=name)


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


@pytest.mark.parametrize("slope_deg", [20.0, 35.0])
def test_the_highest_rung_is_the_rod(slope_deg: float) -> None:
    """Bowed, askew, heavy, leaning; the rod is loaded by the dead force that the contact came to."""
    case, lean = cases(10, slope_deg, seed=15), leaning(10, 4)
    rod = curves("rod", **case, length_m=LENGTH, friction_rad=lean)
    shapes = rods(case, rod.force_N)
    assert worst_error_m(rod, shapes).max() < 1e-6
    np.testing.assert_allclose(rod.moment_Nm, moments(shapes), atol=2e-8)
    lower = [worst_error_m(curves(name, **case, length_m=LENGTH, friction_rad=lean), shapes) for name in RUNGS[:3]]
    paper, straight, elastica = (np.median(error) for error in lower)
    assert elastica < 0.1 * straight < 0.1 * paper


def test_a_contact_at_the_tip_is_finite_on_every_rung() -> None:
    rng = np.random.default_rng(5)
    lengths = rng.uniform(0.1, 0.3, 40)
    for length in lengths:
        for rung in RUNGS:
            case = cases(1, 10.0, seed=16) | {"contact_m": np.array([length])}
            curve = curves(rung, **case, length_m=length)
            assert all(np.isfinite(values).all() for values in numbers_of(curve).values())


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
