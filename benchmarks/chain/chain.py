"""`vbaa bench chain`: pictures to contacts, speed against error, every method on the same pictures.

One limit is the Cramér–Rao bound of the whole chain, the other the time to read a picture once from memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from benchmarks.chain.scenes import CAMERA_TILT_RAD, FRICTION_STD_RAD, JOINTS_RAD, Photograph
from benchmarks.estimator.baselines import FIRST_GUESS, one_contact
from benchmarks.figures import AMBER, BLUE, GREEN, GREY, INK, SHADE, VIOLET, label, label_x, legend, name_points, panels
from benchmarks.harness import Findings, Options, column, one_thread, processor_seconds, rms_known, table
from benchmarks.vision.judge import peers
from estimator import ContactEstimator
from estimator.contact.recording import detect_again, first_look, measured
from estimator.paper.inclined import inclined_two_point_contact
from estimator.paper.two_point import force_z, straight_line_contact, two_point_contact
from estimator.table.contacts import Measured
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.camera import Camera
from vbaa_calib.core.console import progress
from vbaa_calib.detect.whisker.antenna import corridor, free_curve, pixels
from vbaa_calib.detect.whisker.centreline import NOTHING
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

from .scenes import RIGS, SIZES, Cell, cell, contact_bound, frames_at_information, information_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vbaa_calib.camera import CameraOnPlane

# --- ways from pictures in memory to contacts

MODELS = (*RUNGS, "auto")
OURS, ONE_LOOK = "this library", "this library, one look"
PAPER, LINE = "the paper's two points", "straight line"
LOOP, CLASSIC = "SciPy on our centreline", "undistorted picture"


@dataclass(frozen=True, eq=False)
class Answers:
    """Of K pictures; NaN where a method gives no number, or states no deviation.

    distance_m, std_m : (K,) of the contact, and the deviation that the method states.
    force_N : (K, 2) f_y and f_z.
    """

    distance_m: np.ndarray
    std_m: np.ndarray
    force_N: np.ndarray


@dataclass(frozen=True, eq=False)
class Method:
    """A way from pictures to contacts, made ready for one rig: what can be worked out once is worked out.

    solve : pictures to answers; one picture is a frame that comes alone, several are a recording.
    told : the truth decides which points it takes, as no user can.
    """

    name: str
    family: str
    solve: Callable[[Sequence[Photograph]], Answers]
    told: bool = False


def ours(rig: Rig) -> list[Method]:
    """Every rung after two looks at the picture, and `auto` after one."""
    ready = {model: ContactEstimator(rig, model=model, friction=FRICTION_STD_RAD) for model in MODELS}
    methods = [Method(model, OURS, partial(_contacts, ready[model], True)) for model in MODELS]
    return [*methods, Method("auto, one look", ONE_LOOK, partial(_contacts, ready["auto"], False))]


def frame_of(photograph: Photograph) -> Frame:
    """What is read beside the picture."""
    pan, tilt = JOINTS_RAD
    return Frame(None, pan, tilt, photograph.moment_Nm, frame=0, time_s=float("nan"))


def seen(estimator: ContactEstimator, photographs: Sequence[Photograph], twice: bool = True) -> Iterator[Measured]:
    """What the fit is given of pictures, by the steps that a recording's pictures go through."""
    glances = (first_look(estimator, frame_of(one), one.image) for one in photographs)
    if twice:
        return (each.measured for each in detect_again(estimator, list(glances)))
    return (measured(estimator.rig, each.frame, each.line if each.line.found else NOTHING) for each in glances)


def _contacts(estimator: ContactEstimator, twice: bool, photographs: Sequence[Photograph]) -> Answers:
    offered = seen(estimator, photographs, twice)
    alone = len(photographs) == 1
    found = [estimator.measure(one) for one in offered] if alone else list(estimator.run(offered))
    columns = zip(*((one.distance_m, one.distance_std_m, one.force_N[1:]) for one in found), strict=True)
    return Answers(*map(np.array, columns))


_SHARES, _STRAIGHT = (0.5, 0.95), (0.1, 0.95)
"""Where the two points are taken, in lengths of the antenna; or in lengths of the part that is known to be straight."""
_FEWEST = 12
"""Points that a loop is started with."""
_EVENED_PX = 31
_TOOLS = {"cv2.ximgproc.thinning": ("skeleton", 0.29), "centroid per column": ("centroids", 0.1)}
"""Which of `vision.judge.peers` → for people, and the standard deviation that the loop is told, px: whole pixels, and
what they do on good pictures."""

Look = Callable[[Photograph], np.ndarray]
"""A picture to points (N, 2) on the centreline, px."""
Formula = Callable[[Rig, np.ndarray, np.ndarray, np.ndarray], Answers]
"""Points x, y (K, 2) on plane C without the free antenna's shape, moments (K,) of the touch alone → answers."""


@dataclass(frozen=True, eq=False)
class _Free:
    """The free antenna, known before any picture, for the joint angles of the benchmark's pictures.

    points_m : (G, 2) as seen on plane C, x ascending. moment_Nm : its weight's moment.
    """

    rig: Rig
    layer: CameraOnPlane
    points_m: np.ndarray
    moment_Nm: float

    @staticmethod
    def of(rig: Rig) -> _Free:
        layer, free = rig.camera_on_plane(), _free_curves(rig)
        at = pixels(rig.camera, rig.T_antenna_camera.inverse(), free.points_m[0])
        return _Free(rig, layer, layer.project(at)[0], float(free.moment_Nm[0]))

    def moment_of_touch(self, photographs: Sequence[Photograph]) -> np.ndarray:
        """(K,) of the touch alone, by the reading."""
        sensor = self.rig.moment_sensor
        reading = np.array([one.moment_Nm for one in photographs])
        return (reading - sensor.offset_Nm) / sensor.gain - self.moment_Nm

    def deflection(self, points_px: np.ndarray) -> np.ndarray:
        """(N, 2) points on plane C, m, in order of x, less the free antenna's y."""
        points = self.layer.project(points_px)[0]
        points = points[np.isfinite(points).all(axis=1)]
        points = points[np.argsort(points[:, 0])]
        points[:, 1] -= np.interp(points[:, 0], *self.points_m.T)
        return points


def _free_curves(rig: Rig) -> Curves:
    gravity = rig.kinematics.T_world_antenna(*JOINTS_RAD).rotation.T @ rig.gravity_world_m_s2
    return free_curve(rig.antenna.parameters, rig.antenna.length_m, gravity)


def _undistorter(camera: Camera) -> tuple[Camera, Callable[[np.ndarray], np.ndarray]]:
    """Whole pictures taken through the lens's inverse by OpenCV, same size, all that the lens shows still in it.

    The light is evened out by a wide box: without it a threshold finds the bright side of the picture.
    """
    size = camera.image_size
    matrix, _ = cv2.getOptimalNewCameraMatrix(camera.matrix, camera.distortion, size, 1.0)
    maps = cv2.initUndistortRectifyMap(camera.matrix, camera.distortion, np.eye(3), matrix, size, cv2.CV_16SC2)

    def undistort(image: np.ndarray) -> np.ndarray:
        flat = cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return cv2.subtract(flat, cv2.blur(flat, (_EVENED_PX, _EVENED_PX)))

    return Camera("opencv", size, matrix, np.zeros(0)), undistort


def others(rig: Rig) -> list[Method]:
    """Everything beside this library's own rungs."""
    estimator, free = ContactEstimator(rig), _Free.of(rig)

    def ours(photograph: Photograph) -> np.ndarray:
        return next(seen(estimator, [photograph])).points_px

    def points(name: str, formula: Formula, told: bool = False) -> Method:
        return Method(name, PAPER, partial(_formula, free, ours, formula, told), told)

    return [
        points("two points, camera A", _upright),
        points("two points, camera B", _inclined),
        points("two points on the straight part", _inclined, told=True),
        Method("straight line", LINE, partial(_straight_line, free, ours)),
        Method("elastica by least_squares", LOOP, partial(_scipy, rig, ours, rig.image.noise_px)),
        *_toolbox(rig, free),
    ]


def _toolbox(rig: Rig, free: _Free) -> list[Method]:
    """Both fits to what each tool finds in the undistorted picture, within the same corridor as this library's."""
    camera, flat = _undistorter(rig.camera)
    flat_rig = replace(rig, camera=camera)
    flat_free = replace(free, layer=flat_rig.camera_on_plane())
    to_camera = flat_rig.T_antenna_camera.inverse()
    where = corridor(camera, to_camera, _free_curves(flat_rig), rig.antenna.diameter_m)
    tools = peers(where, camera.image_size)
    methods = []
    for tool, (title, sigma_px) in _TOOLS.items():
        look = partial(lambda peer, photograph: peer(flat(photograph.image)), tools[tool])
        two_points = partial(_formula, flat_free, look, _inclined, False)
        methods += [
            Method(f"{title}, two points", CLASSIC, two_points),
            Method(f"{title}, least_squares", CLASSIC, partial(_scipy, flat_rig, look, sigma_px)),
        ]
    return methods


def _formula(free: _Free, look: Look, formula: Formula, told: bool, photographs: Sequence[Photograph]) -> Answers:
    """Two points of every picture, nearest to the wanted x or NaN, then all pictures at once."""
    length, picked = free.rig.antenna.length_m, np.full((len(photographs), 2, 2), np.nan)
    for own, one in zip(picked, photographs, strict=True):
        begin, points = one.distance_m if told else 0.0, free.deflection(look(one))
        wanted = begin + np.array(_STRAIGHT if told else _SHARES) * (length - begin)
        if len(points) >= 2:
            own[:] = points[np.abs(points[:, :1] - wanted).argmin(axis=0)]
    x, y = np.moveaxis(picked, -1, 0)
    return formula(free.rig, x, y, free.moment_of_touch(photographs))


def _upright(rig: Rig, x: np.ndarray, y: np.ndarray, moment_Nm: np.ndarray) -> Answers:
    """The paper's camera A: one that looks straight down on plane C."""
    found = two_point_contact(x, y, rig.antenna.stiffness_Nm2, rig.antenna.length_m)
    return _answers(found.contact_m, found.force_y_N, force_z(moment_Nm, found.contact_m))


def _inclined(rig: Rig, x: np.ndarray, y: np.ndarray, moment_Nm: np.ndarray) -> Answers:
    """The paper's camera B, solved exactly: inclined as this camera is, but seen from far away."""
    antenna = rig.antenna
    found = inclined_two_point_contact(x, y, moment_Nm, antenna.stiffness_Nm2, CAMERA_TILT_RAD, antenna.length_m)
    return _answers(found.contact_m, found.force_y_N, found.force_z_N)


def _straight_line(free: _Free, look: Look, photographs: Sequence[Photograph]) -> Answers:
    """A line through the straight part of each."""
    antenna, moments = free.rig.antenna, free.moment_of_touch(photographs)
    x_y = (free.deflection(look(one)).T for one in photographs)
    guess_m = FIRST_GUESS * antenna.length_m
    rows = [straight_line_contact(x, y, guess_m, antenna.stiffness_Nm2) for x, y in x_y]
    contact, along_y = np.array(rows, float).T
    # a line that crosses the antenna beyond its tip tells of no contact
    there = contact <= antenna.length_m
    force = along_y, np.asarray(force_z(moments, contact), float)
    return _answers(*(np.where(there, values, np.nan) for values in (contact, *force)))


def _scipy(rig: Rig, look: Look, sigma_px: float, photographs: Sequence[Photograph]) -> Answers:
    """One `least_squares` after the other."""
    found = np.full((len(photographs), 3), np.nan)
    for index, one in enumerate(photographs):
        points, moment = look(one), np.array([one.moment_Nm])
        if len(points) >= _FEWEST:
            frame = replace(one.truth, rig=rig, points_px=points[None], sigma_px=sigma_px, moment_Nm=moment)
            found[index] = one_contact(frame, 0)
    inside = (found[:, 0] > 0.0) & (found[:, 0] <= rig.antenna.length_m)
    return _answers(*np.where(inside[:, None], found, np.nan).T)


def _answers(distance_m: Any, force_y_N: Any, force_z_N: Any) -> Answers:
    distance = np.asarray(distance_m, float)
    return Answers(distance, np.full(len(distance), np.nan), np.stack([force_y_N, force_z_N], axis=-1))


# --- errors of answers, and the time that reading a picture takes

ASTRAY_BOUND, ASTRAY_STATED = 5.0, 4.0
"""A number is wrong and confident when it is off by more than both: the bound's standard deviations, and its own."""


def verdict(found: Answers, photographs: Sequence[Photograph], bound_m: np.ndarray) -> dict[str, Any]:
    """The columns of `chain.ChainRow` that judge K answers, with the bound's standard deviations (K,) m."""
    error = found.distance_m - np.array([one.distance_m for one in photographs])
    force = np.array([one.force_N[1:] for one in photographs])
    off = np.linalg.norm(found.force_N - force, axis=1) / np.linalg.norm(force, axis=1)
    turned = (found.force_N * force[:, ::-1] * [-1.0, 1.0]).sum(axis=1), (found.force_N * force).sum(axis=1)
    astray = np.abs(error) > np.maximum(ASTRAY_BOUND * bound_m, ASTRAY_STATED * np.nan_to_num(found.std_m))
    known = np.isfinite(error)
    scaled, plain = rms_known(error / bound_m), rms_known(1e3 * error)
    weight = bound_m[known] ** 2
    return {
        "l_rms_mm": plain,
        # a few pictures with wide bounds make most of it
        "l_rms_error_mm": plain * float(np.linalg.norm(weight) / weight.sum() / np.sqrt(2.0))
        if known.any()
        else np.nan,
        "l_median_mm": float(np.median(1e3 * np.abs(error[known]))) if known.any() else np.nan,
        "of_bound": scaled,
        "of_bound_error": scaled / float(np.sqrt(2.0 * max(known.sum(), 1))),
        "force_percent": rms_known(1e2 * off),
        "direction_deg": rms_known(np.degrees(np.arctan2(*turned))),
        "answered": float(known.mean()),
        "wrong": float((known & astray).mean()),
    }


_BEYOND_CACHE_BYTES = 256 * 2**20
"""So much is read in turn that nothing of it is still in a processor's cache when its turn comes again."""


def reading_seconds(size: tuple[int, int], repeats: int) -> float:
    """Reading every byte of an 8-bit picture of (width, height) once out of memory.

    By summing eight bytes at a time, or by a copy, the faster way.
    """
    words = size[0] * size[1] // 8
    store = np.ones((max(_BEYOND_CACHE_BYTES // (8 * words), 1), words), np.uint64)
    once = np.empty(words, np.uint64)

    def copied() -> None:
        for picture in store:
            np.copyto(once, picture)

    ways = (lambda: [picture.sum() for picture in store], copied)
    return min(processor_seconds(way, repeats) for way in ways) / len(store)


# --- every method on the same pictures

_LONG_S = 2.0
"""A recording that takes longer is timed once."""


@dataclass(frozen=True)
class ChainRow:
    """One method on the pictures of one size and rig.

    told : the truth decides which points it takes.
    ms, ms_recording : of one thread for one picture that comes alone, and for each of a recording.
    l_rms_mm, l_median_mm : error of the contact distance, of the pictures with a number; NaN without any.
    l_rms_error_mm : what the rms scatters by from chance, were every error as its picture's bound has it.
    of_bound, of_bound_error : rms error in the bound's standard deviations, and what it scatters by from chance.
    force_percent, direction_deg : rms error of (f_y, f_z) over its size, and of its direction.
    answered, wrong : share with a number; share of all with one that is wrong and confident.
    bound_mm : rms of the bound's standard deviations of the same pictures' distances.
    read_ms : reading a picture of this size once from memory.
    """

    size: str
    rig: str
    method: str = column("method")
    family: str = column("family")
    told: bool = column()
    pictures: int = column()
    ms: float = column("ms", ".1f")
    ms_recording: float = column("recording", ".1f")
    l_rms_mm: float = column("l rms mm", ".2f")
    l_rms_error_mm: float = column()
    l_median_mm: float = column("median", ".2f")
    of_bound: float = column("× bound", ".2f")
    of_bound_error: float = column("±", ".2f")
    force_percent: float = column("force %", ".2f")
    direction_deg: float = column("°", ".2f")
    answered: float = column("answered %", ".0f", 100)
    wrong: float = column("wrong %", ".0f", 100)
    bound_mm: float = column()
    read_ms: float = column()


def run(pictures: int, seed: int, quick: bool = False, sizes: Sequence[tuple[int, int]] = SIZES) -> list[ChainRow]:
    """So many pictures of each size and rig. `quick` : times from fewer of them."""
    timed, repeats = (1, 1) if quick else (4, 3)
    rows: list[ChainRow] = []
    with one_thread():
        for size in sizes:
            read_s = reading_seconds(size, repeats)
            for known in RIGS:
                pages = cell(size, known, pictures, seed)
                bound_m, methods = bounds(pages), [*ours(pages.rig), *others(pages.rig)]
                for method in progress(methods, f"{pages.name}, {known} rig", len(methods)):
                    rows.append(_row(pages, method, bound_m, read_s, timed, repeats))
    return rows


def bounds(pages: Cell) -> np.ndarray:
    """(K,) least standard deviations of the pictures' contact distances, m, with the rig as well known as it is."""
    truths = [replace(one.truth, rig=pages.rig) for one in pages.photographs]
    return contact_bound(frames_at_information(truths, [information_of(one) for one in pages.photographs])).std[:, 0]


def _row(pages: Cell, method: Method, bound_m: np.ndarray, read_s: float, timed: int, repeats: int) -> ChainRow:
    photographs = pages.photographs
    singles = [partial(method.solve, photographs[index : index + 1]) for index in range(min(timed, len(pages)))]
    alone = float(np.median([processor_seconds(work, repeats) for work in singles]))
    found: list[Answers] = []
    together = processor_seconds(lambda: found.append(method.solve(photographs)), repeats - 1, _LONG_S) / len(pages)
    return ChainRow(
        size=pages.name,
        rig=pages.known,
        method=method.name,
        family=method.family,
        told=method.told,
        pictures=len(pages),
        ms=1e3 * alone,
        ms_recording=1e3 * together,
        **verdict(found[-1], photographs, bound_m),
        bound_mm=1e3 * float(np.sqrt(np.mean(bound_m**2))),
        read_ms=1e3 * read_s,
    )


_NOTES = f"""\
limit of error: the Cramér–Rao bound from the picture's own pixels and the moment's noise, friction and rig free within
  what is known of them; held as known: cross-section, blur and noise of the picture; free in every column: the line's
  height, level and slope of the background
limit of time: every byte of a picture read once from memory
wrong: off by more than {ASTRAY_BOUND:.0f} of the bound's deviations, and by more than {ASTRAY_STATED:.0f} of its
  own where a method states them; two points on the straight part: the truth tells where it is straight
ms: one thread's processor time from the decoded picture to distance and force; what needs no picture is
  prepared before"""


def _as_text(rows: Sequence[ChainRow], row: Any) -> str:
    """The tables for people, below the result in one sentence."""
    lines = [
        f"auto, {row.size}, a calibrated rig: {row.ms:.1f} ms a picture, {row.ms_recording:.1f} ms in a recording; "
        f"{row.l_rms_mm:.2f} mm rms, {row.of_bound:.2f} ± {row.of_bound_error:.2f} times the bound; reading the "
        f"picture once takes {row.read_ms:.3f} ms",
        _NOTES,
    ]
    for (size, rig), group in groupby(rows, key=lambda row: (row.size, row.rig)):
        own = list(group)
        limits = f"{own[0].bound_mm:.3f} mm rms, {own[0].read_ms:.4f} ms"
        lines += ["", table(own, f"{size}, rig {rig}, {own[0].pictures} pictures; the limits: {limits}")]
    return "\n".join(lines)


def _chosen(rows: Sequence[ChainRow]) -> Any:
    """`auto` on the largest pictures of a rig as calibrations leave it."""
    return [row for row in rows if (row.family, row.method, row.rig) == (OURS, "auto", "calibrated")][-1]


_STYLES = {
    OURS: (GREEN, "s"),
    ONE_LOOK: (GREEN, "P"),
    LOOP: (GREY, "D"),
    PAPER: (AMBER, "o"),
    LINE: (VIOLET, "^"),
    CLASSIC: (BLUE, "v"),
}
"""Of each family of methods: its colour and mark."""


def _figure(rows: Sequence[ChainRow]) -> Figure:
    """One panel for each picture size and rig; full marks a picture that comes alone, hollow ones in a recording.

    Left of the bound and below the reading of the picture nothing can be.
    """
    shown = [row for row in rows if np.isfinite(row.l_rms_mm)]
    cells = list(dict.fromkeys((row.size, row.rig) for row in rows))
    drawn, every = panels(len(cells), 2, (6, 4.9), sharex=True, sharey=True)
    for which, panel in zip(cells, every, strict=True):
        own = [row for row in shown if (row.size, row.rig) == which]
        bound_mm, read_ms = own[0].bound_mm, own[0].read_ms
        for span, line, limit in ((panel.axvspan, panel.axvline, bound_mm), (panel.axhspan, panel.axhline, read_ms)):
            span(1e-9, limit, color=SHADE, lw=0)
            line(limit, color=INK, lw=1.2)
        words: dict[str, Any] = {"ha": "right", "fontsize": 8, "color": INK}
        across, along = panel.get_xaxis_transform(), panel.get_yaxis_transform()
        bound = f"Cramér–Rao bound, {bound_mm:.2f} mm "
        panel.text(bound_mm, 0.4, bound, rotation=90, va="center", transform=across, **words)
        read = f"the picture read once from memory, {read_ms:.3f} ms"
        panel.text(0.98, 0.8 * read_ms, read, va="top", transform=along, **words)
        for row in own:
            (colour, mark), error, scatter = _STYLES[row.family], row.l_rms_mm, row.l_rms_error_mm
            panel.loglog([error, error], [row.ms, row.ms_recording], color=colour, lw=0.7)
            panel.loglog([error - scatter, error + scatter], [row.ms, row.ms], color=colour, lw=1.0, alpha=0.5)
            panel.loglog(error, row.ms_recording, mark, color=colour, markerfacecolor="white", markersize=6)
            panel.loglog(error, row.ms, mark, color=colour, markersize=6)
        alike: dict[object, list[ChainRow]] = {}
        for row in own:  # rungs whose errors are much the same share a label
            alike.setdefault(round(8 * np.log10(row.l_rms_mm)) if row.family == OURS else row.method, []).append(row)
        points = [
            (", ".join(row.method for row in g), max(row.l_rms_mm for row in g), g[0].ms, _STYLES[g[0].family][0])
            for g in alike.values()
        ]
        name_points(panel, points, gap=1.35)
        label(panel, f"{which[0]}, rig {'exactly known' if which[1] == 'exact' else 'as calibrated'}")
    every[0].set_xlim(
        0.35 * min(min(row.bound_mm, row.l_rms_mm) for row in shown), 8.0 * max(row.l_rms_mm for row in shown)
    )
    every[0].set_ylim(0.35 * min(row.read_ms for row in rows), 8.0 * max(row.ms for row in shown))
    legend(drawn, _STYLES, "hollow: in a recording; bars: one standard error of the rms", columns=4)
    label_x(every, 2, "rms error of the contact distance, mm")
    drawn.supylabel("processor time per picture, ms")
    return drawn


def measure(options: Options) -> Findings:
    """The subject `chain` of `vbaa bench`; a draw is a picture, of each size and rig."""
    rows = run(options.draws, options.seed, options.quick)
    row = _chosen(rows)
    return Findings(
        _as_text(rows, row),
        {"chain.csv": rows},
        {"chain.png": lambda: _figure(rows)},
        {"rows": rows},
        f"picture to contact, auto, {row.size}: {row.ms:.0f} ms, {row.of_bound:.2f} × the bound; reading it "
        f"{row.read_ms:.3f} ms",
    )
