"""This library's ways from pictures in memory to contacts, and what every way gives back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from benchmarks.chain.scenes import CAMERA_TILT_RAD, FRICTION_STD_RAD, JOINTS_RAD, Photograph
from benchmarks.estimator.baselines import FIRST_GUESS, one_contact
from benchmarks.vision.judge import peers
from estimator import ContactEstimator
from estimator.contact.recording import detect_again, first_look, measured
from estimator.paper.inclined import inclined_two_point_contact
from estimator.paper.two_point import force_z, straight_line_contact, two_point_contact
from estimator.table.contacts import Measured
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.camera import Camera, CameraOnPlane
from vbaa_calib.detect.whisker.antenna import corridor, free_curve, pixels
from vbaa_calib.detect.whisker.centreline import NOTHING
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

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
