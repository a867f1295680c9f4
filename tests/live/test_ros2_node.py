"""The node's conversions, with rosbags' message classes in the place of ROS' own."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.live.outputs import contact_messages
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams.bags import BagWriter, Topics

from .recordings import frames
from .test_live import found

NODE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "ros2_node.py"), run_name="node")


@pytest.fixture
def blank(tmp_path: Path) -> Any:
    """Makes an empty message of a kind, as ROS' own constructors do, or one with fields."""
    writer = BagWriter(tmp_path / "unused.mcap")
    yield lambda kind, fields=None: writer._built(kind, fields or {})
    writer.close()


def test_contacts_become_messages(blank: Any) -> None:
    """Every field of every kind, at the picture's time, in the world frame."""
    several = [logged for each in found() for logged in contact_messages(each)]
    assert {logged.kind for logged in several} == set(NODE["KINDS"])
    for logged in several:
        fields = logged.fields
        if logged.kind != "std_msgs/msg/String":
            fields = NODE["stamped"](fields, logged.time_ns, "world")
            assert fields["header"]["stamp"]["sec"] * 10**9 + fields["header"]["stamp"]["nanosec"] == logged.time_ns
        message, expected = NODE["filled"](blank(logged.kind), fields), blank(logged.kind, fields)
        assert repr(message) == repr(expected) or np.array_equal(message.pose.covariance, expected.pose.covariance)


def test_messages_become_pictures_and_readings(blank: Any) -> None:
    frame = frames()[0]
    header = {"stamp": {"sec": 7, "nanosec": 250_000_000}, "frame_id": ""}
    data = np.frombuffer(frame.image.read_bytes(), np.uint8)  # type: ignore[union-attr]
    packed = blank("sensor_msgs/msg/CompressedImage", {"header": header, "format": "png", "data": data})
    grey = cv2.imread(str(frame.image), cv2.IMREAD_GRAYSCALE)
    height, width = grey.shape
    plain = {"height": height, "width": width, "step": width, "encoding": "mono8", "data": grey.ravel()}
    image = blank("sensor_msgs/msg/Image", {"header": header, **plain})
    for message in (packed, image):
        taken = NODE["taken_of"](message)
        assert taken.time_s == 7.25
        np.testing.assert_array_equal(taken.image if taken.image.ndim == 2 else taken.image[..., 0], grey)
    wrench = blank("geometry_msgs/msg/WrenchStamped", {"header": header, "wrench": {"torque": {"z": 2e-3}}})
    (reading,) = NODE["read_of"](wrench, Topics(moment_axis="z"))
    assert (reading.time_s, reading.channel, reading.value) == (7.25, "moment_Nm", 2e-3)
    joints = {"header": header, "name": ["lift", "pan", "tilt"], "position": [0.5, 0.1, 0.2]}
    several = list(NODE["read_of"](blank("sensor_msgs/msg/JointState", joints), Topics()))
    assert {each.channel: each.value for each in several} == {"pan_rad": 0.1, "tilt_rad": 0.2}
    with pytest.raises(InputError, match="--pan-joint"):
        list(NODE["read_of"](blank("sensor_msgs/msg/JointState", {"name": ["a"], "position": [0.0]}), Topics()))
    with pytest.raises(InputError, match="bytes are not"):
        NODE["taken_of"](blank("sensor_msgs/msg/Image", {**plain, "data": grey.ravel()[:-1]}))
