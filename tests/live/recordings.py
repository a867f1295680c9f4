"""A recording of a small rig, as messages and as a bag: some free frames, then contacts, longer than a chunk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from estimator.contact.estimate import STREAM
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, load_session, read_recording
from vbaa_calib.streams import Reading, Taken
from vbaa_calib.streams.bags import BagWriter, Logged

from ..small_scene import small_rig

RATE_HZ = 5.0
COUNT = STREAM + 8


@cache
def rig() -> Rig:
    return Rig.load(small_rig() / "rig.json")


@cache
def frames() -> list[Frame]:
    """Of the small session: the free one and two with contacts."""
    return read_recording(load_session(small_rig() / "session"))


def shown(count: int = COUNT) -> list[tuple[float, Frame]]:
    """Times, s, and which of the frames is shown then: every eighth is free."""
    free, *touched = sorted(frames(), key=lambda frame: abs(frame.moment_Nm - rig().moment_sensor.offset_Nm))
    noise = 0.1 * rig().moment_sensor.std_Nm * np.random.default_rng(0).normal(size=count)  # no reading comes twice
    which = [free if n % 8 == 0 else touched[(n // 8) % len(touched)] for n in range(count)]
    return [
        (1.0 + n / RATE_HZ, replace(frame, moment_Nm=frame.moment_Nm + by))
        for n, (frame, by) in enumerate(zip(which, noise.tolist(), strict=True))
    ]


def messages(count: int = COUNT) -> list[Taken | Reading]:
    """As they come, readings first."""
    several: list[Taken | Reading] = []
    for time_s, frame in shown(count):
        for channel in ("moment_Nm", "pan_rad", "tilt_rad"):
            several.append(Reading(time_s, channel, getattr(frame, channel), time_s))
        assert frame.image is not None
        several.append(Taken(time_s, cv2.imread(str(frame.image), cv2.IMREAD_UNCHANGED), time_s))
    return several


def write(
    path: Path,
    changed: dict[int, np.ndarray] | None = None,
    early_ns: int = 0,
    count: int = COUNT,
    off_s: Callable[[str, int], float] = lambda topic, number: 0.0,
    torque: Callable[[Frame], dict[str, float]] = lambda frame: {"y": frame.moment_Nm},
) -> Path:
    """The recording as a bag. changed : bytes of pictures in the place of others, by their number. early_ns : by so
    much the readings' stamps are wrong. off_s : by how much the stamp of a topic's message with some number is, but not
    when it came. torque : of a frame's wrench."""
    writer = BagWriter(path)

    def log(topic: str, kind: str, fields: dict[str, Any], time_ns: int, number: int) -> None:
        stamp_ns = time_ns + round(1e9 * off_s(topic, number))
        stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
        writer.write(Logged(topic, kind, {**fields, "header": {"stamp": stamp, "frame_id": ""}}, time_ns))

    for number, (time_s, frame) in enumerate(shown(count)):
        assert frame.image is not None
        time_ns = round(1e9 * time_s)
        data = (changed or {}).get(number, np.frombuffer(frame.image.read_bytes(), np.uint8))
        wrench = {"wrench": {"torque": torque(frame)}}
        joints = {"name": ["pan", "tilt"], "position": [frame.pan_rad, frame.tilt_rad]}
        log("/moment", "geometry_msgs/msg/WrenchStamped", wrench, time_ns - early_ns, number)
        log("/joint_states", "sensor_msgs/msg/JointState", joints, time_ns - early_ns, number)
        picture = {"format": "png", "data": data}
        log("/camera/compressed", "sensor_msgs/msg/CompressedImage", picture, time_ns, number)
    writer.close()
    return path
