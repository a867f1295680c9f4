"""Joint angles of the strokes along an object before a rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import Kinematics, Pose
from ..rig import Rig
from ..synth.objects import TouchObject
from ..synth.paths import sweep_joints
from ..synth.scene import Joints, Sweep
from .rod_of_rig import rod_of

PRESS_FRAMES = 5


@dataclass(frozen=True, eq=False)
class Stage:
    """What a path hangs on (`synth.paths.Place`): an object before a rig. `radius_m` is the antenna's."""

    name: str
    object: TouchObject
    radius_m: float
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray

    @staticmethod
    def of(rig: Rig, obj: TouchObject) -> Stage:
        """The object before that rig."""
        return Stage(obj.shape, obj, rig.antenna.diameter_m / 2, rig.kinematics, rig.gravity_world_m_s2)

    def T_world_antenna(self, joints: Joints) -> Pose:
        """Pose of the antenna frame at given joint angles."""
        return self.kinematics.T_world_antenna(joints.pan_rad, joints.tilt_rad)


def stroke_joints(rig: Rig, obj: TouchObject, sweep: Sweep, press_frames: int = PRESS_FRAMES) -> list[Joints]:
    """A sweep's joint angles with the press and the release spread over so many frames each."""
    joints = sweep_joints(Stage.of(rig, obj), rod_of(rig), sweep)
    first, last = sweep.free_frames, len(joints) - sweep.free_frames - 1
    press = _between(joints[first - 1], joints[first], press_frames)
    release = _between(joints[last], joints[last + 1], press_frames)
    return [*joints[:first], *press, *joints[first : last + 1], *release, *joints[last + 1 :]]


def _between(start: Joints, end: Joints, count: int) -> list[Joints]:
    """Angles inside a straight way from one pair to another."""
    shares = np.linspace(0.0, 1.0, count + 2)[1:-1]
    return [
        Joints(
            start.pan_rad + float(share) * (end.pan_rad - start.pan_rad),
            start.tilt_rad + float(share) * (end.tilt_rad - start.tilt_rad),
        )
        for share in shares
    ]
