"""Eight shapes at once, by the core: against a rod integrated by SciPy, and blind to their neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vbaa_calib.antenna.nodes import CONTACT, aligned_arclength
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.antenna.taper import UNIFORM
from vbaa_calib.native import core

from .test_shape import LENGTH, cases

LANES, NODES = 8, core.antenna.NODES_TO_CONTACT + core.antenna.NODES_BEYOND
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
    """Points, tangents, force and moment, as whole batches are bent: the last axis is the batch."""
    parameters, force = press["parameters"].T, press["force_N"].T
    gravity = np.tile(GRAVITY, (LANES, 1))
    given = LENGTH, UNIFORM.pieces, gravity, press["contact_m"], force, press["friction_rad"]
    made = core.antenna.curves(rung, parameters, *given)
    return [each.T for each in made]


def lanes(
    rung: int, press: dict[str, np.ndarray], rows: int = NODES, gravity_m_s2: np.ndarray = GRAVITY
) -> list[np.ndarray]:
    """The same as the solver has it."""
    made = [np.full(shape, 7.0) for shape in ((3, NODES, LANES), (3, rows, LANES), (3, LANES), (LANES,))]
    given = gravity_m_s2, press["contact_m"], press["force_N"], press["friction_rad"]
    core.antenna.bend_lanes(rung, press["parameters"], LENGTH, UNIFORM.pieces, *given, *made)
    return made


def integrated(
    stiffness: float, weight: np.ndarray, contact_m: float, force: np.ndarray, tip: np.ndarray
) -> np.ndarray:
    """Position, tangent and moment (N, 9) at a shape's nodes of a rod without bow, whose torsion moves nothing.

    From its tip (6,), where no moment is, back to the clamp: r' = t, t' = M/EI × t, M' = n × t.
    """
    s, state, parts = aligned_arclength(np.array([contact_m]), LENGTH)[0], np.concatenate([tip, np.zeros(3)]), []
    for pushed, nodes in ((0.0, s[CONTACT:]), (1.0, s[: CONTACT + 1])):

        def rates(at: float, y: np.ndarray, pushed: float = pushed) -> np.ndarray:
            inner = pushed * force + (LENGTH - at) * weight
            return np.concatenate([y[3:6], np.cross(y[6:], y[3:6]) / stiffness, np.cross(inner, y[3:6])])

        found = solve_ivp(rates, nodes[[-1, 0]], state, "DOP853", nodes[::-1], rtol=1e-12, atol=1e-14).y.T[::-1]
        state = found[0]
        parts.append(found)
    return np.concatenate([parts[1], parts[0][1:]])


@pytest.mark.parametrize(("rung", "weight", "slope_deg"), [("elastica", 0.0, 60.0), ("rod", 1.0, 20.0)])
def test_a_shape_is_that_of_an_integrated_rod(rung: str, weight: float, slope_deg: float) -> None:
    """Begun where the shape ends and under the force that it names, the rod ends in the clamp with the same moment."""
    press = presses(slope_deg, seed=1)
    press["parameters"][4:6] = press["parameters"][8] = 0.0
    points, tangents, force, moment = lanes(RUNGS.index(rung), press, gravity_m_s2=weight * GRAVITY)
    for lane, (stiffness, mass) in enumerate(np.exp(press["parameters"][6:8]).T):
        tip, load = np.concatenate([points[:, -1, lane], tangents[:, -1, lane]]), mass * weight * GRAVITY
        rod = integrated(stiffness, load, press["contact_m"][lane], force[:, lane], tip)
        np.testing.assert_allclose(points[..., lane].T, rod[:, :3], rtol=0, atol=1e-7)
        np.testing.assert_allclose(tangents[..., lane].T, rod[:, 3:6], rtol=0, atol=2e-6)
        np.testing.assert_allclose(rod[0, :3], [0.0, *press["parameters"][:2, lane]], rtol=0, atol=1e-7)
        clamp_moment = rod[0, 6:] + np.cross(rod[0, :3], force[:, lane] + LENGTH * load)
        np.testing.assert_allclose(-clamp_moment[1], moment[lane], rtol=0, atol=1e-8)


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
