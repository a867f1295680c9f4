"""Whole recordings of an object that the antenna strokes, with their truth: centrelines and moments, no pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from benchmarks.estimator.scenes import seen
from benchmarks.estimator.setup import ACROSS, Setup, rod_of
from benchmarks.harness import concatenated
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.table.contacts import FRICTION_RAD, ContactRow, ContactTable
from vbaa_calib.antenna.rod import sample_shape
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame
from vbaa_calib.simulate.contact.stick_slip import Bases, Setting
from vbaa_calib.simulate.contact.touch import Touch, touch_strokes
from vbaa_calib.simulate.joint_paths import sweep_joints
from vbaa_calib.simulate.scene.objects import Bump, TouchObject
from vbaa_calib.simulate.scene.scene import Joints, Sweep

_PRESS_FRAMES = 5


def _stroke_joints(rig: Rig, obj: TouchObject, sweep: Sweep) -> list[Joints]:
    """A sweep's joint angles with the press and the release spread over so many frames each."""
    setting = Setting(rod_of(rig), rig.antenna.diameter_m / 2, obj, rig.gravity_world_m_s2)
    joints = sweep_joints(setting, rig.kinematics, sweep)
    first, last = sweep.free_frames, len(joints) - sweep.free_frames - 1
    press = _between(joints[first - 1], joints[first], _PRESS_FRAMES)
    release = _between(joints[last], joints[last + 1], _PRESS_FRAMES)
    return [*joints[:first], *press, *joints[first : last + 1], *release, *joints[last + 1 :]]


def _between(start: Joints, end: Joints, count: int) -> list[Joints]:
    """Angles inside a straight way from one pair to another."""
    way = np.array([end.pan_rad - start.pan_rad, end.tilt_rad - start.tilt_rad])
    pairs = np.array([start.pan_rad, start.tilt_rad]) + np.linspace(0.0, 1.0, count + 2)[1:-1, None] * way
    return [Joints(*pair) for pair in pairs.tolist()]


SIGMA_PX, POINTS, RATE_HZ = 0.1, 150, 30.0
_PAUSE_S = 1.0
"""Between two strokes, while the antenna is carried round."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of B frames; NaN without contact.

    in_contact, sticks : (B,) bool. distance_m : (B,) arc length of the contact.
    tangent_world : (B, 3) of the antenna there, towards the tip.
    point_world_m : (B, 3) of the antenna's centreline at the contact.
    touched_world_m : (B, 3) the touched point of the undeformed object. normal_world : (B, 3) outward there.
    force_antenna_N, force_world_N : (B, 3) the object's force on the antenna; zero without contact.
    indentation_m : (B,) how far the object gives way.
    friction_ratio : (B,) of the force's part across the normal over that along it.
    slip_m : (B, 3) what the antenna's material point at the contact moved along the object since the frame before,
        world frame; zero without contact.
    """

    in_contact: np.ndarray
    distance_m: np.ndarray
    tangent_world: np.ndarray
    point_world_m: np.ndarray
    touched_world_m: np.ndarray
    normal_world: np.ndarray
    force_antenna_N: np.ndarray
    force_world_N: np.ndarray
    indentation_m: np.ndarray
    friction_ratio: np.ndarray
    sticks: np.ndarray
    slip_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Recorded:
    """One recording of B frames, in order of time.

    given, true : the rig as the estimator is to know it, and as it is.
    stroke : (B,) int. time_s, pan_rad, tilt_rad, moment_Nm : (B,).
    centrelines_px : (B, N, 2), NaN outside the picture; `sigma_px` is the deviation of each coordinate.
    T_world_antenna : B true poses.
    """

    given: Rig
    true: Rig
    object: TouchObject
    stroke: np.ndarray
    time_s: np.ndarray
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    centrelines_px: np.ndarray
    sigma_px: float
    moment_Nm: np.ndarray
    T_world_antenna: Sequence[Pose]
    truth: Truth

    def __len__(self) -> int:
        return len(self.time_s)

    def noisy(self, rng: np.random.Generator, given: Rig | None = None) -> Recorded:
        """With noise on pixels and readings; `given` is the rig that the estimator is to know, if another."""
        return replace(
            self,
            given=self.given if given is None else given,
            centrelines_px=self.centrelines_px + rng.normal(0.0, self.sigma_px, self.centrelines_px.shape),
            moment_Nm=self.moment_Nm + rng.normal(0.0, self.true.moment_sensor.std_Nm, len(self)),
        )


def record(
    rig: Rig,
    obj: TouchObject,
    strokes: Sequence[Sweep | Sequence[Joints]],
    rng: np.random.Generator,
    *,
    given: Rig | None = None,
    **how: Any,
) -> Recorded:
    """`play` with noise; `given`, where it is another than the true one, is the rig that the estimator is to know."""
    return play(rig, obj, strokes, **how).noisy(rng, given)


def play(
    rig: Rig,
    obj: TouchObject,
    strokes: Sequence[Sweep | Sequence[Joints]],
    *,
    sigma_px: float = SIGMA_PX,
    points: int = POINTS,
    rate_hz: float = RATE_HZ,
) -> Recorded:
    """An object stroked by the antenna, stroke after stroke, without noise yet.

    rig : the true one.
    strokes : each a sweep, which is pressed and released by and by (`_stroke_joints`), or joint angles.
    sigma_px : deviation of the noise that is meant, along u and along v.
    points : of a centreline, evenly over the arc length.

    InputError : a sweep that never meets the object. SolveError : the antenna slips off.
    """
    rod, radius = rod_of(rig), rig.antenna.diameter_m / 2
    paths = [_stroke_joints(rig, obj, one) if isinstance(one, Sweep) else list(one) for one in strokes]
    poses = [[rig.kinematics.T_world_antenna(at.pan_rad, at.tilt_rad) for at in path] for path in paths]
    touches = touch_strokes(rod, radius, obj, poses, rig.gravity_world_m_s2)
    parts = [_truth(one, path, radius) for one, path in zip(touches, poses, strict=True)]
    at = rod.length_m * (np.arange(points) + 0.5) / points
    lines = [sample_shape(one.shape, np.broadcast_to(at, (len(one.contact_m), points)))[0] for one in touches]
    stroke = np.repeat(np.arange(len(paths)), [len(path) for path in paths])
    true_Nm = np.concatenate([-one.shape.clamp_moment_Nm[:, 1] for one in touches])
    return Recorded(
        given=rig,
        true=rig,
        object=obj,
        stroke=stroke,
        time_s=np.arange(len(stroke)) / rate_hz + _PAUSE_S * stroke,
        pan_rad=np.array([at.pan_rad for path in paths for at in path]),
        tilt_rad=np.array([at.tilt_rad for path in paths for at in path]),
        centrelines_px=seen(rig.camera, rig.T_antenna_camera, np.concatenate(lines)),
        sigma_px=sigma_px,
        moment_Nm=rig.moment_sensor.gain * true_Nm + rig.moment_sensor.offset_Nm,
        T_world_antenna=[pose for path in poses for pose in path],
        truth=concatenated(parts),
    )


def contacts(recorded: Recorded, friction: float = FRICTION_RAD) -> ContactTable:
    """What the estimator makes of a recording, frame by frame; `friction` is the deviation of its angle, rad."""
    found = ContactEstimator(recorded.given, friction=friction).estimate_batch(
        recorded.centrelines_px, recorded.moment_Nm, recorded.pan_rad, recorded.tilt_rad, sigma_px=recorded.sigma_px
    )
    return contact_table(found, recorded.pan_rad, recorded.tilt_rad, recorded.moment_Nm, recorded.time_s)


def contact_table(
    found: Contacts, pan_rad: np.ndarray, tilt_rad: np.ndarray, moment_Nm: np.ndarray, time_s: np.ndarray
) -> ContactTable:
    """Contacts of B frames with their joints, readings and times, (B,) each, as of contacts.csv."""
    columns = np.stack([pan_rad, tilt_rad, moment_Nm, time_s], axis=1).tolist()
    frames = [
        Frame(None, pan, tilt, moment, frame=i, time_s=time) for i, (pan, tilt, moment, time) in enumerate(columns)
    ]
    return ContactTable.from_rows([ContactRow.of(*pair) for pair in zip(frames, found, strict=True)])


def _truth(touched: Touch, poses: Sequence[Pose], radius_m: float) -> Truth:
    """Of one stroke."""
    bases = Bases.of(poses)
    turn, point = bases.rotation, bases.world(touched.contact_antenna_m)
    force = np.einsum("bij,bj->bi", turn, touched.force_antenna_N)
    along = np.nan_to_num(touched.contact_m)[:, None]
    tangent = np.einsum("bij,bj->bi", turn, sample_shape(touched.shape, along)[1][:, 0])
    tangent[~touched.in_contact] = np.nan
    normal = touched.normal_world
    press = (force * normal).sum(axis=1)
    return Truth(
        in_contact=touched.in_contact,
        distance_m=touched.contact_m,
        tangent_world=tangent,
        point_world_m=point,
        touched_world_m=touched.touched_world_m,
        normal_world=normal,
        force_antenna_N=touched.force_antenna_N,
        force_world_N=force,
        indentation_m=radius_m - ((point - touched.touched_world_m) * normal).sum(axis=1),
        friction_ratio=np.linalg.norm(force - press[:, None] * normal, axis=1) / press,
        sticks=touched.sticks,
        slip_m=touched.slip_world_m,
    )


SETUP = Setup("brown", 0.5, ACROSS, swing_m=0.06, real=True)
"""Camera inclined by 30° across the antenna; weight, bow and a clamp that is off."""
RIGID, SOFT, SOFTER = np.inf, 1000.0, 250.0
"""N/m. Forces up to 0.1 N press a tenth of a millimetre into the soft ones, four tenths into the softer."""
CENTRE = np.array([0.15, 0.0, 0.0])
_BESIDE = CENTRE + np.array([0.0, 0.02, 0.0])


@dataclass(frozen=True)
class Case:
    """An object and how it is stroked: `make` takes stiffness in N/m and friction."""

    name: str
    make: Callable[[float, float], TouchObject]
    strokes: Sequence[Sweep]


def _unit(*direction: float) -> np.ndarray:
    return np.array(direction) / np.linalg.norm(direction)


AXIS = _unit(0.2, 0.15, 0.95)
_INTO_BOX = np.cross(AXIS, _unit(*np.cross((0.3, 1.0, 0.0), AXIS)))
BUMPS = (
    Bump(_unit(-0.3, 1.0, 0.2), 3e-3, 12e-3),
    Bump(_unit(-0.3, -1.0, -0.2), 3e-3, 12e-3),
    Bump(_unit(-0.3, 0.1, 1.0), 2e-3, 10e-3),
    Bump(_unit(0.2, -1.0, 0.6), -2e-3, 12e-3),
)


def _strokes(press: str, toward: int, push_deg: tuple[float, float], reach_deg: tuple[float, float]) -> Iterator[Sweep]:
    """Two, the second the other way and with its pushes between those of the first."""
    push, (begin, end) = tuple(np.radians(push_deg).tolist()), np.radians(reach_deg).tolist()
    for swells, reach in ((3.0, (begin, end)), (2.5, (end, begin))):
        yield Sweep(press, toward, 21, 3, np.radians(1.5), push, swells, reach)


_LINE = [
    stroke
    for toward in (1, -1)
    for push in ((1.5, 6.0), (3.0, 9.0))
    for stroke in _strokes("pan", toward, push, (-12.0, 12.0))
]
_EDGE = [
    stroke
    for push in ((1.5, 5.0), (2.5, 7.0), (4.0, 9.0), (3.0, 6.0))
    for stroke in _strokes("pan", 1, push, (-12.0, 12.0))
]
_ROUND = [
    stroke
    for press in ("pan", "tilt")
    for toward in (1, -1)
    for stroke in _strokes(press, toward, (1.5, 5.0), (-4.0, 4.0))
]
CASES = (
    Case("cylinder", lambda stiffness, mu: TouchObject("cylinder", CENTRE, AXIS, 0.02, 0.08, stiffness, mu), _LINE),
    Case("sphere", lambda stiffness, mu: TouchObject("sphere", CENTRE, AXIS, 0.03, 1.0, stiffness, mu), _ROUND),
    Case("box edge", lambda k, mu: TouchObject("box_edge", _BESIDE, AXIS, 3e-3, 0.08, k, mu, _INTO_BOX), _EDGE),
    Case("free form", lambda k, mu: TouchObject("freeform", CENTRE, AXIS, 0.028, 1.0, k, mu, bumps=BUMPS), _ROUND),
)
PIN_M = 2e-3
"""Radius of a pin at a known place."""
PIN = Case("pin", lambda k, mu: TouchObject("cylinder", CENTRE, AXIS, PIN_M, 0.12, k, mu), _LINE)


@lru_cache(maxsize=32)
def played(name: str, stiffness_N_m: float, friction: float) -> Recorded:
    """One of `CASES`, or the pin, stroked by the antenna of `SETUP`; without noise yet."""
    case = next(each for each in (*CASES, PIN) if each.name == name)
    return play(SETUP.rig(), case.make(stiffness_N_m, friction), case.strokes)
