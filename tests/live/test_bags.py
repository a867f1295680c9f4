"""Bags: what is written is what foreign readers, Rerun and ROS 2 read, and what is read is what was meant."""

from __future__ import annotations

import runpy
import struct
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from mcap_ros2.decoder import DecoderFactory

from estimator.live.outputs import contact_messages
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams import Reading
from vbaa_calib.streams.bags import BagWriter, Logged, Topics, open_bag, picture_of, readings_of
from viz.files.rerun_log import RerunLog

from ..hostile.case import bounded
from ..lazy import Lazy
from .recordings import COUNT, frames, messages, rig, shown, write
from .test_live import found

rosbag2 = Lazy("rosbags.rosbag2")
highlevel = Lazy("rosbags.highlevel")
typesys = Lazy("rosbags.typesys")


def read(path: Path, topics: Topics | None = None, camera: Camera | None = None) -> tuple[list[Any], list[str]]:
    source = open_bag(path, topics or Topics(), camera)
    return list(source.messages()), source.notes


@pytest.mark.parametrize("name", ["bag.mcap", "bag.bag", "bag"])
def test_a_bag_gives_back_what_was_written(tmp_path: Path, name: str) -> None:
    """MCAP, ROS 1 and ROS 2: every number and every pixel."""
    found, notes = read(write(tmp_path / name))
    expected = messages()
    assert (len(found), notes) == (len(expected), [])
    for one, other in zip(found, expected, strict=True):
        assert type(one) is type(other)
        assert one.time_s == pytest.approx(other.time_s, abs=1e-9)
        if isinstance(other, Reading):
            assert (one.channel, one.value) == (other.channel, other.value)
        else:
            np.testing.assert_array_equal(one.image, other.image)


def test_foreign_readers_read_it(tmp_path: Path) -> None:
    """The libraries of MCAP itself, which share nothing with what wrote the messages' bytes."""
    path = write(tmp_path / "bag.mcap")
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert {channel.topic for channel in summary.channels.values()} == {
            "/moment",
            "/joint_states",
            "/camera/compressed",
        }
        wrenches = [each.decoded_message for each in reader.iter_decoded_messages(["/moment"])]
    assert [wrench.wrench.torque.y for wrench in wrenches] == [frame.moment_Nm for _, frame in shown()]
    assert [wrench.header.stamp.sec for wrench in wrenches] == [int(time_s + 1e-9) for time_s, _ in shown()]
    with highlevel.AnyReader([path]) as bag:
        assert bag.message_count == 3 * COUNT


ENCODINGS = {
    "mono8": (np.uint8, 1),
    "bgr8": (np.uint8, 3),
    "rgb8": (np.uint8, 3),
    "bgra8": (np.uint8, 4),
    "rgba8": (np.uint8, 4),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_images_by_their_encoding(encoding: str) -> None:
    """Rows with padding; channels in OpenCV's order."""
    kind, count = ENCODINGS[encoding]
    pixels = np.random.default_rng(0).integers(0, 255, (5, 7, count), kind)
    rows = np.pad(pixels.reshape(5, -1), ((0, 0), (0, 3)))
    image = SimpleNamespace(encoding=encoding, height=5, width=7, step=rows.shape[1], is_bigendian=0, data=rows.ravel())
    expected = pixels[..., 0] if count == 1 else pixels[..., [2, 1, 0] if encoding.startswith("rgb") else [0, 1, 2]]
    np.testing.assert_array_equal(picture_of(image), expected)


def image_of(encoding: str, data: np.ndarray, height: int, width: int) -> SimpleNamespace:
    """An Image without padding, of rows of any type."""
    raw = np.frombuffer(np.ascontiguousarray(data).tobytes(), np.uint8)
    rows = height * 3 // 2 if encoding.startswith("nv") else height
    return SimpleNamespace(
        encoding=encoding, height=height, width=width, step=raw.size // rows, is_bigendian=0, data=raw
    )


def test_brightness_and_colour_apart() -> None:
    """Two pixels share their colours: by YUV's definition, of both orders, and with colours in a plane of their own."""
    y = np.arange(40, 232, 4, dtype=np.uint8).reshape(6, 8)
    blue, red = np.uint8(190), np.uint8(90)  # Cb, Cr: a bluish picture
    uv = np.tile(np.array([blue, red], np.uint8), (6, 4))
    level = 1.164 * (y.astype(float) - 16.0)
    expected = np.stack([level + 2.018 * 62, level - 0.813 * -38 - 0.391 * 62, level + 1.596 * -38], axis=-1)
    for encoding, data in (
        ("yuv422", np.stack([uv, y], axis=-1)),
        ("uyvy", np.stack([uv, y], axis=-1)),
        ("yuv422_yuy2", np.stack([y, uv], axis=-1)),
        ("yuyv", np.stack([y, uv], axis=-1)),
        ("nv12", np.concatenate([y, uv[:3]])),
        ("nv21", np.concatenate([y, uv[:3, ::-1]])),
    ):
        np.testing.assert_allclose(picture_of(image_of(encoding, data, 6, 8)), np.clip(expected, 0, 255), atol=2.0)


def small_bag(path: Path, *several: tuple[str, str, dict[str, Any]]) -> Path:
    writer = BagWriter(path)
    for topic, kind, fields in several:
        writer.write(Logged(topic, kind, fields, 10**9))
    writer.close()
    return path


IMAGE = {"encoding": "mono8", "height": 2, "width": 2, "step": 2, "data": np.zeros(4, np.uint8)}
CAMERA = {"width": 480, "height": 360}


def test_a_bag_of_another_camera_is_refused(tmp_path: Path) -> None:
    matrix = rig().camera.matrix
    for name, camera, what in (
        ("size.mcap", {"width": 640, "height": 480}, "640x480"),
        ("focal.mcap", CAMERA | {"k": 1.1 * matrix.ravel()}, "focal length"),
    ):
        of_camera = ("/cam/camera_info", "sensor_msgs/msg/CameraInfo", camera)
        path = small_bag(tmp_path / name, of_camera, ("/cam/image", "sensor_msgs/msg/Image", IMAGE))
        with pytest.raises(InputError, match=what):
            read(path, camera=rig().camera)
        assert len(read(path, Topics(camera="none"), rig().camera)[0]) == 1


def test_the_moment_of_a_right_handed_torque(tmp_path: Path) -> None:
    """A sensor whose axes are the antenna's states r × f: its -y, or -z where that points along y, is x·f_z − z·f_x."""
    point_m, force_N = np.array([0.14, 0.004, -0.003]), np.array([-0.01, 0.03, 0.04])
    torque = dict(zip("xyz", np.cross(point_m, force_N).tolist(), strict=True))
    image = ("/image", "sensor_msgs/msg/Image", IMAGE)
    path = small_bag(
        tmp_path / "one.mcap", image, ("/ft", "geometry_msgs/msg/WrenchStamped", {"wrench": {"torque": torque}})
    )
    wrench = SimpleNamespace(wrench=SimpleNamespace(torque=SimpleNamespace(**torque)))
    for axis in "xyz":
        for sign, value in (("", torque[axis]), ("-", -torque[axis])):
            assert [each.value for each in readings_of(wrench, Topics(moment_axis=sign + axis), 1.0)] == [value]
    wrench.wrench.force = SimpleNamespace(x=1.0, y=2.0, z=3.0)
    every = {each.channel: each.value for each in readings_of(wrench, Topics(wrench=True), 1.0)}
    forces = {f"sensor_force_{axis}_N": value for axis, value in zip("xyz", (1.0, 2.0, 3.0), strict=True)}
    moments = {"moment_Nm": torque["y"], "moment_z_Nm": torque["z"], "moment_x_Nm": torque["x"]}
    assert every == moments | forces
    (_, reading), _ = read(path, Topics(moment_axis="-y"))
    assert reading.value == pytest.approx(point_m[0] * force_N[2] - point_m[2] * force_N[0], rel=1e-12)
    number = small_bag(tmp_path / "number.mcap", image, ("/moment", "std_msgs/msg/Float64", {"data": 0.25}))
    with pytest.raises(InputError, match="/moment is a Float64"):
        read(number, Topics(moment_axis="-y"))


def test_which_lens_is_of_raw_and_which_of_rectified_pictures(tmp_path: Path) -> None:
    """K of image_raw, P of image_rect: each is compared with the rig's lens, and named; a topic that does not say which
    it is of is asked about."""
    matrix = rig().camera.matrix
    onto = matrix * np.array([[0.9, 1.0, 1.0], [1.0, 0.9, 1.0], [1.0, 1.0, 1.0]])
    raw = Camera("opencv", (480, 360), matrix, np.array([-0.3, 0.1, 0.0, 0.0]))
    rectified = Camera("opencv", (480, 360), onto, np.zeros(0))
    about = CAMERA | {"k": matrix.ravel(), "d": [-0.3, 0.1, 0, 0, 0], "p": np.hstack([onto, np.zeros((3, 1))]).ravel()}
    about["distortion_model"] = "plumb_bob"
    taken = {"/c/image_raw": raw, "/c/image_rect": rectified, "/c/image": raw}
    for topic in taken:
        of_camera = ("/c/camera_info", "sensor_msgs/msg/CameraInfo", about)
        path = small_bag(tmp_path / f"{topic[3:]}.mcap", of_camera, (topic, "sensor_msgs/msg/Image", IMAGE))
        for camera in (raw, rectified):
            if camera is taken[topic]:
                assert len(read(path, camera=camera)[0]) == 1
                continue
            with pytest.raises(InputError, match="image_rect") as refused:
                read(path, camera=camera)
            assert "camera=none" in str(refused.value)
            if camera is rectified:
                for part in ("K, fx", "image_raw", "P, fx"):
                    assert part in str(refused.value)


def field(number: int, data: bytes) -> bytes:
    return (
        bytes([number << 3 | 2, *([len(data)] if len(data) < 128 else [len(data) % 128 + 128, len(data) // 128])])
        + data
    )


TOPIC, KIND = "/image", "sensor_msgs/msg/Image"


@cache
def humble() -> Any:
    """The messages of the distribution."""
    return typesys.get_typestore(typesys.Stores["ROS2_HUMBLE"])


def packed_messages(path: Path) -> None:
    writer = rosbag2.Writer(path, version=9)
    writer.set_compression(rosbag2.CompressionMode.MESSAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        writer.write(writer.add_connection(TOPIC, KIND, typestore=humble()), 1, bytes(100_000_000))


def lying(path: Path) -> None:
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="ros2")
        text = humble().generate_msgdef(KIND, ros_version=2)[0].encode()
        channel = writer.register_channel(TOPIC, "cdr", writer.register_schema(KIND, "ros2msg", text))
        writer.add_message(channel, 1, bytes(100_000_000), 1)
        writer.finish()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    true = struct.pack("<Q", summary.chunk_indexes[0].uncompressed_size)
    path.write_bytes(path.read_bytes().replace(true, struct.pack("<Q", 1000)))


@pytest.mark.parametrize(("name", "make"), [("a.mcap", lying), ("a", packed_messages)])
def test_what_unpacks_to_far_more_than_it_is_is_refused(tmp_path: Path, name: str, make: Callable[[Path], Any]) -> None:
    """Within 50 times the file and 200 MB."""
    path = tmp_path / name
    make(path)
    size = sum(each.stat().st_size for each in (path.iterdir() if path.is_dir() else [path]))
    with bounded(30.0, 50 * size + 200_000_000), pytest.raises(InputError, match="unpack to more than"):
        read(path)


def chunks(path: Path) -> Iterator[Any]:
    """By Rerun's own reader, which takes half a second to load."""
    from rerun.chunk import RrdReader

    return RrdReader(str(path)).stream()


def test_a_log_holds_picture_scene_and_numbers(tmp_path: Path) -> None:
    path = tmp_path / "new" / "live.rrd"
    log = RerunLog(str(path))
    several = found()[:30]
    for each in several:
        log.write(each)
    log.close()
    paths = {chunk.entity_path for chunk in chunks(path)}
    assert {"/picture", "/picture/antenna", "/contact/distance_mm", "/world/contact/point"} <= paths


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
