"""The static rod against closed forms, the laws of mechanics, and an independent boundary-value solver."""

import numpy as np
import pytest
from scipy.integrate import simpson, solve_bvp
from scipy.spatial.transform import Rotation

from estimator.rod import wire
from vbaa_calib.antenna import rod as rod_module
from vbaa_calib.antenna.elastica import planar_elastica_dead
from vbaa_calib.antenna.rod import Rod, RodShape, solve_rod
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose

L, EI, GJ, MASS, G = 0.24, 3.9e-3, 3.0e-3, 0.004, 9.80665


def bare_rod() -> Rod:
    return Rod(L, EI, GJ, 0.0)


def full_rod() -> Rod:
    clamp = Pose.from_rotvec(np.array([0.4, 0.03, -0.05]), np.array([0.002, -0.001, 0.003]))
    return Rod(L, EI, GJ, MASS, clamp, np.array([0.3, -0.2]))


def random_loads(count: int, seed: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    gravity = rng.normal(size=(count, 3))
    gravity *= G / np.linalg.norm(gravity, axis=1, keepdims=True)
    contact = rng.uniform(0.15, 1.0, count) * L
    force = rng.normal(size=(count, 3)) * [0.3, 1.0, 1.0] * 0.7 * EI / contact[:, None] ** 2
    return gravity, contact, force


def weightless(contact: float, force: list[float]) -> RodShape:
    return solve_rod(bare_rod(), np.zeros((1, 3)), np.array([contact]), np.array([force]))


@pytest.mark.parametrize("transverse", [1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_dead_tip_load_is_the_elastica(transverse: int, sign: float) -> None:
    loads = np.arange(1.0, 11.0)
    force = np.zeros((len(loads), 3))
    force[:, transverse] = sign * loads * EI / L**2
    shape = solve_rod(bare_rod(), np.zeros_like(force), np.full(len(loads), L), force)
    tip, tangent = shape.points_m[:, -1] / L, shape.tangents[:, -1]
    angle = np.arctan2(sign * tangent[:, transverse], tangent[:, 0])
    closed = planar_elastica_dead([1.0], 1.0, loads, 1.0)
    expected = np.concatenate([closed.w_m, closed.x_m, closed.theta_rad], axis=1)
    found = np.stack([sign * tip[:, transverse], tip[:, 0], angle], axis=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def test_discretisation_is_below_1e_7_up_to_45_degrees(monkeypatch: pytest.MonkeyPatch) -> None:
    loads = random_loads(40)
    coarse = solve_rod(full_rod(), *loads)
    steps = rod_module.STEPS_PER_SEGMENT
    monkeypatch.setattr(rod_module, "STEPS_PER_SEGMENT", 4 * steps)
    fine = solve_rod(full_rod(), *loads)
    slope = np.arccos((coarse.tangents @ full_rod().T_antenna_clamp.rotation[:, 0]).min(axis=1))
    gentle = slope < np.radians(45.0)
    assert gentle.sum() >= 20
    assert slope[gentle].max() > np.radians(35.0)
    assert np.abs(coarse.points_m - fine.points_m[:, ::4])[gentle].max() < 1e-7 * L
    moment = np.abs(coarse.clamp_moment_Nm - fine.clamp_moment_Nm).max(axis=1)
    assert (moment / np.linalg.norm(fine.clamp_moment_Nm, axis=1))[gentle].max() < 1e-7


def test_small_point_load_is_the_linear_beam() -> None:
    contact, force = 0.16, 1e-4
    shape = weightless(contact, [0.0, 0.0, force])
    s = shape.arclength_m[0]
    bent = np.minimum(s, contact)
    z = force * bent**2 * (3 * contact - bent) / (6 * EI) + force * contact**2 / (2 * EI) * (s - bent)
    np.testing.assert_allclose(shape.points_m[0, :, 2], z, atol=1e-6 * z.max())
    # the moment's right-handed y component is minus the paper's τ_y = l·f_z
    np.testing.assert_allclose(-shape.clamp_moment_Nm[0, 1], contact * force, rtol=1e-6)


def test_natural_curvature_is_a_circle() -> None:
    for curvature, y_sign, z_sign in (([0.0, 1.5], 1.0, 0.0), ([1.5, 0.0], 0.0, -1.0)):
        rod = Rod(L, EI, GJ, 0.0, natural_curvature_per_m=np.array(curvature))
        shape = solve_rod(rod, np.zeros((1, 3)), np.array([L]), np.zeros((1, 3)))
        turn = 1.5 * shape.arclength_m[0]
        rise = (1 - np.cos(turn)) / 1.5
        expected = np.stack([np.sin(turn) / 1.5, y_sign * rise, z_sign * rise], axis=1)
        np.testing.assert_allclose(shape.points_m[0], expected, atol=1e-9 * L)


def test_boundary_value_solver_agrees_on_a_case_with_everything() -> None:
    """Quaternion, body-frame moment, both segments mapped on [0, 1]: nothing in common with the shooting."""
    rod = full_rod()
    gravity, contact = np.array([1.0, -4.0, -8.9]), 0.15
    force = np.array([-0.03, 0.14, -0.11])
    stiffness = np.array([GJ, EI, EI])
    rest = np.array([0.0, *rod.natural_curvature_per_m])
    lengths = (contact, L - contact)

    def rates(state: np.ndarray, s: np.ndarray, push: np.ndarray) -> np.ndarray:
        quaternion, moment = state[3:7], state[7:10]
        rotation = Rotation.from_quat(quaternion.T)
        internal = push + MASS * gravity * (L - s)[:, None]
        curvature = rest + moment.T / stiffness
        body_force = rotation.inv().apply(internal)
        vector, scalar = quaternion[:3].T, quaternion[3][:, None]
        turn = 0.5 * (scalar * curvature + np.cross(vector, curvature))
        turn_scalar = -0.5 * (vector * curvature).sum(axis=1)
        bend = -np.cross(curvature, moment.T) - np.cross([1.0, 0.0, 0.0], body_force)
        return np.vstack([rotation.apply([1.0, 0.0, 0.0]).T, turn.T, turn_scalar, bend.T])

    def equations(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        first = lengths[0] * rates(y[:10], x * lengths[0], force)
        second = lengths[1] * rates(y[10:], contact + x * lengths[1], np.zeros(3))
        return np.vstack([first, second])

    clamp = np.concatenate(
        [rod.T_antenna_clamp.translation_m, Rotation.from_matrix(rod.T_antenna_clamp.rotation).as_quat()]
    )

    def boundary(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        return np.concatenate([start[:7] - clamp, end[:10] - start[10:], end[17:]])

    mesh = np.linspace(0.0, 1.0, 41)
    guess = np.zeros((20, mesh.size))
    guess[3:7], guess[13:17] = clamp[3:, None], clamp[3:, None]
    solution = solve_bvp(equations, boundary, mesh, guess, tol=1e-9, max_nodes=20000)
    assert solution.success, solution.message

    shape = solve_rod(rod, gravity[None], np.array([contact]), force[None])
    steps = rod_module.STEPS_PER_SEGMENT
    share = np.linspace(0.0, 1.0, steps + 1)
    expected = np.vstack([solution.sol(share)[:3].T, solution.sol(share)[10:13].T[1:]])
    bending = np.degrees(np.arccos(shape.tangents[0, -1] @ rod.T_antenna_clamp.rotation[:, 0]))
    assert bending > 20.0
    np.testing.assert_allclose(shape.points_m[0], expected, atol=1e-7 * L)
    moment = Rotation.from_quat(clamp[3:]).apply(solution.sol(0.0)[7:10])
    about_origin = moment + np.cross(clamp[:3], force + MASS * L * gravity)
    np.testing.assert_allclose(shape.clamp_moment_Nm[0], about_origin, rtol=1e-7)


def test_work_of_the_force_is_the_stored_energy() -> None:
    nodes, weights = np.polynomial.legendre.leggauss(12)
    shares, weights = (nodes + 1) / 2, weights / 2
    contact, final = 0.17, np.array([-0.05, 0.2, 0.15])
    step = 1e-4
    paths = [
        solve_rod(
            bare_rod(), np.zeros((12, 3)), np.full(12, contact), (shares + sign * step)[:, None] * final
        ).points_m[:, rod_module.STEPS_PER_SEGMENT]
        for sign in (1, -1)
    ]
    speed = (paths[0] - paths[1]) / (2 * step)
    work = float(np.sum(weights * shares * (speed @ final)))
    shape = weightless(contact, final.tolist())
    lever = shape.points_m[0, rod_module.STEPS_PER_SEGMENT] - shape.points_m[0]
    moment = np.cross(lever, final)[: rod_module.STEPS_PER_SEGMENT + 1]
    energy = simpson((moment**2).sum(axis=1), x=shape.arclength_m[0, : len(moment)]) / (2 * EI)
    np.testing.assert_allclose(work, energy, rtol=1e-6)


def test_turning_everything_turns_the_solution() -> None:
    rod, (gravity, contact, force) = full_rod(), random_loads(8)
    shape = solve_rod(rod, gravity, contact, force)
    for rotvec in ([0.9, 0.0, 0.0], [0.5, -1.1, 0.8]):
        turn = Pose.from_rotvec(np.array(rotvec), np.zeros(3))
        turned = Rod(L, EI, GJ, MASS, turn @ rod.T_antenna_clamp, rod.natural_curvature_per_m)
        other = solve_rod(turned, turn @ gravity, contact, turn @ force)
        np.testing.assert_allclose(other.points_m, turn @ shape.points_m, atol=1e-11)
        np.testing.assert_allclose(other.clamp_moment_Nm, turn @ shape.clamp_moment_Nm, atol=1e-11)


def test_torsion_moves_only_a_bowed_rod() -> None:
    """Twist turns a straight rod of equal compliance about its own centreline, which stays where it is."""
    contact, gravity, force = np.array([0.18]), np.array([[0.0, 0.0, -G]]), np.array([[0.0, 0.2, 0.0]])
    for bow, low, high in ((0.0, 0.0, 1e-12), (1.0, 1e-5, 1e-2)):
        soft, stiff = (
            solve_rod(Rod(L, EI, gj, MASS, natural_curvature_per_m=np.array([bow, 0.0])), gravity, contact, force)
            for gj in (0.3 * GJ, 3.0 * GJ)
        )
        assert low <= np.abs(soft.points_m - stiff.points_m).max() / L <= high


def test_batch_is_its_elements_and_a_guess_changes_nothing() -> None:
    rod, (gravity, contact, force) = full_rod(), random_loads(5)
    together = solve_rod(rod, gravity, contact, force)
    again = solve_rod(rod, gravity, contact, force, together.clamp_moment_Nm)
    np.testing.assert_allclose(again.points_m, together.points_m, atol=1e-10)
    for i in range(5):
        alone = solve_rod(rod, gravity[i : i + 1], contact[i : i + 1], force[i : i + 1])
        np.testing.assert_allclose(alone.points_m[0], together.points_m[i], atol=1e-10)


@pytest.mark.parametrize("size", [(240.0, 0.8), (0.24, 0.8), (-0.24, 8e-4)])
def test_a_wire_is_given_in_metres(size: tuple[float, float]) -> None:
    assert wire(1e-3 * 240.0, 1e-3 * 0.8).length_m == 0.24
    with pytest.raises(InputError, match="metres"):
        wire(*size)
