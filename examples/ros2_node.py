"""Contacts in ROS 2: a node that subscribes to pictures, moment and joints, and publishes contacts while they come.

    python examples/ros2_node.py --ros-args -p rig:=rig.json -r image:=/camera/image_raw -r moment:=/wrench

Only `main` needs ROS: everything that turns messages into numbers and back works without, and is tested so.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from time import perf_counter
from typing import Any

from estimator import RigWatch
from estimator.live import LiveContact, LiveEstimator
from estimator.live.outputs import contact_messages
from vbaa import ContactEstimator, InputError, Rig
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing
from vbaa_calib.streams.bags import Topics, picture_of, readings_of, stamp_s

TICK_S = 0.02
PARAMETERS: dict[str, Any] = {
    "rig": "rig.json",
    "clock_offset": 0.0,
    "moment_axis": "y",
    "pan_joint": "pan",
    "tilt_joint": "tilt",
}
PARAMETERS |= {"watch": False}  # alarms on /contact/alarm once the rig is not as it was calibrated
KINDS = (
    "std_msgs/msg/String",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/WrenchStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
"""What is published, each as /contact/… at once and as /contact/final/… later."""


def taken_of(message: Any, camera: str = "") -> Taken:
    """An Image or CompressedImage at its own time. Raises InputError for one that cannot be read."""
    now_s = time.time()
    return Taken(stamp_s(message, now_s), picture_of(message), now_s, perf_counter(), camera=camera)


def read_of(message: Any, topics: Topics) -> Iterator[Reading]:
    """What a WrenchStamped or JointState says, at its own time. Raises InputError where joints must be named."""
    return readings_of(message, topics, time.time())


def filled(message: Any, fields: Mapping[str, Any]) -> Any:
    """A new message with these fields, those within others included."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def stamped(fields: Mapping[str, Any], time_ns: int, frame: str) -> dict[str, Any]:
    """The same with a header."""
    return {"header": {"stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}, "frame_id": frame}, **fields}


def main() -> None:
    """Run until Ctrl-C."""
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data
    from rosidl_runtime_py.utilities import get_message
    from sensor_msgs.msg import CompressedImage, Image, JointState

    rclpy.init()
    node = Node("vbaa")
    given = {name: node.declare_parameter(name, value).value for name, value in PARAMETERS.items()}
    topics = Topics(pan=given["pan_joint"], tilt=given["tilt_joint"], moment_axis=given["moment_axis"])
    rig = Rig.load(given["rig"])
    timing = Timing(given["clock_offset"], moment_std_Nm=(rig.moment_sensor.std_Nm, 0.0))
    synchronizer = Synchronizer(timing, ["moment_Nm", "pan_rad", "tilt_rad"], rig.image_sizes)
    watch = RigWatch(rig) if given["watch"] else None
    live = LiveEstimator(ContactEstimator(rig, jobs=1), synchronizer, watch=watch)
    live.warm()
    publishers: dict[str, Any] = {}

    def publish(contacts: Iterator[LiveContact]) -> None:
        for contact in contacts:
            for logged in contact_messages(contact):
                kind = get_message(logged.kind)
                if logged.topic not in publishers:
                    publishers[logged.topic] = node.create_publisher(kind, logged.topic, 10)
                plain = logged.kind == KINDS[0]
                fields = logged.fields if plain else stamped(logged.fields, logged.time_ns, "world")
                publishers[logged.topic].publish(filled(kind(), fields))

    def push(messages: Callable[[], Iterable[Taken | Reading]]) -> None:
        try:
            for each in messages():
                publish(live.push(each))
        except InputError as error:
            node.get_logger().warning(str(error), throttle_duration_sec=10.0)

    def see(message: Any, camera: str) -> None:
        push(lambda: [taken_of(message, camera)])

    def read(message: Any) -> None:
        push(lambda: read_of(message, topics))

    # of pictures only the newest waits: those that come while one is estimated are dropped by ROS
    newest = qos_profile_sensor_data
    newest.depth = 1
    for camera in rig.image_sizes:
        # of several cameras left/image, right/image
        image = f"{camera}/image" if camera else "image"
        node.create_subscription(Image, image, partial(see, camera=camera), newest)
        node.create_subscription(CompressedImage, f"{image}/compressed", partial(see, camera=camera), newest)
    node.create_subscription(WrenchStamped, "moment", read, 1000)
    node.create_subscription(JointState, "joint_states", read, 1000)
    node.create_timer(TICK_S, lambda: publish(live.tick(time.time())))
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        publish(live.finish())
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
