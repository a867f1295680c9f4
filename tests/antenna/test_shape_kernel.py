"""Shapes bent side by side, compiled: against the same formulas in plain Python, and blind to their neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from tests.antenna.test_shape import LENGTH, cases
from vbaa_calib.antenna import equilibrium, pendulum, shape_kernel
from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.core.lanes import LANES

LARGE = RUNGS.index("elastica"), RUNGS.index("rod")
GRAVITY = np.array([1.0, -3.0, -9.0])


def presses(slope_deg: float, seed: int) -> dict[str, np.ndarray]:
    """LANES antennas, each with its own friction."""
    case = cases(LANES, slope_deg, seed)
    lean = np.random.default_rng(seed).uniform(-0.4, 0.4, LANES)
    return {
        "parameters": np.ascontiguousarray(case["parameters"].T) + 1e-4 * np.eye(9, LANES),
        "contact_m": case["contact_m"],
        "force_N": np.ascontiguousarray(case["force_N"].T),
        "friction_rad": lean,
    }


def bent(rung: int, press: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Points, tangents, force and moment, by the kernel that works off whole batches: the last axis is the batch."""
    nodes = shape_kernel.CURVE_NODES
    made = [np.full(shape, 7.0) for shape in ((LANES, nodes, 3), (LANES, nodes, 3), (LANES, 3), (LANES,))]
    parameters, force = (np.ascontiguousarray(press[name].T) for name in ("parameters", "force_N"))
    gravity = np.tile(GRAVITY, (LANES, 1))
    given = shape_kernel.Presses(parameters, LENGTH, gravity, press["contact_m"], force, press["friction_rad"])
    sweeps = shape_kernel.ELASTICA_SWEEPS if RUNGS[rung] == "elastica" else shape_kernel.ROD_SWEEPS
    shape_kernel.bend_batch(rung, False, sweeps, given, shape_kernel.Bent(*made))
    return [each.T for each in made]


def lanes(rung: int, press: dict[str, np.ndarray], rows: int = shape_kernel.CURVE_NODES) -> list[np.ndarray]:
    """The same by the kernel that the solver calls."""
    nodes = shape_kernel.CURVE_NODES
    made = [np.full(shape, 7.0) for shape in ((3, nodes, LANES), (3, rows, LANES), (3, LANES), (LANES,))]
    given = press["parameters"], LENGTH, GRAVITY, press["contact_m"], press["force_N"], press["friction_rad"]
    shape_kernel.bend_lanes(rung, *given, *made)
    return made


@pytest.mark.parametrize("rung", range(len(RUNGS)))
@pytest.mark.parametrize("slope_deg", [0.0, 20.0, 60.0])
def test_compiled_is_plain_python(rung: int, slope_deg: float, monkeypatch: pytest.MonkeyPatch) -> None:
    press = presses(slope_deg, seed=1)
    compiled = bent(rung, press)
    for module in (shape_kernel, equilibrium, pendulum):
        for name, function in list(vars(module).items()):
            monkeypatch.setattr(module, name, getattr(function, "py_func", function))
    with np.errstate(invalid="ignore"):
        plain = bent(rung, press)
    for found, expected in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("rung", range(len(RUNGS)))
def test_shapes_do_not_see_each_other(rung: int) -> None:
    """Beside stronger and weaker loads, other places, other frictions, and what is not a number."""
    press, others = presses(25.0, seed=2), presses(70.0, seed=3)
    alone = bent(rung, press)
    for lane in range(LANES):
        mixed = {name: values.copy() for name, values in others.items()}
        for name, values in mixed.items():
            values[..., (lane + 2) % LANES] = np.nan
            values[..., lane] = press[name][..., lane]
        for found, expected in zip(bent(rung, mixed), alone, strict=True):
            np.testing.assert_allclose(found[..., lane], expected[..., lane], rtol=1e-12, atol=1e-15)
            assert np.isnan(found[..., (lane + 2) % LANES]).any()


@pytest.mark.parametrize("rung", LARGE)
def test_series_and_closed_form_meet(rung: int) -> None:
    """Just below and just above the load at which one takes over from the other."""
    press = presses(60.0, seed=5)
    whole = np.hypot(*press["force_N"]) / np.cos(press["friction_rad"])
    load = whole * press["contact_m"] ** 2 / np.exp(press["parameters"][6])
    for name in ("points", "tangents", "force", "moment"):
        index = ("points", "tangents", "force", "moment").index(name)
        below, above = (
            bent(rung, press | {"force_N": press["force_N"] * (2.5 * factor / load)})[index]
            for factor in (1.0 - 1e-13, 1.0 + 1e-13)
        )
        np.testing.assert_allclose(below, above, rtol=0, atol=2e-12, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("rung", range(len(RUNGS)))
def test_tangents_of_the_first_shape_alone(rung: int) -> None:
    press = presses(25.0, seed=6)
    every = lanes(rung, press)
    for rows in (0, shape_kernel.NODE_ROWS):
        some = lanes(rung, press, rows)
        np.testing.assert_array_equal(some[0], every[0])
    first = some[1].reshape(3, -1)[:, : shape_kernel.CURVE_NODES]
    np.testing.assert_allclose(first, every[1][..., 0], rtol=0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("rung", range(len(RUNGS)))
@pytest.mark.parametrize("slope_deg", [1e-6, 25.0, 70.0])
def test_a_batch_is_made_of_these(rung: int, slope_deg: float) -> None:
    press = presses(slope_deg, seed=7)
    points, tangents, force, moment = lanes(rung, press)
    batch = curves(
        RUNGS[rung],
        press["parameters"].T,
        LENGTH,
        np.tile(GRAVITY, (LANES, 1)),
        press["contact_m"],
        press["force_N"].T,
        press["friction_rad"],
    )
    np.testing.assert_allclose(batch.points_m, points.T, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(batch.tangents, tangents.T, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(batch.force_N, force.T, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(batch.moment_Nm, moment, rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(batch.contact_m, points[:, CONTACT].T, rtol=1e-12, atol=1e-15)
