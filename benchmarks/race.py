"""Place and force of the same contacts by our estimators, by SciPy, and by what others publish: the neuroscience method
(force from the curvature near the base, place known) and the paper's formulas; then by one camera and by two at right
angles.

Planar contacts bend the antenna across the camera's line of sight; spatial ones in any direction. The frames come from
the closed form, which the estimators do not use, with white noise on every point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.estimator.baselines import one_contact
from benchmarks.estimator.bound import Bound, bound
from benchmarks.estimator.scenes import (
    Scenes,
    centrelines,
    elastica_shapes,
    push_for_slope,
    random_scenes,
    rolled,
    scenes,
    with_second,
)
from benchmarks.estimator.setup import Setup, drawn_truth
from benchmarks.figures import COLOURS, INK, label, legend, panels
from benchmarks.harness import (
    SILENT,
    Findings,
    Options,
    column,
    concatenated,
    covered,
    median,
    processor_seconds,
    rms,
    row_of,
    table,
    timed,
)
from benchmarks.mistakes.rigs import KINDS, before_loads, drawn_world, observed, session_of, stills_of
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.paper.two_point import force_z, two_point_contact
from vbaa_calib.antenna.elastica import _planar_elastica as planar_elastica
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.session_rig import make_rig, solve_antenna
from vbaa_calib.core.console import progress
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Rig
from vbaa_calib.session import DRIFTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOISES_PX = (0.05, 0.5)
_REACH = (0.2, 0.95)
"""Contact distances in lengths."""
_SLOPES_RAD = (0.05, 0.6)
"""Slopes of the antenna at the contact."""
_AT = 0.3
"""Where the neuroscience method takes the curvature, in contact distances: near the base, as Pammer et al.,
J. Neurosci. 33 (2013) 6726, and Birdwell et al., J. Neurophysiol. 98 (2007) 2439, do."""
_SPAN = 0.2
"""How far to both sides the cubic is fitted that the curvature is of, in contact distances."""


_FRICTION_RAD = 0.2
_RIGS, _FEWER = 100, 20
"""True rigs, and by how much fewer contacts there are of each than of a rig that is known exactly: their errors go
together, so that the intervals' share scatters with the number of rigs."""
_GIVE = RIG_PARAMETERS.index("clamp_give_m") - 6
_BOUND_DRAWS = 50
"""Errors of each frame that are drawn from its bound."""


def _of_draws(of: Callable[[np.ndarray], Any], heading: str) -> Any:
    """A column: a statistic of the place's errors that are drawn from the bound."""
    return column(heading, ".3f", of=lambda d: 1e3 * float(of(d.drawn[..., 0])))


@dataclass(frozen=True)
class ContactsRow:
    """Place and force of contacts by one method, beside the Cramér–Rao bound.

    answered : share of the frames with a place or a force. place_median_mm, place_rms_mm : of the distances' errors.
    bound_median_mm, bound_rms_mm : of errors drawn from the bound of the frames with a place, rig and friction with
        their priors. force, force_bound : median of the lateral force's error over the force, and of errors likewise
        drawn. covered, force_covered : shares of the errors of the distance, and of f_y and f_z, within 1.96 of their
        standard deviations. silent : places off by more than 5 of these. ms : processor time a frame. ratio : of it
        to the first method's on the same contacts.
    """

    kind: str = column("contacts")
    noise_px: float = column("px", ".2f")
    method: str = column("method")
    answered: float = column("answered %", ".1f", 100, lambda d: float(d.answered.mean()))
    place_median_mm: float = column("median mm", ".3f", of=lambda d: 1e3 * median(np.abs(d.off)))
    bound_median_mm: float = _of_draws(lambda errors: np.nanmedian(np.abs(errors)), "bound")
    place_rms_mm: float = column("rms mm", ".3f", of=lambda d: 1e3 * rms(d.off))
    bound_rms_mm: float = _of_draws(lambda errors: np.sqrt(np.nanmean(errors**2)), "bound")
    force: float = column("force %", ".2f", 100, lambda d: float(np.nanmedian(d.missed_part)))
    force_bound: float = column("bound", ".2f", 100, lambda d: float(np.nanmedian(d.lateral)))
    covered: float = column("covered %", ".1f", 100, lambda d: covered(d.score))
    force_covered: float = column("force covered %", ".1f", 100, lambda d: covered(d.force_score))
    silent: int = column("silent", "d", of=lambda d: int((d.score > SILENT).sum()))
    ms: float = column("ms", ".3f")
    ratio: float = column("ratio", ".2f")


Answer = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Contact distances (B,) and forces (B, 2) along y and z, each with its standard deviations; NaN where unknown."""


def answer(found: Contacts) -> Answer:
    """Of an estimator."""
    return found.distance_m, found.distance_std_m, found.force_N[:, 1:], found.force_std_N[:, 1:]


def judged(
    names: tuple[str, float, str],
    parts: Sequence[Scenes],
    answers: Sequence[Answer],
    least: Bound,
    ms: float,
    first_ms: float,
) -> ContactsRow:
    """One method's row. names : contacts, noise and method. least : the bound of all frames."""
    distance, std, force, force_std = (np.concatenate(each) for each in zip(*answers, strict=True))
    true = np.concatenate([part.force_N[:, 1:] for part in parts])
    off, missed = distance - np.concatenate([part.distance_m for part in parts]), force - true
    size, placed, forced = np.linalg.norm(true, axis=1), np.isfinite(off), np.isfinite(missed)
    answered, stated, known = placed | forced.all(axis=1), np.isfinite(std) & placed, np.isfinite(force_std) & forced
    drawn = least.drawn(answered, _BOUND_DRAWS)
    found = SimpleNamespace(
        answered=answered,
        off=off[placed],
        drawn=drawn,
        missed_part=np.linalg.norm(missed, axis=1) / size,
        lateral=np.linalg.norm(drawn[..., 1:], axis=-1) / size[answered],
        score=np.abs(off[stated]) / std[stated],
        force_score=np.abs(missed[known] / force_std[known]),
    )
    return row_of(ContactsRow, found, *names, ms=ms, ratio=ms / first_ms)


def at_shares(scenes: Scenes, ends: tuple[float, float]) -> np.ndarray:
    """(B, 2) indices of the points nearest to two places: up to 1 in contact distances, beyond it 1 plus the share of
    the straight part."""
    contact, length = scenes.distance_m[:, None], scenes.rig.antenna.length_m
    share = np.array(ends)
    wanted = np.where(share <= 1.0, share * contact, contact + (share - 1.0) * (length - contact))
    return np.round(np.interp(wanted, scenes.arclength_m, np.arange(len(scenes.arclength_m)))).astype(int)


def ours(frames: Scenes, moment: bool = True) -> Answer:
    """By `ContactEstimator.estimate_batch`, with the moment's reading or without."""
    read = frames.moment_Nm if moment else np.full(len(frames), np.nan)
    return answer(frames.estimated(moment_Nm=read))


def _unstated(distance_m: np.ndarray, force_N: np.ndarray) -> Answer:
    """Of a method that does not say how well it knows."""
    return distance_m, np.full(len(distance_m), np.nan), force_N, np.full_like(force_N, np.nan)


def scipy_loop(frames: Scenes) -> Answer:
    """By SciPy's least squares over distance and force, frame by frame."""
    return _bent_forces(frames, np.array([one_contact(frames, index) for index in range(len(frames))]))


def _bent_forces(frames: Scenes, found: np.ndarray) -> Answer:
    """Of distances and forces (B, 3), these on the straight antenna."""
    distance, *push = found.T
    force = np.full((2, len(frames)), np.nan)
    good = np.isfinite(distance) & (distance > 0.0)
    if good.any():  # the force stands on the bent antenna: across the straight one it is smaller
        shape = planar_elastica(
            distance[good, None], distance[good], np.hypot(*push)[good], frames.rig.antenna.stiffness_Nm2, 0.0
        )
        force[:, good] = np.cos(shape.theta_rad[:, 0]) * np.array(push)[:, good]
    return _unstated(distance, force.T)


def two_points(frames: Scenes) -> Answer:
    """By the paper's formulas, from a point on the curved part and one on the straight part, named by the truth."""
    pixels = np.take_along_axis(frames.points_px, at_shares(frames, (0.6, 2.0))[..., None], axis=1)
    x, y = np.moveaxis(frames.rig.camera_on_plane().project(pixels)[0], -1, 0)
    antenna = frames.rig.antenna
    found = two_point_contact(x, y, antenna.stiffness_Nm2, antenna.length_m)
    force = np.column_stack([found.force_y_N, force_z(frames.moment_Nm, found.contact_m)])
    return _unstated(np.asarray(found.contact_m), force)


def from_curvature(frames: Scenes) -> Answer:
    """By κ·EI near the base over the lever of the force, which acts along the antenna's normal at the known place."""
    xy = frames.rig.camera_on_plane().project(frames.points_px)[0]
    force = np.full((len(frames), 2), np.nan)
    for index, (line, contact) in enumerate(zip(xy, frames.distance_m, strict=True)):
        share = frames.arclength_m / contact
        x, y = line[np.abs(share - _AT) < _SPAN].T
        along = np.polynomial.Polynomial.fit(x, y, 3)
        at = float(line[np.argmin(np.abs(share - _AT)), 0])
        slope = along.deriv()(at)
        moment = frames.rig.antenna.stiffness_Nm2 * along.deriv(2)(at) / (1.0 + slope**2) ** 1.5
        end = line[np.abs(share - 1.0) < 0.1]
        tangent = np.linalg.svd(end - end.mean(axis=0))[2][0]
        normal = np.array([-tangent[1], tangent[0]]) * np.sign(tangent[0])
        lever = end.mean(axis=0) - [at, float(along(at))]
        force[index] = moment / (lever[0] * normal[1] - lever[1] * normal[0]) * normal[1], 0.0
    return _unstated(np.full(len(frames), np.nan), force)


METHODS: dict[str, Callable[[Scenes], Answer]] = {
    "ours": ours,
    "ours, no moment": lambda frames: ours(frames, moment=False),
    "SciPy least squares": scipy_loop,
    "curvature near the base, place known": from_curvature,
    "the paper's two points": two_points,
}


def contacts(kind: str, count: int, noise_px: float, rng: np.random.Generator) -> Scenes:
    """Noisy frames of planar or spatial contacts."""
    rig = Setup("brown", swing_m=0.1).rig()
    distance = rig.antenna.length_m * rng.uniform(*_REACH, count)
    size = push_for_slope(rng.uniform(*_SLOPES_RAD, count), distance, rig.antenna.stiffness_Nm2)
    roll = np.where(rng.random(count) < 0.5, 0.0, np.pi) if kind == "planar" else rng.uniform(-np.pi, np.pi, count)
    return scenes(rig, distance, rolled(size, roll), made_by=elastica_shapes, sigma_px=noise_px).noisy(rng)


def _rows(kind: str, noise_px: float, frames: Scenes) -> list[ContactsRow]:
    rows: list[ContactsRow] = []
    least = bound(frames)
    for name, method in METHODS.items():
        method(frames.picked(np.arange(min(2, len(frames)))))  # what is made ready once
        found, seconds = timed(lambda: method(frames))  # noqa: B023
        ms = 1e3 * seconds / len(frames)
        rows.append(judged((kind, noise_px, name), [frames], [found], least, ms, rows[0].ms if rows else ms))
    return rows


def calibrated_pair(seed: int) -> Rig:
    """A rig with two cameras at right angles, `left` and `right`, as one calibration of both knows it: a board by hand
    and in a jig before each, the free antenna and loads. Nothing drifts."""
    kind, rng = replace(KINDS[0], incline_rad=0.0), np.random.default_rng((51, seed))
    world = drawn_world(kind, rng)
    rigid = np.where(np.arange(9) == _GIVE, 0.0, 1.0)  # as are the clamps of `random_scenes`
    world = replace(world, parameters=rigid * world.parameters)
    turn = Pose.from_rotvec(np.array([np.pi / 2, 0.0, 0.0]), np.zeros(3))
    worlds = {"left": world, "right": replace(world, T_antenna_camera=turn @ world.T_antenna_camera)}
    session, stills, alone = session_of(kind), stills_of(kind), {}
    # both see the same loads, whose errors they share
    seeds = int(rng.integers(1 << 31))
    for name, one in worlds.items():
        before, noise = before_loads(one, rng), np.random.default_rng(seeds)
        alone[name] = solve_antenna(session, observed([one] * len(stills), stills, noise), before)
    solved = BundleAdjustment.together(alone)
    rigs = {}
    for name, camera in solved.items():
        rig = make_rig(session, Kinematics(), camera, alone[name].noted)
        antenna = replace(rig.antenna, parameters=rigid * rig.antenna.parameters)
        # nothing changes between calibration and frames
        rigs[name] = replace(rig, antenna=antenna, drift=DRIFTS["none"], camera_name=name)
    return replace(rigs["left"], others={"right": rigs["right"]})


def by_cameras(count: int, seed: int) -> list[ContactsRow]:
    """Rows of a rig that is known exactly, and of rigs as a calibration knows them."""
    rows = []
    exact_rig = with_second(Setup(exact=True).rig())
    for name, rig in (("exact", exact_rig), ("calibrated", calibrated_pair(seed))):
        for sigma_px in NOISES_PX:
            rng = np.random.default_rng((seed, int(1e3 * sigma_px), name == "exact"))
            truths = [rig] if name == "exact" else [drawn_truth(rig, rng) for _ in range(_RIGS)]
            own = count if name == "exact" else max(count // _FEWER, 2)
            parts = [_recorded(true, own, sigma_px, rng) for true in truths]
            rows += _camera_rows(name, rig, parts)
    return rows


def _recorded(true: Rig, count: int, sigma_px: float, rng: np.random.Generator) -> tuple[Scenes, dict[str, np.ndarray]]:
    frames = replace(random_scenes(true, count, rng, friction_std_rad=_FRICTION_RAD), sigma_px=sigma_px)
    read = frames.moment_Nm + rng.normal(0.0, true.moment_sensor.std_Nm, count)
    return replace(frames, moment_Nm=read), centrelines(true, frames, rng)


def _camera_rows(name: str, rig: Rig, parts: Sequence[tuple[Scenes, dict[str, np.ndarray]]]) -> list[ContactsRow]:
    rows: list[ContactsRow] = []
    for cameras in (["left"], ["right"], ["left", "right"]):
        estimator = ContactEstimator(
            rig if len(cameras) > 1 else rig.cameras[cameras[0]], friction=_FRICTION_RAD, jobs=1
        )
        found, seconds, least = [], 0.0, []
        for frames, lines in parts:
            given = {one: lines[one] for one in cameras}
            found.append(answer(estimated(estimator, frames, given)))
            seconds += processor_seconds(lambda: estimated(estimator, frames, given), 3)  # noqa: B023
            true = frames.rig if len(cameras) > 1 else frames.rig.cameras[cameras[0]]
            least.append(bound(replace(frames, rig=true, points_px=lines[cameras[0]]), _FRICTION_RAD))
        every = [frames for frames, _ in parts]
        ms = 1e3 * seconds / sum(map(len, every))
        names = (name, every[0].sigma_px, " and ".join(cameras))
        rows.append(judged(names, every, found, concatenated(least), ms, rows[0].ms if rows else ms))
    return rows


def estimated(estimator: ContactEstimator, frames: Scenes, lines: Mapping[str, np.ndarray]) -> Contacts:
    """The frames by the cameras whose lines are given."""
    several = lines if estimator.rig.others else next(iter(lines.values()))
    read = (frames.moment_Nm, frames.pan_rad, frames.tilt_rad)
    return estimator.estimate_batch(several, *read, sigma_px=frames.sigma_px)


def cameras_text(rows: Sequence[ContactsRow]) -> str:
    """The table."""
    return table(rows, "one camera and two at right angles: every direction of touch, friction of ± 0.2 rad", once=2)


_MARKS = dict(
    zip(
        ("ours", "ours, no moment", "SciPy", "the paper"),
        zip(COLOURS, "osDv", strict=False),
        strict=True,
    )
)
"""First words of a method → its colour and mark."""


def figure(rows: Sequence[ContactsRow]) -> Figure:
    """Time per frame over the median error of the place, with its bound, for the contacts of each kind."""
    kinds = list(dict.fromkeys((row.kind, row.noise_px) for row in rows))
    drawn, every = panels(len(kinds), 2, (5.0, 3.4), sharex=True, sharey=True)
    for kind, panel in zip(kinds, every, strict=True):
        for row in rows:
            mark = next((own for name, own in reversed(_MARKS.items()) if row.method.startswith(name)), None)
            if (row.kind, row.noise_px) == kind and mark and np.isfinite(row.place_median_mm):
                panel.loglog(row.place_median_mm, row.ms, mark[1], color=mark[0])
                if row.method == "ours":
                    panel.axvline(row.bound_median_mm, color=INK, ls=":")
        label(panel, f"{kind[0]}, points off by {kind[1]:g} px", "median error of the place, mm", "ms a frame")
    legend(drawn, _MARKS, title="dotted: the Cramér–Rao bound")
    return drawn


def measure(options: Options) -> Findings:
    """All methods on every kind of contacts."""
    rows: list[ContactsRow] = []
    cases = [(kind, noise) for noise in NOISES_PX for kind in ("planar", "spatial")]
    for number, (kind, noise) in enumerate(progress(cases, "contacts", len(cases))):
        frames = contacts(kind, options.draws, noise, np.random.default_rng((options.seed, number)))
        rows += _rows(kind, noise, frames)
    best = next(row for row in rows if row.method == "ours" and row.kind == "spatial")
    scipy = next(row for row in rows if row.method == "SciPy least squares" and row.kind == "spatial")
    headline = f"spatial, 0.05 px: {best.place_median_mm:.2f} mm median; {scipy.ms / best.ms:.0f} times SciPy's speed"
    several = by_cameras(options.draws, options.seed)
    text = f"{table(rows, 'contacts by every method', once=2)}\n\n{cameras_text(several)}"
    return Findings(
        text, {"race.csv": rows, "race_cameras.csv": several}, {"race.png": lambda: figure(rows)}, {}, headline
    )
