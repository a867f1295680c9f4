"""`vbaa bench paper`: the paper's Figs. 7 and 5 redone with its antenna, in simulation.

Fig. 7: three slippery knife edges of different normal direction, touched at distances along the antenna. Fig. 5: an
antenna dragged to and fro over a knife edge. The normal ν is across the line through the contact points in the yz
plane, ψ the force's direction there. While it slides the force lies on the cone's one or other side: |ψ − ν| = α =
atan μ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.estimator.scenes import seen
from benchmarks.estimator.setup import TOWARDS_CLAMP, Setup, drawn_truth, filling_pose, rod_of
from benchmarks.figures import COLOURS, INK, SHADE, label, panels
from benchmarks.harness import (
    Draws,
    Findings,
    Options,
    column,
    concatenated,
    covered,
    mean,
    rms_known,
    row_of,
    spread,
    table,
)
from benchmarks.object.scenes import contact_table
from estimator import ContactEstimator
from estimator.object.estimate import ObjectEstimate, estimate_object
from estimator.paper.baselines import press_from_recording, run_method
from estimator.paper.two_point import contact_position
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.antenna.rod import RodShape, sample_shape, solve_rod
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose, rotation_world_antenna
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.contact.touch import touch
from vbaa_calib.simulate.scene.objects import TouchObject

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# --- the paper's rig, its pictures and readings

POINTS = 200
_FOCAL_WIDTHS, WIDTH_PX, SWING_M = 2.5, 512, 0.03


def paper_rig() -> Rig:
    """The rig as calibrated: weight, bow and a clamp that is off, known as well as an ordinary calibration knows."""
    focal = _FOCAL_WIDTHS * WIDTH_PX
    middle = 0.5 * (WIDTH_PX - 1)
    camera = Camera(
        "opencv", (WIDTH_PX, WIDTH_PX), np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]]), np.zeros(0)
    )
    rig = Setup("none", image_size=(WIDTH_PX, WIDTH_PX), real=True, exact=False).rig()
    return replace(rig, camera=camera, T_antenna_camera=filling_pose(camera, 0.0, TOWARDS_CLAMP, SWING_M))


def free_shape(rig: Rig, gravity_m_s2: np.ndarray) -> RodShape:
    """The true antenna without contact, under gravity (B, 3), antenna frame."""
    rod = rod_of(rig)
    return solve_rod(rod, gravity_m_s2, np.full(len(gravity_m_s2), 0.5 * rod.length_m), np.zeros_like(gravity_m_s2))


def free_point(rig: Rig, distance_m: float) -> np.ndarray:
    """(3,) of the true antenna without contact at the joints' zero, at an arc length, antenna frame."""
    free = free_shape(rig, rig.gravity_world_m_s2[None])
    return np.array([np.interp(distance_m, free.arclength_m[0], free.points_m[0, :, axis]) for axis in range(3)])


@dataclass(frozen=True, eq=False)
class Pictures:
    """B frames as the true rig sees and feels them, without noise.

    points_px : (B, N, 2). moment_Nm : (B, 2) readings (τ_z, τ_y); the sensor about z is as good as the rig's.
    """

    points_px: np.ndarray
    moment_Nm: np.ndarray

    def noisy(self, rig: Rig, sigma_px: float, rng: np.random.Generator) -> Pictures:
        """With a draw of noise: points by `sigma_px`, readings by the sensor's."""
        return Pictures(
            self.points_px + rng.normal(0.0, sigma_px, self.points_px.shape),
            self.moment_Nm + rng.normal(0.0, rig.moment_sensor.std_Nm, self.moment_Nm.shape),
        )


def taken(true: Rig, shape: RodShape) -> Pictures:
    """The pictures and readings of antennas, by the true rig."""
    s = true.antenna.length_m * (np.arange(POINTS) + 0.5) / POINTS
    there = sample_shape(shape, np.broadcast_to(s, (len(shape.points_m), POINTS)))[0]
    moment = np.stack([shape.clamp_moment_Nm[:, 2], -shape.clamp_moment_Nm[:, 1]], axis=1)
    sensor = true.moment_sensor
    return Pictures(seen(true.camera, true.T_antenna_camera, there), sensor.gain * moment + sensor.offset_Nm)


@dataclass(frozen=True, eq=False)
class Touched:
    """B frames of a true antenna on an edge: what it shows touched and free, and the truth.

    pan_rad, tilt_rad : (B,). rotation : (B, 3, 3) antenna frame to world. distance_m : (B,). point_m : (B, 3) contacts,
    world. force_N, normal : (B, 3) on the antenna, and outward of the edge, antenna frame.
    """

    pictures: Pictures
    free: Pictures
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    rotation: np.ndarray
    distance_m: np.ndarray
    point_m: np.ndarray
    force_N: np.ndarray
    normal: np.ndarray

    def noisy(self, rig: Rig, sigma_px: float, rng: np.random.Generator) -> tuple[Pictures, Pictures]:
        """Its pictures touched and free with a draw of noise."""
        return self.pictures.noisy(rig, sigma_px, rng), self.free.noisy(rig, sigma_px, rng)


def touched(true: Rig, obj: TouchObject, poses: Sequence[Pose], joints: np.ndarray, free_m_s2: np.ndarray) -> Touched:
    """The antenna at poses and joints (2, B) on an object, and free under gravity (F, 3), antenna frame."""
    found = touch(rod_of(true), 0.5 * true.antenna.diameter_m, obj, poses, true.gravity_world_m_s2)
    rotation = np.stack([pose.rotation for pose in poses])
    point = np.array([pose @ contact for pose, contact in zip(poses, found.contact_antenna_m, strict=True)])
    normal = np.einsum("bi,bij->bj", obj.signed_distance(point)[1], rotation)
    seen, free = taken(true, found.shape), taken(true, free_shape(true, free_m_s2))
    return Touched(seen, free, joints[0], joints[1], rotation, found.contact_m, point, found.force_antenna_N, normal)


def knife_edge(
    normal_deg: float, touch_point_m: np.ndarray, antenna_radius_m: float, radius_m: float, friction: float = 0.0
) -> TouchObject:
    """An edge in the world's yz plane that an antenna whose centreline passes `touch_point_m` just touches.

    Its normal towards the antenna is turned by the angle from −y towards −z.
    """
    angle = np.radians(normal_deg)
    outward = np.array([0.0, -np.cos(angle), -np.sin(angle)])
    return TouchObject(
        "knife_edge",
        touch_point_m - (radius_m + antenna_radius_m) * outward,
        np.array([0.0, -np.sin(angle), np.cos(angle)]),
        radius_m,
        half_length_m=0.3,
        friction=friction,
        wedge_world=-outward,
    )


Answer = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Distances (B,), their deviations (B,) and forces (B, 3), antenna frame; NaN where there are none."""


def by_two_points(rig: Rig, pictures: Pictures, free: Pictures, sigma_px: float) -> Answer:
    """The paper's camera A, frame by frame."""
    seen = (pictures.points_px, pictures.moment_Nm), (free.points_px, free.moment_Nm)
    still = np.zeros(len(pictures.points_px))
    press = press_from_recording(rig, *seen, (still, still), sigma_px=sigma_px)
    points, moments = np.asarray(press.points_m), np.asarray(press.moment_Nm)
    found = [
        run_method("3D-VBAA, camera A", replace(press, turn_rad=None, moment_Nm=moment[None], points_m=line[None]))
        for line, moment in zip(points, moments, strict=True)
    ]
    distance, std, force = (
        [getattr(one, name) for one in found] for name in ("distance_m", "distance_std_m", "force_N")
    )
    return np.array(distance), np.array(std), np.array(force)


def direction_deg(force_N: np.ndarray) -> np.ndarray:
    """(...) angle of −f (..., 3) in the yz plane from y."""
    return np.degrees(np.arctan2(-force_N[..., 2], -force_N[..., 1]))


# --- Fig. 7

NORMALS_DEG = (0.0, 30.0, 60.0)
"""Between the edge's normal and the direction in which the base turns, in the antenna's yz plane."""
DISTANCES_M = np.linspace(0.06, 0.22, 9)
_PUSH_RAD = np.radians(6.0)
SIGMAS_PX = (0.1, 0.3)
TWO_POINTS, ALL_POINTS = "two points, the paper's", "all points, the estimator"
_SENSING_RIGS = 8
"""Rigs that the same calibration may belong to; the draws are shared among them."""


@dataclass(frozen=True)
class SensingRow:
    """One object touched at one distance, over the draws. NaN where no draw was answered.

    answered : share of the draws. l_mean_mm, l_std_mm, l_rms_mm : of the distances, their scatter and errors.
    l_stated_mm : typical stated deviation. direction_* : of −f in the yz plane from y, in degrees. lean_rms_deg : the
    whole force, in space, from the object's normal at the contact. covered : share of 95 % intervals of l that hold it.
    """

    method: str
    sigma_px: float
    normal_deg: float
    l_true_mm: float
    direction_true_deg: float
    draws: int
    answered: float
    l_mean_mm: float
    l_std_mm: float
    l_rms_mm: float
    l_stated_mm: float
    covered: float
    direction_mean_deg: float
    direction_std_deg: float
    direction_rms_deg: float
    lean_rms_deg: float


def touched_edges(true: Rig, normal_deg: float) -> Touched:
    """The base stands so that the free antenna just touches at each distance, then turns by `_PUSH_RAD` about z."""
    turn, gravity = rotation_world_antenna(_PUSH_RAD, 0.0), true.gravity_world_m_s2
    obj = knife_edge(normal_deg, np.zeros(3), 0.5 * true.antenna.diameter_m, 2e-4)
    poses = [Pose(turn, -free_point(true, distance)) for distance in DISTANCES_M]
    joints = np.array([[_PUSH_RAD], [0.0]]).repeat(len(poses), axis=1)
    return touched(true, obj, poses, joints, gravity[None])


def sensing(draws: int, seed: int) -> list[SensingRow]:
    """All objects, noises and both ways."""
    rig, rows = paper_rig(), list[SensingRow]()
    rng = np.random.default_rng(seed)
    trues = [drawn_truth(rig, rng) for _ in range(min(_SENSING_RIGS, draws))]
    for normal_deg in NORMALS_DEG:
        edges = [touched_edges(true, normal_deg) for true in trues]
        for sigma_px in SIGMAS_PX:
            used = [edges[draw % len(edges)] for draw in range(draws)]
            drawn = [each.pictures.noisy(rig, sigma_px, rng) for each in used]
            answers = {
                TWO_POINTS: [
                    by_two_points(rig, pictures, each.free.noisy(rig, sigma_px, rng), sigma_px)
                    for pictures, each in zip(drawn, used, strict=True)
                ],
                ALL_POINTS: _by_all_points(rig, drawn, sigma_px),
            }
            for method, several in answers.items():
                rows += _sensing_rows(method, sigma_px, normal_deg, used, several)
    return rows


def _by_all_points(rig: Rig, drawn: list[Pictures], sigma_px: float) -> list[Answer]:
    """The estimator without friction, all draws in one batch."""
    together = concatenated(drawn)
    count = len(together.points_px)
    found = ContactEstimator(rig, friction=0.0).estimate_batch(
        together.points_px, together.moment_Nm[:, 1], np.full(count, _PUSH_RAD), np.zeros(count), sigma_px=sigma_px
    )
    columns = found.distance_m, found.distance_std_m, found.force_N
    return list(zip(*(np.split(values, len(drawn)) for values in columns), strict=True))


def _sensing_rows(
    method: str, sigma_px: float, normal_deg: float, used: list[Touched], several: list[Answer]
) -> Iterator[SensingRow]:
    distance, std, force = (np.array(each) for each in zip(*several, strict=True))
    true, pushed = np.array([each.distance_m for each in used]), np.array([each.force_N for each in used])
    normal = np.array([each.normal for each in used])
    off = 1e3 * (distance - true)
    turned = direction_deg(force) - direction_deg(pushed)
    with np.errstate(invalid="ignore"):
        along = np.einsum("rdi,rdi->rd", force, normal) / np.linalg.norm(force, axis=-1)
        lean = np.degrees(np.arccos(np.clip(along, -1.0, 1.0)))
    for place in range(len(DISTANCES_M)):
        said = np.isfinite(off[:, place])
        missed, stated = off[said, place], 1e3 * std[said, place]
        yield SensingRow(
            *(method, sigma_px, normal_deg),
            float(1e3 * true[:, place].mean()),
            float(direction_deg(pushed[:, place]).mean()),
            len(said),
            float(said.mean()),
            *spread(1e3 * distance[said, place], missed),
            (rms_known(stated)),
            covered(missed, stated),
            *spread(direction_deg(force[said, place]), turned[said, place]),
            (rms_known(lean[said, place])),
        )


# --- Fig. 5

NORMAL_DEG, DISTANCE_M, _EDGE_RADIUS_M = 20.0, 0.15, 1e-3
_PRESSED_RAD, _DRAGGED_RAD = np.radians(4.0), np.radians(4.0)
APPROACH, LEG = 24, 16
"""Frames of the press, and of each of the two legs."""


def joints() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pan and tilt (B,), and the part (B,) of each frame: 0 press, 1 there, 2 back."""
    press = np.linspace(-0.15, 1.0, APPROACH) * _PRESSED_RAD
    there = np.linspace(-1.0, 1.0, LEG) * _DRAGGED_RAD
    along = np.concatenate([np.full(APPROACH, there[0]), there, there[::-1][1:]])
    against = np.concatenate([press, np.full(2 * LEG - 1, _PRESSED_RAD)])
    cos, sin = np.cos(np.radians(NORMAL_DEG)), np.sin(np.radians(NORMAL_DEG))
    part = np.repeat([0, 1, 2], [APPROACH, LEG, LEG - 1])
    return cos * against - sin * along, sin * against + cos * along, part


def dragged(true: Rig, friction: float) -> Touched:
    """The antenna pressed along the edge's normal, then carried along the edge and back."""
    pan, tilt, _ = joints()
    at, radius = free_point(true, DISTANCE_M), 0.5 * true.antenna.diameter_m
    obj = knife_edge(NORMAL_DEG, at, radius, _EDGE_RADIUS_M, friction)
    poses = [true.kinematics.T_world_antenna(float(p), float(t)) for p, t in zip(pan, tilt, strict=True)]
    rotation = np.stack([pose.rotation for pose in poses])
    return touched(true, obj, poses, np.array([pan, tilt]), true.gravity_world_m_s2 @ rotation)


_FRAME_RATE_HZ = 30.0
FELT = "all points, felt"
"""`estimator.object.estimate`: shape, slip, friction and compliance together, of the estimator's contacts."""
FRICTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.6)
_DRAGGED_RIGS = 2
SHOWN = 0.3
"""The μ whose contact points are kept."""


@dataclass(frozen=True)
class FrictionRow:
    """One μ, over the draws: the normal in degrees and μ = tan α, each as mean, scatter and rms error.

    `mu_stated` and `mu_covered` (95 % intervals) of the way that states them.
    """

    method: str = column("method")
    sigma_px: float = column("px", ".1f")
    mu_true: float = column("μ", ".1f")
    draws: int = column()
    answered: float = column("answered %", ".1f", 100)
    normal_true_deg: float = column()
    normal_mean_deg: float = column()
    normal_rms_deg: float = column("normal rms °", ".2f")
    mu_mean: float = column("μ mean", ".4f")
    mu_std: float = column("scatter", ".4f")
    mu_rms: float = column("rms", ".4f")
    mu_stated: float = column("stated", ".4f", default=np.nan)
    mu_covered: float = column("covered %", ".1f", 100, default=np.nan)


@dataclass(frozen=True)
class PathRow:
    """One contact of the path that Fig. 5 draws, across the antenna's axis in the world; the first one is the origin.

    `direction_deg` is ψ of −f from y, as `normal_deg` is ν's; `part` is press, there or back.
    """

    method: str
    mu_true: float
    part: str
    y_mm: float
    z_mm: float
    y_true_mm: float
    z_true_mm: float
    direction_deg: float
    normal_deg: float


Trace = tuple[np.ndarray, np.ndarray]
"""What a way makes of the frames: contacts (B, 3) m and forces (B, 3) N, world, NaN where it says nothing."""


@dataclass(frozen=True)
class Cone:
    """ν in degrees from y, and α in degrees on the way there and back, positive outwards; NaN where undetermined."""

    normal_deg: float
    there_deg: float
    back_deg: float

    @property
    def mu(self) -> float:
        """tan of half the angle between the cone's sides: ν drops out."""
        return float(np.tan(np.radians(0.5 * (self.there_deg + self.back_deg))))


def _in_world(rig: Rig, frames: Touched, answer: Answer) -> Trace:
    """By the paper's equations 19 to 22 with the mended rotation."""
    distance, _, force = answer
    point = contact_position(distance, force[:, 1], force[:, 2], rig.antenna.stiffness_Nm2)
    force = np.where(np.arange(3) == 0, 0.0, force)
    return np.einsum("bij,bj->bi", frames.rotation, point), np.einsum("bij,bj->bi", frames.rotation, force)


def cone(trace: Trace) -> Cone:
    """ν across the line through all contacts, ψ over the later half of each leg."""
    (point, force), part = trace, joints()[2]
    known, psi = np.isfinite(point).all(axis=1), direction_deg(force)
    line = point[known & (part > 0), 1:]
    place = [np.cumsum(part == leg) for leg in (1, 2)]
    legs = [known & (part == leg) & (at > 0.5 * at[-1]) for leg, at in zip((1, 2), place, strict=True)]
    if len(line) < 3 or not all(leg.any() for leg in legs):
        return Cone(np.nan, np.nan, np.nan)
    along = np.linalg.svd(line - line.mean(axis=0))[2][0]
    normal = float(np.degrees(np.arctan2(along[0], -along[1])))
    normal = (normal + 90.0) % 180.0 - 90.0
    # against the motion: going there, to +z of the edge, the force leans back towards −z, −f towards +z
    there, back = (float(np.median(psi[leg])) for leg in legs)
    return Cone(normal, there - normal, normal - back)


def dragging(draws: int, seed: int, frictions: Sequence[float] = FRICTIONS) -> tuple[list[FrictionRow], list[PathRow]]:
    """All coefficients, noises and ways; the path of the first draw at `SHOWN`."""
    rig, rng = paper_rig(), np.random.default_rng(seed)
    trues = [drawn_truth(rig, rng) for _ in range(min(_DRAGGED_RIGS, draws))]
    rows: list[FrictionRow] = []
    shown: list[PathRow] = []
    for friction in frictions:
        frames = [dragged(true, friction) for true in trues]
        for sigma_px in SIGMAS_PX:
            cones: dict[str, list[Cone]] = {TWO_POINTS: [], ALL_POINTS: []}
            estimates = []
            for draw in range(draws):
                used = frames[draw % len(frames)]
                drawn, free = used.noisy(rig, sigma_px, rng)
                joint = used.pan_rad, used.tilt_rad
                found = ContactEstimator(rig).estimate_batch(
                    drawn.points_px, drawn.moment_Nm[:, 1], *joint, sigma_px=sigma_px
                )
                at_s = np.arange(len(found)) / _FRAME_RATE_HZ
                contacts = contact_table(found, *joint, np.full(len(found), np.nan), at_s)
                estimates.append(estimate_object(contacts, rig, FRICTION_RAD))
                traces = {
                    TWO_POINTS: _in_world(rig, used, by_two_points(rig, drawn, free, sigma_px)),
                    ALL_POINTS: (found.point_world_m, found.force_world_N),
                }
                for method, trace in traces.items():
                    cones[method].append(cone(trace))
                    if friction == SHOWN and sigma_px == SIGMAS_PX[0] and draw == 0:
                        shown += _path_rows(method, friction, used, trace)
            for method, several in cones.items():
                normal, mu = np.array([[each.normal_deg, each.mu] for each in several]).T
                rows.append(_friction_row(method, sigma_px, friction, normal, mu))
            rows.append(_object_row(sigma_px, friction, estimates))
    return rows, shown


def _friction_row(method: str, sigma_px: float, friction: float, normal_deg: np.ndarray, mu: np.ndarray) -> FrictionRow:
    said = np.isfinite(mu)
    normal, _, normal_rms = spread(normal_deg[said], normal_deg[said] - NORMAL_DEG)
    found = spread(mu[said], mu[said] - friction)
    return FrictionRow(method, sigma_px, friction, len(mu), float(said.mean()), NORMAL_DEG, normal, normal_rms, *found)


def _object_row(sigma_px: float, friction: float, found: Sequence[ObjectEstimate]) -> FrictionRow:
    """With the median normal of each recording, turned into the world's yz plane."""
    mu, std = np.array([[each.friction.mu, each.friction.std] for each in found]).T
    interval = np.array([each.friction.interval for each in found])
    normal = np.array([np.median(direction_deg(each.normals.normal)) for each in found])
    said = np.isfinite(mu)
    inside = (interval[said, 0] <= friction) & (friction <= interval[said, 1])
    row = _friction_row(FELT, sigma_px, friction, normal, mu)
    return replace(row, mu_stated=(rms_known(std[said])), mu_covered=mean(inside))


def _path_rows(method: str, friction: float, frames: Touched, trace: Trace) -> list[PathRow]:
    (point, force), part, normal = trace, joints()[2], cone(trace).normal_deg
    first = np.nanmean(point[:, 1:] - frames.point_m[:, 1:], axis=0) + frames.point_m[APPROACH, 1:]
    seen = 1e3 * (point[:, 1:] - first)
    true = 1e3 * (frames.point_m[:, 1:] - frames.point_m[APPROACH, 1:])
    numbers = np.column_stack([seen, true, direction_deg(force), np.full(len(part), normal)])
    return [
        PathRow(method, friction, ("press", "there", "back")[leg], *row.tolist())
        for leg, row in zip(part, numbers, strict=True)
        if np.isfinite(row[:2]).all()
    ]


# --- figures and tables

_FILLED = {ALL_POINTS: True, TWO_POINTS: False}
"""Whether a method's marks are filled."""
_GOAL_DEG, _GOAL_MU = 2.0, 0.03


def _fig7(rows: Sequence[SensingRow]) -> Figure:
    """(a) estimated over true distance, (b) force direction for three normals, and the errors of both below."""
    drawn, (distance, direction, off_mm, off_deg) = panels(4, 2, (6, 4), sharex=True)
    shown = [row for row in rows if row.sigma_px == SIGMAS_PX[0]]
    for colour, normal in zip(COLOURS, dict.fromkeys(row.normal_deg for row in rows), strict=False):
        for method, filled in _FILLED.items():
            own = [row for row in shown if row.normal_deg == normal and row.method == method]
            at = _column(own, "l_true_mm") + (0.0 if filled else 2.0) + 0.5 * normal / 30.0
            face, name = colour if filled else "none", f"normal {normal:.0f}°, {method}"
            for what, unit, value, off in (("l", "mm", distance, off_mm), ("direction", "deg", direction, off_deg)):
                mean, std = (_column(own, f"{what}_{part}_{unit}") for part in ("mean", "std"))
                style: dict[str, Any] = {"color": colour, "markerfacecolor": face, "markersize": 5, "capsize": 2}
                value.errorbar(at, mean, std, fmt="o", lw=0.8, label=name, **style)
                off.errorbar(at, mean - _column(own, f"{what}_true_{unit}"), std, fmt="o", lw=0.8, **style)
        direction.axhline(normal, color=colour, lw=0.6)
    distance.plot([50, 230], [50, 230], color=INK, lw=0.6)
    off_deg.axhspan(-_GOAL_DEG, _GOAL_DEG, color=SHADE, lw=0, zorder=0)
    off_mm.axhline(0.0, color=INK, lw=0.6)
    label(distance, "(a) distance", y="estimated, mm")
    label(direction, "(b) force direction", y="from y in the yz plane, °")
    label(off_mm, "error of (a): mean and scatter", "true contact distance, mm", "mm")
    label(off_deg, "error of (b); grey: goal of 2°", "true contact distance, mm", "°")
    off_deg.set_ylim(-8, 8)
    drawn.legend(*distance.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return drawn


def _fig5(path: Sequence[PathRow], rows: Sequence[FrictionRow]) -> Figure:
    """Contact points joined with the directions of the force, and μ found over μ given."""
    drawn, (left, right) = panels(2, 2, (6, 5.5))
    _draw_path(left, [row for row in path if row.method == ALL_POINTS])
    for colour, sigma in zip(COLOURS, SIGMAS_PX, strict=False):
        for place, (method, mark) in enumerate({TWO_POINTS: "o", ALL_POINTS: "s", FELT: "D"}.items()):
            own = [row for row in rows if row.method == method and row.sigma_px == sigma]
            true, std = _column(own, "mu_true"), _column(own, "mu_std")
            at = true + 0.012 * place + 0.005 * (sigma > SIGMAS_PX[0])
            face = "none" if method == TWO_POINTS else colour
            style: dict[str, Any] = {"color": colour, "markerfacecolor": face, "markersize": 5, "capsize": 2}
            name = f"{method}, {sigma} px"
            right.errorbar(at, _column(own, "mu_mean") - true, std, fmt=mark, lw=0.8, label=name, **style)
    right.axhspan(-_GOAL_MU, _GOAL_MU, color=SHADE, lw=0, zorder=0)
    label(right, f"error of μ: mean and scatter; grey: goal of {_GOAL_MU}", "true μ", "found − true")
    right.legend(fontsize=8)
    return drawn


def _draw_path(panel: Axes, path: Sequence[PathRow]) -> None:
    """Contacts in the world across the antenna, the force on the object at each, and the cone about the normal."""
    if not path:
        return
    y, z = _column(path, "y_mm"), _column(path, "z_mm")
    psi = np.radians(_column(path, "direction_deg"))
    panel.plot(_column(path, "y_true_mm"), _column(path, "z_true_mm"), color=INK, lw=0.8, label="true contacts")
    for colour, part in zip(COLOURS, ("there", "back", "press"), strict=False):
        own = np.array([row.part == part for row in path])
        panel.plot(y[own], z[own], "o", ms=4, color=colour, label=part)
        ends = np.stack([y + 4.0 * np.cos(psi), z + 4.0 * np.sin(psi)])[:, own]
        panel.plot(np.stack([y[own], ends[0]]), np.stack([z[own], ends[1]]), color=colour, lw=0.8, alpha=0.7)
    middle = float(np.mean([y.min(), y.max()])), float(np.mean([z.min(), z.max()]))
    found, half = path[0].normal_deg, float(np.degrees(np.arctan(SHOWN)))
    for angle, style in ((found, "-"), (NORMAL_DEG + half, "--"), (NORMAL_DEG - half, "--")):
        end = 12.0 * np.cos(np.radians(angle)), 12.0 * np.sin(np.radians(angle))
        panel.plot([middle[0], middle[0] + end[0]], [middle[1], middle[1] + end[1]], style, color="#b91c1c", lw=1.2)
    title = f"μ = {SHOWN}: normal ν = {found:.1f}° from the points (true {NORMAL_DEG:.0f}°); dashed: true cone"
    label(panel, title, "y, mm", "z, mm")
    panel.set_aspect("equal")
    panel.legend(fontsize=8)


def _column(rows: Sequence[Any], name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in rows], float)


_FRICTION = (
    "Fig. 5: dragged to and fro over an edge; normal: from the contact points; μ = tan α: from the directions of f"
)


def _over_draws(name: str, power: int, heading: str, scale: float = 1.0) -> Any:
    """A column: the mean over all answered draws, of rms errors as an rms."""

    def pooled(rows: Draws) -> float:
        counts, values = rows.answered * rows.draws, np.nan_to_num(getattr(rows, name)) ** power
        return float((counts * values).sum() / counts.sum()) ** (1.0 / power) if counts.any() else np.nan

    return column(heading, ".2f", scale, pooled)


@dataclass(frozen=True)
class _Pooled:
    """One method on one edge at one noise, over the distances."""

    method: str = column("method")
    sigma_px: float = column("px", ".1f")
    normal_deg: float = column("normal °", ".0f")
    answered: float = column("answered %", ".2f", 100, lambda rows: float(rows.answered.mean()))
    l_rms_mm: float = _over_draws("l_rms_mm", 2, "l mm")
    l_worst_mm: float = column("worst", ".2f", of=lambda rows: float(np.nan_to_num(rows.l_rms_mm).max()))
    l_stated_mm: float = _over_draws("l_stated_mm", 2, "stated")
    covered: float = _over_draws("covered", 1, "covered %", 100)
    direction_deg: float = _over_draws("direction_rms_deg", 2, "direction °")
    worst_deg: float = column("worst", ".2f", of=lambda rows: float(np.nan_to_num(rows.direction_rms_deg).max()))
    lean_deg: float = _over_draws("lean_rms_deg", 2, "lean °")


_SENSING = (
    "Fig. 7: slippery knife edges; l: rms over all distances and draws, the worst distance, what is stated; direction: "
    "of f in the yz plane from\nthe object's normal, rms and the worst distance; lean: of f in space from the normal"
)


def measure(options: Options) -> Findings:
    """Fig. 7, and Fig. 5 with half as many draws of noise; draws are shared among true rigs."""
    draws, seed = options.draws, options.seed
    touched, (friction, path) = sensing(draws, seed), dragging(max(draws // 2, 1), seed)
    edges = dict.fromkeys((row.method, row.sigma_px, row.normal_deg) for row in touched)
    pooled = [
        row_of(_Pooled, Draws([row for row in touched if (row.method, row.sigma_px, row.normal_deg) == edge]), *edge)
        for edge in edges
    ]
    found: dict[str, Sequence[Any]] = {"sensing": touched, "friction": friction, "path": path}
    # all points at the smaller noise: distance, the force's direction, and μ from it
    distance, direction, mu = (
        rms_known(
            np.array([getattr(r, name) for r in rows if (r.method, r.sigma_px) == (ALL_POINTS, SIGMAS_PX[0])], float)
        )
        for rows, name in ((touched, "l_rms_mm"), (touched, "direction_rms_deg"), (friction, "mu_rms"))
    )
    return Findings(
        f"{table(pooled, _SENSING)}\n\n{table(friction, _FRICTION)}",
        {f"paper_{name}.csv": rows for name, rows in found.items()},
        {"paper_fig7.png": lambda: _fig7(touched), "paper_fig5.png": lambda: _fig5(path, friction)},
        found,
        f"all points, {SIGMAS_PX[0]} px: distance {distance:.1f} mm, direction {direction:.1f}°, μ {mu:.3f} rms",
    )
