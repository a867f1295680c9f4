"""ROS 1 bags, ROS 2 bags and MCAP files, read and written without ROS."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError, clipped, require_extra
from vbaa_calib.core.files import read_yaml, require_file
from vbaa_calib.core.images import as_levels, read_picture

from .messages import Messages, Reading, Source, Taken
from .unpacking import bound_unpacking, check_bag, refuse_bombs

SUFFIXES = (".mcap", ".bag", ".db3")
_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_MOMENTS = ("geometry_msgs/msg/WrenchStamped", "std_msgs/msg/Float64")
_JOINTS, _CAMERA = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CameraInfo"
_ROLES = {"image": _IMAGES, "moment": _MOMENTS, "joints": (_JOINTS,)}
_COLOURS = {"rgb8": cv2.COLOR_RGB2BGR, "rgba8": cv2.COLOR_RGBA2BGR, "bgra8": cv2.COLOR_BGRA2BGR}
_BAYER = {
    # OpenCV names the pattern by its second row and column
    "bayer_rggb8": cv2.COLOR_BayerBG2BGR,
    "bayer_bggr8": cv2.COLOR_BayerRG2BGR,
    "bayer_gbrg8": cv2.COLOR_BayerGR2BGR,
    "bayer_grbg8": cv2.COLOR_BayerGB2BGR,
}
_LAYOUTS: dict[str, tuple[str, int]] = {
    **dict.fromkeys(("mono8", "8UC1", *_BAYER), ("u1", 1)),
    **dict.fromkeys(("rgb8", "bgr8", "8UC3"), ("u1", 3)),
    **dict.fromkeys(("rgba8", "bgra8"), ("u1", 4)),
    **dict.fromkeys(("mono16", "16UC1"), ("u2", 1)),
}
"""ROS' name of an image's encoding: type and number of its channels."""
_FOCAL_SHARE = 0.01
"""A camera whose focal length is so much off the rig's is another one."""


@dataclass(frozen=True)
class Topics:
    """Which topics to take, and what in them. "": the only one of its kind.

    pan, tilt : names of the joints. moment_axis : the component of a wrench's torque that is the moment, such as y or
    -y: of the right-handed torque about the antenna's y, the moment x·f_z − z·f_x is the negative.
    """

    image: str = ""
    moment: str = ""
    joints: str = ""
    camera: str = ""
    pan: str = ""
    tilt: str = ""
    moment_axis: str = "y"


def is_bag(path: Path) -> bool:
    """Whether a path is meant for a bag: by its suffix, or a folder with a bag's metadata."""
    return path.suffix.lower() in SUFFIXES or os.path.isfile(path / "metadata.yaml")


def open_bag(path: Path, topics: Topics, camera_matrix: np.ndarray | None, image_size: tuple[int, int]) -> Source:
    """The pictures and readings of a bag, in the order in which they were logged.

    camera_matrix : (3, 3) of the rig's camera: one that CameraInfo shows to be another is refused.
    Raises InputError for a bag that cannot be read, has no pictures, or several topics to choose from.
    """
    if not os.path.isdir(path):
        require_file(path, "bag")
    highlevel = require_extra("rosbags.highlevel", "live")
    # bounded, which the reader's own YAML is not
    check_bag(path, read_yaml(path / "metadata.yaml") if os.path.isdir(path) else {})
    bound_unpacking()
    standard = _typestore(path)
    stack = ExitStack()
    try:
        reader = highlevel.AnyReader([path], default_typestore=standard)
        reader.open()
        stack.callback(_close, reader)
        kinds = {name: info.msgtype for name, info in reader.topics.items()}
        refuse_bombs(reader, path)
    except InputError:
        stack.close()
        raise
    except Exception as error:  # of a damaged file the reader lets anything through
        what = f"cannot be read as a bag ({type(error).__name__}: {clipped(str(error).partition(chr(10))[0])})"
        raise InputError(what, where=path, remedy="record or copy it again, or mend it (mcap recover)") from None
    taken = {role: _topic(path, role, getattr(topics, role), kinds) for role in _ROLES}
    if not taken["image"]:
        what = f"holds no pictures; its topics are {', '.join(sorted(kinds)) or 'none'}"
        raise InputError(what, where=path, remedy="sensor_msgs/Image or CompressedImage is needed")
    if topics.moment_axis != Topics.moment_axis and kinds.get(taken["moment"]) == _MOMENTS[1]:
        what = f"--moment-axis is of a WrenchStamped; {taken['moment']} is a Float64, which has no axes"
        raise InputError(what, where=path, remedy="leave it out, or choose a wrench: --topic moment=NAME")
    of_camera = [name for name, kind in kinds.items() if kind == _CAMERA]
    notes: list[str] = []
    channels = {"moment_Nm"} if taken["moment"] else set()
    channels |= {"pan_rad", "tilt_rad"} if taken["joints"] else set()
    wanted = {name: role for role, name in taken.items() if name}
    if camera_matrix is not None and topics.camera != "none":
        near = taken["image"].rpartition("/")[0]
        own = [name for name in of_camera if near.startswith(name.rpartition("/")[0])]
        wanted |= dict.fromkeys(own, "camera")
    connections = [each for each in reader.connections if each.topic in wanted]
    broken: Counter[str] = Counter()
    # by ROS' own definitions: those in the bag may say that a picture holds a billion of something
    deserialize = standard.deserialize_ros1 if path.suffix == ".bag" else standard.deserialize_cdr

    def messages() -> Messages:
        checked = False
        with stack:
            for connection, logged_ns, data in _whole(reader.messages(connections), path, notes):
                role, arrived_s = wanted[connection.topic], 1e-9 * logged_ns
                try:
                    message = deserialize(data, connection.msgtype)
                    if role == "camera" and not checked:
                        _check_camera(message, camera_matrix, image_size, path)
                        checked = True
                    elif role == "image":
                        yield Taken(stamp_s(message, arrived_s), picture_of(message), arrived_s, perf_counter())
                    elif role != "camera":
                        yield from readings_of(message, topics, arrived_s)
                except _NotThisRig:
                    raise
                except Exception as error:
                    broken[connection.topic] += 1
                    if broken[connection.topic] == 1:
                        notes.append(f"{connection.topic} holds messages that cannot be read ({clipped(str(error))})")

    return Source(path.name, messages, frozenset(channels), notes=notes)


def _close(reader: Any) -> None:
    with suppress(Exception):  # of a damaged bag it lets anything through here, too
        reader.close()


class _NotThisRig(InputError):
    """Pictures of another camera."""


def _typestore(path: Path) -> Any:
    """Of bags that hold no definitions: those of the last ROS that wrote such."""
    typesys = require_extra("rosbags.typesys", "live")
    stores = typesys.Stores
    return typesys.get_typestore(stores.ROS1_NOETIC if path.suffix == ".bag" else stores.ROS2_HUMBLE)


def _whole(messages: Iterator[Any], path: Path, notes: list[str]) -> Iterator[Any]:
    """The messages up to where the file is torn, if it is."""
    while True:
        try:
            yield next(messages)
        except StopIteration:
            return
        except InputError as error:
            raise InputError(f"{path.name}: {error}") from None
        except Exception as error:
            notes.append(f"{path.name} is torn ({type(error).__name__}): what comes after that is lost")
            return


def _topic(path: Path, role: str, named: str, kinds: Mapping[str, str | None]) -> str:
    """The topic of a role; "" where there is none. Raises InputError where it must be chosen."""
    fitting = sorted(name for name, kind in kinds.items() if kind in _ROLES[role])
    if named == "none":
        return ""
    if named:
        if named not in fitting:
            what = f"has no topic {named} for {role}"
            raise InputError(what, where=path, remedy=f"there are {', '.join(fitting) or 'none of that kind'}")
        return named
    if len(fitting) > 1:
        what = f"has several topics for {role}: {', '.join(fitting)}"
        raise InputError(what, where=path, remedy=f"choose: --topic {role}={fitting[0]}, or {role}=none")
    return fitting[0] if fitting else ""


def stamp_s(message: Any, arrived_s: float) -> float:
    """A message's own time, or when it was logged where it has none."""
    header = getattr(message, "header", None)
    time_s = 0.0 if header is None else header.stamp.sec + 1e-9 * header.stamp.nanosec
    return time_s or arrived_s


def picture_of(message: Any) -> np.ndarray:
    """(H, W) grey or (H, W, 3) blue, green, red, of an Image or CompressedImage. Raises InputError."""
    if hasattr(message, "format"):
        return read_picture(Path("picture"), bytes(message.data))
    encoding, height, width = message.encoding, message.height, message.width
    if encoding not in _LAYOUTS:
        raise InputError(f"the encoding is {encoding!r}", remedy=f"one of {', '.join(_LAYOUTS)} is needed")
    kind, count = _LAYOUTS[encoding]
    row = width * count * int(kind[1])
    data = np.frombuffer(message.data, np.uint8)
    if not 0 < row <= message.step or data.size != message.step * height or height == 0:
        raise InputError(f"{data.size} bytes are not {height} rows of {message.step}", remedy="record it again")
    rows = np.ascontiguousarray(data.reshape(height, message.step)[:, :row])
    pixels = rows.view(np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")).reshape(height, width, count)
    pixels = pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
    if encoding in _COLOURS or encoding in _BAYER:
        return np.asarray(cv2.cvtColor(pixels, (_COLOURS | _BAYER)[encoding]))
    return as_levels(pixels[..., 0] if count == 1 else pixels)


def readings_of(message: Any, topics: Topics, arrived_s: float) -> Iterator[Reading]:
    """What a WrenchStamped, Float64 or JointState says. Raises InputError where the joints must be named."""
    time_s = stamp_s(message, arrived_s)
    if hasattr(message, "wrench"):
        axis = topics.moment_axis
        moment_Nm = float(getattr(message.wrench.torque, axis.removeprefix("-")))
        yield Reading(time_s, "moment_Nm", -moment_Nm if axis.startswith("-") else moment_Nm, arrived_s)
    elif hasattr(message, "data"):
        yield Reading(time_s, "moment_Nm", float(message.data), arrived_s)
    else:
        for channel, named in (("pan_rad", topics.pan or "pan"), ("tilt_rad", topics.tilt or "tilt")):
            at = [i for i, name in enumerate(message.name) if name == named or (named in name and named in channel)]
            if len(at) != 1 or at[0] >= len(message.position):
                what = f"{len(at)} joints of {', '.join(map(str, message.name))} are called {named}"
                raise InputError(what, remedy=f"name it: --{channel.removesuffix('_rad')}-joint")
            yield Reading(time_s, channel, float(message.position[at[0]]), arrived_s)


def _check_camera(message: Any, matrix: np.ndarray | None, image_size: tuple[int, int], path: Path) -> None:
    """Raises InputError for a CameraInfo of another camera than the rig's."""
    assert matrix is not None
    if (message.width, message.height) != tuple(image_size):
        what = f"CameraInfo says {message.width}x{message.height} px, the rig {image_size[0]}x{image_size[1]}"
        raise _NotThisRig(what, where=path, remedy="use the camera and resolution of the calibration")
    focal = float(getattr(message, "k", getattr(message, "K", np.zeros(9)))[0])
    if focal > 0.0 and abs(focal / matrix[0, 0] - 1.0) > _FOCAL_SHARE:
        what = f"CameraInfo says a focal length of {focal:.1f} px, the rig {matrix[0, 0]:.1f}"
        raise _NotThisRig(what, where=path, remedy="is it the rig's camera, and its focus? if so, --topic camera=none")


@dataclass(frozen=True, eq=False)
class Logged:
    """A message to write: topic, ROS type, its fields by name, and when, ns."""

    topic: str
    kind: str
    fields: Mapping[str, Any]
    time_ns: int


class BagWriter:
    """Writes ROS messages into an .mcap file, a ROS 1 .bag, or the folder of a ROS 2 bag, by the path's suffix."""

    def __init__(self, path: Path) -> None:
        typesys = require_extra("rosbags.typesys", "live")
        self._ros1, self._mcap = path.suffix == ".bag", path.suffix == ".mcap"
        stores = typesys.Stores
        self._types = typesys.get_typestore(stores.ROS1_NOETIC if self._ros1 else stores.ROS2_HUMBLE)
        self._channels: dict[str, Any] = {}
        self._stack = ExitStack()
        if self._mcap:
            stream = self._stack.enter_context(path.open("wb"))
            self._writer = require_extra("mcap.writer", "live").Writer(stream)
            self._writer.start(profile="ros2", library="vbaa-calib")
        elif self._ros1:
            self._writer = self._stack.enter_context(require_extra("rosbags.rosbag1", "live").Writer(path))
        else:
            self._writer = self._stack.enter_context(require_extra("rosbags.rosbag2", "live").Writer(path, version=9))

    def write(self, logged: Logged) -> None:
        message = self._built(logged.kind, {**self._header(logged), **logged.fields})
        channel = self._channel(logged)
        if self._mcap:
            data = bytes(self._types.serialize_cdr(message, logged.kind))
            self._writer.add_message(channel, logged.time_ns, data, logged.time_ns)
        else:
            serialize = self._types.serialize_ros1 if self._ros1 else self._types.serialize_cdr
            self._writer.write(channel, logged.time_ns, serialize(message, logged.kind))

    def ready(self, kinds: Iterable[str]) -> None:
        """Make what writes messages of these kinds, which takes some 10 ms each, before the first one comes."""
        serialize = self._types.serialize_ros1 if self._ros1 else self._types.serialize_cdr
        for kind in kinds:
            serialize(self._built(kind, self._header(Logged("", kind, {}, 0))), kind)

    def flush(self) -> None:
        """So that a kill loses nothing of an .mcap so far; other bags can be read only when they are closed."""
        if self._mcap:
            self._writer.flush()

    def close(self) -> None:
        if self._mcap:
            self._writer.finish()
        self._stack.close()

    def _channel(self, logged: Logged) -> Any:
        if logged.topic not in self._channels:
            if self._mcap:
                text = self._types.generate_msgdef(logged.kind, ros_version=2)[0]
                schema = self._writer.register_schema(logged.kind, "ros2msg", text.encode())
                made = self._writer.register_channel(logged.topic, "cdr", schema)
            else:
                made = self._writer.add_connection(logged.topic, logged.kind, typestore=self._types)
            self._channels[logged.topic] = made
        return self._channels[logged.topic]

    def _header(self, logged: Logged) -> dict[str, Any]:
        if "header" not in dict(self._fields(logged.kind)):
            return {}
        stamp = {"sec": logged.time_ns // 10**9, "nanosec": logged.time_ns % 10**9}
        ros1 = {"seq": 0} if self._ros1 else {}
        return {"header": {**ros1, "stamp": stamp, "frame_id": ""}}

    def _fields(self, kind: str) -> Sequence[tuple[str, Any]]:
        return self._types.fielddefs[kind][1]

    def _built(self, kind: str, given: Mapping[str, Any]) -> Any:
        """A message; what is not given of it is zero or empty."""
        values = {}
        for name, (node, of) in self._fields(kind):
            value = given.get(name, given.get(name.lower()))
            if node.name == "NAME":
                values[name] = self._built(of, value or {})
            elif node.name == "BASE":
                zero = "" if of[0] == "string" else 0
                values[name] = zero if value is None else value
            else:
                values[name] = self._listed(node.name, of, value)
        return self._types.types[kind](**values)

    def _listed(self, node: str, of: Any, value: Any) -> Any:
        (inner, kind), length = of
        if inner.name == "NAME":
            return [self._built(kind, each) for each in value or ()]
        if kind[0] == "string":
            return list(value or ())
        zeros = np.zeros(length if node == "ARRAY" else 0, np.dtype(kind[0]))
        return zeros if value is None else np.asarray(value, kind[0])
