"""What others make of the same pictures: the paper's formulas, a ruler, SciPy, and the way of the image toolboxes.

Formulas for a straight antenna are helped along: the free antenna's shape and moment, which the rig knows, are taken
off first, as one would with a picture before the touch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from benchmarks.estimator.baselines import one_contact
from benchmarks.vision.judge import peers
from estimator import ContactEstimator
from estimator.paper.inclined import inclined_two_point_contact
from estimator.paper.two_point import force_z, straight_line_contact, two_point_contact
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.camera import Camera, CameraOnPlane
from vbaa_calib.detect.whisker.antenna import corridor, free_curve, pixels
from vbaa_calib.rig import Rig

from .methods import CLASSIC, LINE, LOOP, PAPER, Answers, Method, seen
from .scenes import CAMERA_TILT_RAD, JOINTS_RAD, Photograph

SHARES = (0.5, 0.95)
"""Where along the antenna the two points are taken, in lengths, when nobody tells where it is straight."""
STRAIGHT = (0.1, 0.95)
"""The same along its straight part, in lengths of that part."""
FIRST_GUESS = 0.7
"""Of the length: beyond it the first straight line is drawn."""
FEWEST = 12
"""Points that a loop is started with."""
EVENED_PX = 31
TOOLBOX = {"cv2.ximgproc.thinning": ("skeleton", 0.29), "centroid per column": ("centroids", 0.1)}
"""What is taken of `vision_peers` → for people, and the standard deviation that the loop is told, px: whole pixels, and
what they do on good pictures."""

Look = Callable[[Photograph], np.ndarray]
"""A picture to points (N, 2) on the centreline, px."""
Formula = Callable[[Rig, np.ndarray, np.ndarray, np.ndarray], Answers]
"""Points x, y (K, 2) on plane C without the free antenna's shape, moments (K,) of the touch alone → answers."""


@dataclass(frozen=True, eq=False)
class Untouched:
    """What is known of the free antenna before any picture.

    Attributes
    ----------
    free_m : (G, 2) the free antenna as seen on plane C, x ascending. free_moment_Nm : its weight's moment.
    """

    rig: Rig
    free_m: np.ndarray
    free_moment_Nm: float

    @staticmethod
    def of(rig: Rig) -> Untouched:
        """For the joint angles of the freemark's pictures."""
        free = _free(rig)
        at = pixels(rig.camera, rig.T_antenna_camera.inverse(), free.points_m[0])
        return Untouched(rig, rig.camera_on_plane().project(at)[0], float(free.moment_Nm[0]))

    def moment(self, photographs: Sequence[Photograph]) -> np.ndarray:
        """(K,) of the touch alone, by the reading."""
        sensor = self.rig.moment_sensor
        reading = np.array([one.moment_Nm for one in photographs])
        return (reading - sensor.offset_Nm) / sensor.gain - self.free_moment_Nm

    def on_plane_c(self, layer: CameraOnPlane, points_px: np.ndarray) -> np.ndarray:
        """(N, 2) m, in order of x, less the free antenna's y."""
        points = layer.project(points_px)[0]
        points = points[np.isfinite(points).all(axis=1)]
        points = points[np.argsort(points[:, 0])]
        points[:, 1] -= np.interp(points[:, 0], *self.free_m.T)
        return points


@dataclass(frozen=True, eq=False)
class Flattened:
    """Whole pictures taken through the lens's inverse, with OpenCV, before anything is looked for.

    The light is evened out by a wide box: without it a threshold finds the bright side of the picture.
    """

    camera: Camera
    maps: tuple[np.ndarray, np.ndarray]

    @staticmethod
    def of(camera: Camera) -> Flattened:
        """The same picture size, everything that the lens shows still in it."""
        matrix, _ = cv2.getOptimalNewCameraMatrix(camera.matrix, camera.distortion, camera.image_size, 1.0)
        maps = cv2.initUndistortRectifyMap(
            camera.matrix, camera.distortion, np.eye(3), matrix, camera.image_size, cv2.CV_16SC2
        )
        return Flattened(Camera("opencv", camera.image_size, matrix, np.zeros(0)), (maps[0], maps[1]))

    def __call__(self, image: np.ndarray) -> np.ndarray:
        flat = cv2.remap(image, *self.maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return cv2.subtract(flat, cv2.blur(flat, (EVENED_PX, EVENED_PX)))


def others(rig: Rig) -> list[Method]:
    """Everything beside this library's own rungs."""
    estimator, free, flat = ContactEstimator(rig), Untouched.of(rig), Flattened.of(rig.camera)
    flat_rig = replace(rig, camera=flat.camera)
    ours, theirs = _by_finder(estimator), _toolbox(flat_rig, flat)
    layer, flat_layer = rig.camera_on_plane(), flat_rig.camera_on_plane()

    def points(name: str, formula: Formula, told: bool = False) -> Method:
        return Method(name, PAPER, partial(_formula, free, layer, ours, formula, told), told)

    return [
        points("two points, camera A", _upright),
        points("two points, camera B", _inclined),
        points("two points on the straight part", _inclined, told=True),
        Method("straight line", LINE, partial(_ruler, free, layer, ours)),
        Method("elastica by least_squares", LOOP, partial(_scipy, rig, ours, rig.image.noise_px)),
        *(method for look in TOOLBOX for method in _classic(free, flat_rig, flat_layer, look, theirs[look])),
    ]


def _classic(free: Untouched, rig: Rig, layer: CameraOnPlane, name: str, look: Look) -> list[Method]:
    """Both fits to what a toolbox finds in the undistorted picture."""
    title, sigma_px = TOOLBOX[name]
    return [
        Method(f"{title}, two points", CLASSIC, partial(_formula, free, layer, look, _inclined, False)),
        Method(f"{title}, least_squares", CLASSIC, partial(_scipy, rig, look, sigma_px)),
    ]


def _free(rig: Rig) -> Curves:
    gravity = rig.kinematics.T_world_antenna(*JOINTS_RAD).rotation.T @ rig.gravity_world_m_s2
    return free_curve(rig.antenna.parameters, rig.antenna.length_m, gravity)


def _by_finder(estimator: ContactEstimator) -> Look:
    return lambda photograph: next(seen(estimator, [photograph])).points_px


def _toolbox(flat_rig: Rig, flat: Flattened) -> dict[str, Look]:
    """Name → what an image toolbox finds in the undistorted picture, within the same corridor as this library's."""
    to_camera = flat_rig.T_antenna_camera.inverse()
    where = corridor(flat.camera, to_camera, _free(flat_rig), flat_rig.antenna.diameter_m)

    def look(peer: Callable[[np.ndarray], np.ndarray], photograph: Photograph) -> np.ndarray:
        return peer(flat(photograph.image))

    return {name: partial(look, peer) for name, peer in peers(where, flat.camera.image_size).items()}


def _formula(
    free: Untouched, layer: CameraOnPlane, look: Look, formula: Formula, told: bool, photographs: Sequence[Photograph]
) -> Answers:
    """Two points of every picture, then all pictures at once."""
    length = free.rig.antenna.length_m
    picked = []
    for one in photographs:
        begin = one.distance_m if told else 0.0
        wanted = begin + np.array(STRAIGHT if told else SHARES) * (length - begin)
        picked.append(_nearest(free.on_plane_c(layer, look(one)), wanted))
    x, y = np.moveaxis(np.array(picked), -1, 0)
    return formula(free.rig, x, y, free.moment(photographs))


def _nearest(points_m: np.ndarray, wanted_m: np.ndarray) -> np.ndarray:
    """(2, 2) the points of (N, 2), in order of x, that lie nearest to two x; NaN where there are none."""
    if len(points_m) < 2:
        return np.full((2, 2), np.nan)
    return points_m[np.abs(points_m[:, :1] - wanted_m).argmin(axis=0)]


def _upright(rig: Rig, x: np.ndarray, y: np.ndarray, moment_Nm: np.ndarray) -> Answers:
    """The paper's camera A: one that looks straight down on plane C."""
    found = two_point_contact(x, y, rig.antenna.stiffness_Nm2, rig.antenna.length_m)
    return _answers(found.contact_m, found.force_y_N, force_z(moment_Nm, found.contact_m))


def _inclined(rig: Rig, x: np.ndarray, y: np.ndarray, moment_Nm: np.ndarray) -> Answers:
    """The paper's camera B, solved exactly: inclined as this camera is, but seen from far away."""
    antenna = rig.antenna
    found = inclined_two_point_contact(x, y, moment_Nm, antenna.stiffness_Nm2, CAMERA_TILT_RAD, antenna.length_m)
    return _answers(found.contact_m, found.force_y_N, found.force_z_N)


def _ruler(free: Untouched, layer: CameraOnPlane, look: Look, photographs: Sequence[Photograph]) -> Answers:
    """A line through the straight part of each."""
    antenna, moments = free.rig.antenna, free.moment(photographs)
    guess = FIRST_GUESS * antenna.length_m
    rows = []
    for one, moment in zip(photographs, moments, strict=True):
        x, y = free.on_plane_c(layer, look(one)).T
        found = straight_line_contact(x, y, guess, antenna.stiffness_Nm2)
        contact = float(found.contact_m)
        rows.append((contact, float(found.force_y_N), float(force_z(moment, contact))))
    contact, force_y, along_z = np.array(rows).T
    # a line that crosses the antenna beyond its tip tells of no contact
    there = contact <= antenna.length_m
    return _answers(*(np.where(there, values, np.nan) for values in (contact, force_y, along_z)))


def _scipy(rig: Rig, look: Look, sigma_px: float, photographs: Sequence[Photograph]) -> Answers:
    """One `least_squares` after the other."""
    found = np.full((len(photographs), 3), np.nan)
    for index, one in enumerate(photographs):
        points = look(one)
        frame = replace(
            one.truth, rig=rig, points_px=points[None], sigma_px=sigma_px, moment_Nm=np.array([one.moment_Nm])
        )
        if len(points) >= FEWEST:
            found[index] = one_contact(frame, 0)
    inside = (found[:, 0] > 0.0) & (found[:, 0] <= rig.antenna.length_m)
    return _answers(*np.where(inside[:, None], found, np.nan).T)


def _answers(distance_m: Any, force_y_N: Any, force_z_N: Any) -> Answers:
    distance = np.asarray(distance_m, float)
    return Answers(distance, np.full(len(distance), np.nan), np.stack([force_y_N, force_z_N], axis=-1))
