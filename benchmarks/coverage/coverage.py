"""`vbaa bench coverage`: do whole calibrations know how wrong they are?

A calibration with priors is right about its uncertainty only over truths that scatter as the priors say. So the clamp,
the bow and the mass are drawn each time. Stiffness, gain and offset are drawn narrower than their priors, which are so
wide beside what the loads tell that they do not count. The shapes are the static rod's, which shares no code with the
model that is fitted.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.boards import BOARD, FISHEYE, HD, LONG, MILD, SQUARE, TALL, WIDE, bent_corners, noisy_view
from benchmarks.figures import AMBER, GREEN, GREY, SHADE, VIOLET, label, legend, panels
from benchmarks.harness import Findings, Options, column, table
from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.calibrate.antenna.bundle_adjustment import adjust_bundle
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.session_rig import bow_std_per_m, nominal_parameters, prior
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.pose.board_pose import jig_estimate, solve_board_pose
from vbaa_calib.camera import Camera, CameraOnPlane
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS
from vbaa_calib.session import Load, NominalAntenna, Still, gravity_antenna
from vbaa_calib.simulate.plan import _board_poses as board_poses
from vbaa_calib.simulate.scene.lens import Lens, project
from vbaa_calib.simulate.scene.scene import IntrinsicsSpec, camera_pose

NOMINAL = NominalAntenna(length_m=0.24, diameter_m=0.8e-3, youngs_modulus_Pa=193e9, density_kg_m3=7900.0)
GRAVITY_WORLD_M_S2 = np.array([0.0, 0.0, -9.80665])
T_ANTENNA_JIG = Pose.from_rotvec(np.array([3.06, 0.03, 0.02]), np.array([0.035, 0.062, -0.004]))
"""The board in the jig: face up, a few millimetres below C, not quite parallel to it."""
_JIG_PICTURES = 4
_LOOKED_AT_M = np.array([0.12, 0.0, 0.0])
"""The point of the antenna frame on the camera's axis."""
_REACH_M = (0.24, 0.12)
"""Sides of the part of C that is judged: the antenna's length, and half of it to either side."""
GRID = (9, 5)
_LEAST_CORNERS = 12
_SEED = 20260


@dataclass(frozen=True, eq=False)
class CoverageRig:
    """What is true of a rig whatever the draw.

    Attributes
    ----------
    name, lens_model : of the rig; of the true lens, as `--model` takes it.
    lens : the true lens, by OpenCV alone.
    T_camera_board : true poses of the board in the pictures of the lens.
    T_antenna_camera : true pose of the camera.
    sagittas_m : (2,) bend of the board, in the pictures of the lens and in the jig.
    outliers : share of corners that are shifted, in both.
    T_antenna_jig : of the board in the jig.
    """

    name: str
    lens_model: str
    lens: Lens
    T_camera_board: tuple[Pose, ...]
    T_antenna_camera: Pose
    sagittas_m: tuple[float, float] = (0.0, 0.0)
    outliers: float = 0.0
    T_antenna_jig: Pose = T_ANTENNA_JIG

    @property
    def board_points_m(self) -> np.ndarray:
        """(C, 3) true corners in the board's frame."""
        return bent_corners(self.sagittas_m)

    def seen_corners(self, T_camera_board: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Ids (N,) and true pixels (N, 2) of the corners inside the picture."""
        pixels = project(self.lens, T_camera_board @ self.board_points_m)
        ids = np.flatnonzero(self.inside(pixels))
        return ids, pixels[ids]

    def inside(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) which pixels (N, 2) lie inside the picture, by a pixel; NaN does not."""
        return np.all((pixels > 1) & (pixels < np.array(self.lens.image_size) - 2), axis=1)

    def antenna_pixels(self, points_m: np.ndarray) -> np.ndarray:
        """(N, 2) true pixels of points (N, 3) in the antenna frame."""
        return project(self.lens, self.T_antenna_camera.inverse() @ points_m)

    def points_on_c(self) -> tuple[np.ndarray, np.ndarray]:
        """(M, 2) points of C within the antenna's reach that the picture shows, m, and their true pixels (M, 2)."""
        x, y = (np.linspace(0.0, side, count) for side, count in zip(_REACH_M, GRID, strict=True))
        points = np.stack(np.meshgrid(x, y - _REACH_M[1] / 2), axis=-1).reshape(-1, 2)
        pixels = self.antenna_pixels(np.column_stack([points, np.zeros(len(points))]))
        seen = self.inside(pixels)
        return points[seen], pixels[seen]


def coverage_rigs() -> list[CoverageRig]:
    """The rigs, always the same."""
    near, far, above = (0.14, 0.24), (0.24, 0.42), (0.6, 1.0, 0.36)
    spoilt: dict[str, Any] = {"sagittas_m": (5e-4, 0.0), "outliers": 0.05}
    return [
        _rig("f 900, 25 views", "opencv5", (HD, MILD), 25, near, above),
        _rig("long lens, f 2800, 22 views", "opencv5", (SQUARE, LONG), 22, far, (0.5, 0.8, 0.48)),
        _rig("wide, rational, f 590, 20 views", "rational", (HD, WIDE), 20, near, (0.6, 1.0, 0.28)),
        _rig("fisheye, f 420, 20 views", "fisheye", (TALL, FISHEYE), 20, (0.11, 0.2), (0.5, -0.9, 0.22)),
        _rig("f 900, 8 views", "opencv5", (HD, MILD), 8, near, above),
        _rig("f 900, 5 % outliers, bowed 0.5 mm", "opencv5", (HD, MILD), 25, near, above, **spoilt),
    ]


def _rig(
    name: str,
    model: str,
    optics: tuple[tuple[int, int], np.ndarray],
    views: int,
    distance_m: tuple[float, float],
    looking: tuple[float, float, float],
    **spoilt: Any,
) -> CoverageRig:
    """`optics` : the picture's size and intrinsics (4 + k,). `looking` : the camera's incline and azimuth, rad, and its
    distance from the antenna's middle, m."""
    size, (fx, fy, cx, cy, *distortion) = optics
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    lens = Lens("fisheye" if model == "fisheye" else "opencv", size, matrix, np.array(distortion))
    rig = CoverageRig(name, model, lens, (), camera_pose(*looking[:2], 0.0, looking[2], _LOOKED_AT_M), **spoilt)
    return with_views(rig, views, distance_m)


def with_views(rig: CoverageRig, views: int, distance_m: tuple[float, float]) -> CoverageRig:
    """With so many pictures of the board by hand, at distances between two, m."""
    spec = IntrinsicsSpec(2 * views, distance_m, (0.2, 0.7))
    poses = board_poses(rig.lens, BOARD, spec, np.random.default_rng(_SEED))
    kept = [pose for pose in poses if len(rig.seen_corners(pose)[0]) >= _LEAST_CORNERS]
    return replace(rig, T_camera_board=tuple(kept[:views]))


CENTRELINE_PX, TIP_PX, MOMENT_NM = 0.1, 0.1, 2e-5
"""Standard deviations of a centreline point and of the tip, per axis, and of a moment reading."""
ENDS = 7
"""Seed of the tips, beside a draw's own."""
_LOG_STIFFNESS_SPREAD, _GAIN_SPREAD, _OFFSET_SPREAD_NM = 0.05, 0.05, 5e-4
"""Of the true values, where they are narrower than the priors."""
_TILTS_RAD = (0.0, 0.5, -0.4, 0.9, -0.8)
_HANGING = ((0.12, 0.0, 0.09), (0.15, 0.5, -0.07), (0.18, -0.4, 0.05), (0.21, 0.9, -0.04), (0.235, -0.8, 0.03))
"""Known loads: distance from the clamp m, tilt rad, force N; each hung once along y and once along z."""
_BEGIN = 0.01


@dataclass(frozen=True, eq=False)
class Seen:
    """One still: the antenna's centreline (N, 2) px, and gravity (3,) in the antenna frame."""

    still: Still
    points_px: np.ndarray
    gravity_m_s2: np.ndarray
    tip_px: np.ndarray


@dataclass(frozen=True, eq=False)
class Draw:
    """What a calibration is given, and the truth.

    Attributes
    ----------
    views, jig_views : of the board by hand and in the jig. stills : of the free and the loaded antenna.
    truth : (11,) antenna parameters, gain, offset: `RIG_PARAMETERS` after the pose.
    tip_m : how far beyond the antenna's length its visible end lies.
    """

    rig: CoverageRig
    views: list[BoardView]
    jig_views: list[BoardView]
    stills: list[Seen]
    truth: np.ndarray
    tip_m: float


def draw(rig: CoverageRig, seed: tuple[int, ...], truth: np.ndarray | None = None) -> Draw:
    """One draw, of an antenna and sensor (11,) or of a drawn one; the same seed gives the same."""
    rng = np.random.default_rng(seed)
    truth = drawn_truth(rng) if truth is None else truth
    T_camera_jig = rig.T_antenna_camera.inverse() @ rig.T_antenna_jig
    ends = np.random.default_rng((*seed, ENDS))
    tip_m = (NOMINAL.tip_std_m or 0.0) * float(ends.normal())

    def view(name: str, T_camera_board: Pose) -> BoardView:
        ids, pixels = rig.seen_corners(T_camera_board)
        return noisy_view(name, ids, pixels, rig.lens.image_size, rig.outliers, rng)[0]

    return Draw(
        rig=rig,
        views=[view(f"{index:02d}.png", pose) for index, pose in enumerate(rig.T_camera_board)],
        jig_views=[view(f"jig_{index}.png", T_camera_jig) for index in range(_JIG_PICTURES)],
        stills=_stills(rig, truth, rng, tip_m, ends),
        truth=truth,
        tip_m=tip_m,
    )


def true_rod(truth: np.ndarray) -> Rod:
    """The antenna of parameters (11,), a wire with ν = 0.3."""
    y, z, about_y, about_z, bow_y, bow_z, log_stiffness, log_mass = truth[:8]
    stiffness = np.exp(log_stiffness)
    clamp = Pose(Rotation.from_rotvec([0.0, about_y, about_z]).as_matrix(), np.array([0.0, y, z]))
    return Rod(NOMINAL.length_m, stiffness, stiffness / 1.3, np.exp(log_mass), clamp, np.array([bow_y, bow_z]))


def drawn_truth(rng: np.random.Generator) -> np.ndarray:
    """(11,) antenna parameters, gain and offset."""
    std = (
        [AntennaSettings.clamp_offset_std_m] * 2
        + [AntennaSettings.clamp_angle_std_rad] * 2
        + [bow_std_per_m(NOMINAL.length_m)] * 2
    )
    spread = np.array(
        [
            *std,
            _LOG_STIFFNESS_SPREAD,
            AntennaSettings.log_mass_std,
            AntennaSettings.clamp_give_std_m,
            _GAIN_SPREAD,
            _OFFSET_SPREAD_NM,
        ]
    )
    return np.concatenate([nominal_parameters(NOMINAL), [1.0, 0.0]]) + spread * rng.normal(size=11)


@dataclass(frozen=True, eq=False)
class Bent:
    """F antennas under weight and load, whose clamp gives way; what is seen turns with it.

    shape : by the rod, in the clamp's own frame. held : how far the clamp gives way to the moment that it holds.
    clamp_yz_m : (2,) where it is. readings_Nm : (F,) of the moment sensor, without noise.
    """

    shape: RodShape
    held: Rotation
    clamp_yz_m: np.ndarray
    readings_Nm: np.ndarray

    @staticmethod
    def of(truth: np.ndarray, gravity: np.ndarray, hung: np.ndarray) -> Bent:
        """By parameters (11,) as of `Draw.truth`, gravity (F, 3), and loads (F, 4): distance and force."""
        rod = true_rod(truth)
        moment = solve_rod(rod, gravity, hung[:, 0], hung[:, 1:]).clamp_moment_Nm
        held = Rotation.from_rotvec(truth[8] / np.exp(truth[6]) * moment * [0.0, 1.0, 1.0])
        # the clamp turns: as if weight and load turned the other way, and then all that is seen with the clamp
        shape = solve_rod(rod, held.inv().apply(gravity), hung[:, 0], held.inv().apply(hung[:, 1:]))
        gain, offset = truth[9:]
        return Bent(shape, held, truth[:2], offset - gain * held.apply(shape.clamp_moment_Nm)[:, 1])

    def pixels(self, rig: CoverageRig, index: int, arclength_m: np.ndarray) -> np.ndarray:
        """(N, 2) true pixels of one antenna at arc lengths (N,), m."""
        one = RodShape(*(values[index : index + 1] for values in vars(self.shape).values()))
        points, clamp = sample_shape(one, arclength_m[None])[0][0], np.append(0.0, self.clamp_yz_m)
        return rig.antenna_pixels(clamp + self.held[index].apply(points - clamp))

    def tip_px(self, rig: CoverageRig, index: int, tip_m: float) -> np.ndarray:
        """(2,) true pixel of one antenna's visible end, so far beyond its length; NaN outside the picture."""
        near = 1e-3
        before, end = self.pixels(rig, index, np.array([NOMINAL.length_m - near, NOMINAL.length_m]))
        tip_px = end + tip_m / near * (end - before)
        return tip_px if rig.inside(tip_px[None])[0] else np.full(2, np.nan)

    def line_px(self, rig: CoverageRig, index: int) -> np.ndarray:
        """(N, 2) true pixels of one antenna's centreline, about one pixel apart, as far as the picture shows it."""
        way = np.diff(self.pixels(rig, index, np.linspace(_BEGIN, 1.0, 60) * NOMINAL.length_m), axis=0)
        count = int(np.nansum(np.linalg.norm(way, axis=1))) + 1
        pixels = self.pixels(rig, index, np.linspace(_BEGIN, 1.0, count) * NOMINAL.length_m)
        return pixels[rig.inside(pixels)]


def _stills(
    rig: CoverageRig, truth: np.ndarray, rng: np.random.Generator, tip_m: float, ends: np.random.Generator
) -> list[Seen]:
    stills: list[Still] = [Still(image=None, pan_rad=0.0, tilt_rad=tilt, moment_Nm=0.0) for tilt in _TILTS_RAD]
    stills += [
        Load(None, 0.0, tilt, 0.0, distance_m=distance, force_y_N=force * along_y, force_z_N=force * (1.0 - along_y))
        for distance, tilt, force in _HANGING
        for along_y in (1.0, 0.0)
    ]
    gravity = gravity_antenna(Kinematics(), GRAVITY_WORLD_M_S2, stills)
    loads = [(s.distance_m, 0.0, s.force_y_N, s.force_z_N) if isinstance(s, Load) else (0.1, 0, 0, 0) for s in stills]
    bent = Bent.of(truth, gravity, np.array(loads, float))
    readings = bent.readings_Nm + MOMENT_NM * rng.normal(size=len(stills))
    seen = []
    for index, still in enumerate(stills):
        pixels = bent.line_px(rig, index)
        pixels = pixels + CENTRELINE_PX * rng.normal(size=pixels.shape)
        tip_px = bent.tip_px(rig, index, tip_m) + TIP_PX * ends.normal(size=2)
        seen.append(Seen(replace(still, moment_Nm=float(readings[index])), pixels, gravity[index], tip_px))
    return seen


@dataclass(frozen=True, eq=False)
class Solved:
    """What a calibration says, in the form that the benchmark judges.

    Attributes
    ----------
    camera, T_antenna_camera : solved lens and pose.
    parameters : (11,) antenna, gain and offset: `RIG_PARAMETERS` after the pose.
    covariance : (17, 17) of `RIG_PARAMETERS`, the pose's six about the solved pose.
    plane_covariance : (P + 6, P + 6) of the lens, then of the pose: `CameraOnPlane.parameter_names`.
    """

    camera: Camera
    T_antenna_camera: Pose
    parameters: np.ndarray
    covariance: np.ndarray
    plane_covariance: np.ndarray


def prior_of(given: Draw) -> Prior:
    """Lens from the views, then pose of C from the jig."""
    lens = solve_intrinsics(given.views, BOARD, model=given.rig.lens_model)
    board_pose = solve_board_pose(given.jig_views, lens.board_shape, lens.camera)
    return prior(NOMINAL, lens.camera, [jig_estimate(board_pose, given.rig.T_antenna_jig)])


def solve(given: Draw) -> Solved:
    """Lens from the views, pose of C from the jig, then everything together from the stills.

    Raises VbaaError as these do.
    """
    joint = adjust_bundle(observations(given), prior_of(given), NOMINAL.length_m, MOMENT_NM)
    first = len(RIG_PARAMETERS)
    order = np.r_[first : len(joint.covariance), :6]
    return Solved(
        joint.camera,
        joint.T_antenna_camera,
        parameters=joint.parameters[6:],
        covariance=joint.covariance[:first, :first],
        plane_covariance=joint.covariance[np.ix_(order, order)],
    )


def observations(given: Draw) -> list[Observation]:
    """The stills as the joint solve takes them, with the deviations that are true."""
    sigma = (np.full(len(seen.points_px), CENTRELINE_PX) for seen in given.stills)
    return [
        Observation(seen.still, seen.points_px, own, seen.gravity_m_s2, tip_px=seen.tip_px, tip_std_px=TIP_PX)
        for seen, own in zip(given.stills, sigma, strict=True)
    ]


_REGION = 0.95


@dataclass(frozen=True, eq=False)
class Errors:
    """K things of d numbers each in one draw: errors (K, d), solved less true, and predicted covariances (K, d, d)."""

    errors: np.ndarray
    covariances: np.ndarray

    @property
    def whitened(self) -> np.ndarray:
        """(K, d) errors over their predicted standard deviations, number by number."""
        return self.errors / np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))

    @property
    def squares(self) -> np.ndarray:
        """(K,) eᵀ Σ⁻¹ e: χ² with d degrees of freedom if the covariances are right."""
        std = np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))
        correlation = self.covariances / (std[..., :, None] * std[..., None, :])
        solved = np.linalg.solve(correlation, self.whitened[..., None])[..., 0]
        return (self.whitened * solved).sum(axis=-1)


def statistics(draws: Sequence[Errors]) -> dict[str, Any]:
    """Of one quantity over at least two draws, the columns of `coverage.Row` from `ratio` on."""
    whitened = np.array([draw.whitened for draw in draws])
    scatter = whitened - whitened.mean(axis=0)
    squares = (scatter**2).mean(axis=(1, 2))
    root = np.sqrt(len(draws))
    ratio = float(np.sqrt(squares.sum() / (len(draws) - 1)))
    each, mean = whitened.std(axis=0, ddof=1), whitened.mean(axis=0)
    things, numbers = whitened.shape[1:]
    inside = np.array([draw.squares for draw in draws]) <= chi2.ppf(_REGION, numbers)
    # things that share a draw share its errors: what scatters is the draw's share
    spread = np.sqrt(_REGION * (1 - _REGION)) if things == 1 else float(inside.mean(axis=1).std(ddof=1))
    variances = np.array([np.diagonal(draw.covariances, axis1=-2, axis2=-1) for draw in draws])
    return {
        "ratio": ratio,
        # of a mean of squares, and the root halves it
        "ratio_error": float(squares.std(ddof=1) / root / (2.0 * ratio)),
        "worst_ratio": float(each.ravel()[np.abs(np.log(each)).argmax()]),
        "covered": float(inside.mean()),
        "covered_error": spread / float(root),
        "bias": float(mean.ravel()[np.abs(mean).argmax()]),
        "predicted_std": float(np.sqrt(variances.mean())),
    }


if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RATIO_GOAL = 0.15
COVERED_GOAL = (0.93, 0.97)
JUDGED = ("points on C", "camera pose", "EI")
"""The quantities that the goal is about."""
_POINTS = "points on C"
_QUANTITIES = {
    _POINTS: (slice(0), "mm", 1e3),
    "camera turn": (slice(0, 3), "mrad", 1e3),
    "camera place": (slice(3, 6), "mm", 1e3),
    "camera pose": (slice(0, 6), "", 0.0),
    "EI": (slice(12, 13), "%", 1e2),
    "mass": (slice(13, 14), "%", 1e2),
    "clamp": (slice(6, 10), "", 0.0),
    "bow": (slice(10, 12), "1/m", 1.0),
    "clamp give": (slice(14, 15), "", 0.0),
    "gain": (slice(15, 16), "%", 1e2),
    "offset": (slice(16, 17), "mN·m", 1e3),
    "pose, antenna, sensor": (slice(0, 17), "", 0.0),
}
"""Name → rows among `RIG_PARAMETERS`, unit, and its factor on SI; none where units are mixed."""


@dataclass(frozen=True)
class Row:
    """One quantity on one rig, over the draws.

    judged : whether the goal is about it. met : within 15 % (`ratio` and `worst_ratio`) and 93 to 97 %.
    draws, failed : how many draws count, and how many could not be solved.
    ratio : sampled over predicted standard deviation, in the mean square over the quantity's numbers. ratio_error : its
        standard error. worst_ratio : that of the number whose ratio is furthest from 1.
    covered : share of the 95 % regions that hold the truth. covered_error : its standard error.
    bias : mean error in predicted standard deviations, of the number where it is largest; its standard error is
        1/√draws where only noise is at work.
    predicted_std : typical predicted standard deviation (rms over draws and numbers); None, and no unit, where units
        are mixed.
    """

    rig: str = column("rig")
    quantity: str = column("quantity")
    judged: bool = column()
    met: bool = column()
    draws: int = column()
    failed: int = column()
    ratio: float = column("ratio", ".3f")
    ratio_error: float = column("±", ".3f")
    worst_ratio: float = column("worst", ".3f")
    covered: float = column("covered %", ".1f", 100)
    covered_error: float = column("±", ".1f", 100)
    bias: float = column("bias", ".2f")
    predicted_std: float | None = column("predicted", ".3g")
    unit: str = column("unit")


def errors_of(given: Draw, solved: Solved) -> dict[str, Errors]:
    """Solved less true by quantity, with the predicted covariances."""
    pose = solved.T_antenna_camera.tangent_from(given.rig.T_antenna_camera)
    step = np.concatenate([pose, solved.parameters - given.truth])
    points, pixels = given.rig.points_on_c()
    layer = CameraOnPlane(solved.camera, solved.T_antenna_camera)
    jacobian = layer.calibration_jacobian(pixels)
    of_points = jacobian @ solved.plane_covariance @ np.swapaxes(jacobian, 1, 2)
    found = {
        name: Errors(step[None, own], solved.covariance[None, own, own]) for name, (own, *_) in _QUANTITIES.items()
    }
    return found | {_POINTS: Errors(layer.project(pixels)[0] - points, of_points)}


@cache
def _rigs() -> list[CoverageRig]:
    return coverage_rigs()


def outcome(task: tuple[int, int, int]) -> Mapping[str, Errors] | str:
    """One draw solved: (seed, number of the rig, number of the draw). Depends on nothing else.

    Its errors by quantity, or why there are none.
    """
    given = draw(_rigs()[task[1]], task)
    try:
        found = errors_of(given, solve(given))
    except VbaaError as error:
        return str(error).splitlines()[0]
    known = all(np.isfinite(errors.errors).all() for errors in found.values())
    return found if known else "a pixel of C has no ray through the solved lens"


def outcomes(tasks: Sequence[tuple[int, int, int]], jobs: int) -> Iterator[Mapping[str, Errors] | str]:
    """Of every task in order, by so many processes."""
    if jobs == 1:
        yield from map(outcome, tasks)
        return
    # torch does not survive a fork
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(outcome, tasks, chunksize=4)


def run(draws: int, seed: int, jobs: int = 1, chosen: Sequence[int] | None = None) -> tuple[list[Row], list[str]]:
    """Every quantity on every rig (or those of the numbers chosen), and a line for each rig of which draws failed."""
    rigs = list(range(len(_rigs()))) if chosen is None else list(chosen)
    tasks = [(seed, rig, number) for rig in rigs for number in range(draws)]
    found = list(progress(outcomes(tasks, jobs), "draws", len(tasks)))
    rows, failed = list[Row](), []
    for place, rig in enumerate(rigs):
        name, own = _rigs()[rig].name, found[place * draws : (place + 1) * draws]
        failures = [one for one in own if isinstance(one, str)]
        rows += _rows(name, [one for one in own if not isinstance(one, str)], len(failures))
        if failures:
            failed.append(f"{name}, {len(failures)} of {draws} failed: {'; '.join(sorted(set(failures)))}")
    return rows, failed


def _rows(rig: str, good: Sequence[Mapping[str, Errors]], failed: int) -> Iterator[Row]:
    for quantity in good[0] if len(good) > 1 else ():
        numbers = statistics([errors[quantity] for errors in good])
        _, unit, factor = _QUANTITIES[quantity]
        near = all(abs(numbers[name] - 1.0) <= _RATIO_GOAL for name in ("ratio", "worst_ratio"))
        numbers["predicted_std"] = factor * numbers["predicted_std"] if unit else None
        met = near and COVERED_GOAL[0] <= numbers["covered"] <= COVERED_GOAL[1]
        yield Row(rig, quantity, quantity in JUDGED, met, len(good), failed, **numbers, unit=unit)


_SHOWN = {"points on C": GREEN, "camera pose": AMBER, "EI": VIOLET, "pose, antenna, sensor": GREY}
"""Quantities of the figure → colour."""


def as_text(rows: Sequence[Row], failed: Sequence[str], draws: int) -> str:
    """The table for people."""
    title = (
        f"{draws} draws a rig; ratio: sampled over predicted standard deviation, then that of the worst number of the "
        "quantity;\ncovered: 95 % regions that hold the truth; bias: largest mean error, in predicted deviations; "
        f"goal: ratios within {_RATIO_GOAL:.0%} and {COVERED_GOAL[0]:.0%} to {COVERED_GOAL[1]:.0%}"
    )
    goal = {"goal": lambda row: ("met" if row.met else "missed") if row.judged else ""}
    return "\n".join([table(rows, title, 1, goal) if rows else title, *failed])


def figure(rows: Sequence[Row], draws: int) -> Figure:
    """Ratio and coverage of the main quantities, rig by rig, with two standard errors and the goal's band."""
    names = list(dict.fromkeys(row.rig for row in rows))
    drawn, (left, right) = panels(2, 2, (5.5, 1.3 + 0.75 * len(names)), sharey=True)
    left.axvspan(1 - _RATIO_GOAL, 1 + _RATIO_GOAL, color=SHADE)
    right.axvspan(*(100 * share for share in COVERED_GOAL), color=SHADE)
    left.axvline(1.0, color=GREY, lw=0.8)
    right.axvline(95.0, color=GREY, lw=0.8)
    for shift, (quantity, colour) in enumerate(_SHOWN.items()):
        own = [row for row in rows if row.quantity == quantity]
        y = [names.index(row.rig) + 0.18 * (shift - 1.5) for row in own]
        for panel, name, scale in ((left, "ratio", 1), (right, "covered", 100)):
            values, errors = ([scale * getattr(row, f"{name}{end}") for row in own] for end in ("", "_error"))
            panel.errorbar(values, y, xerr=2 * np.array(errors), fmt="o", color=colour, markersize=4, lw=1.2)
    left.set_yticks(range(len(names)), names, fontsize=9)
    left.invert_yaxis()
    label(left, x="sampled over predicted standard deviation")
    label(right, x="95 % regions that hold the truth, %")
    legend(drawn, {quantity: (colour, "o") for quantity, colour in _SHOWN.items()})
    drawn.suptitle(f"{draws} noise draws a rig; bars: two standard errors; grey: the goal", fontsize=10)
    return drawn


def measure(options: Options) -> Findings:
    """Every quantity on every rig; a draw is one calibration."""
    rows, failed = run(options.draws, options.seed, options.jobs)
    judged = [row for row in rows if row.judged]
    ratios = [row.ratio for row in judged]
    return Findings(
        as_text(rows, failed, options.draws),
        {"coverage.csv": rows},
        {"coverage.png": lambda: figure(rows, options.draws)},
        {"rows": rows},
        f"goal met by {sum(row.met for row in judged)} of {len(judged)}; sampled over predicted deviation "
        f"{min(ratios):.2f} to {max(ratios):.2f}"
        if judged
        else "no rig could be calibrated twice",
    )
