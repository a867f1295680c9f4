"""ROS 1 bags, ROS 2 bags and MCAP files, read and written without ROS."""

from __future__ import annotations

import base64
import bz2
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.convert.child import read_bag_head, read_in_child, says_rectified, take_all_schemas
from vbaa_calib.core.errors import InputError, clipped, quoted, require_extra
from vbaa_calib.core.files import is_bag, most_memory, read_yaml, require_file
from vbaa_calib.core.images import as_levels, read_picture
from vbaa_calib.session import READINGS

from .messages import MESSAGES, Messages, MessageSource, Reading, Taken

_REMEDY = "record it with chunks of some megabytes, as rosbag2 does"


def _check_bag(path: Path, metadata: dict[str, Any]) -> None:
    """Opens a bag in a process of its own, with limits of time and memory. metadata : of a bag that is a folder;
    empty for a file.

    Raises InputError for one that cannot be opened within them.
    """
    about = metadata.get("rosbag2_bagfile_information")
    try:
        if isinstance(about, dict) and str(about.get("compression_mode")).lower() == "file":
            _check_files(path, about["relative_file_paths"])
        read_in_child(read_bag_head, path)
    except InputError:
        raise
    except Exception as error:  # of a damaged file the readers let anything through
        remedy = "record or copy it again, or mend it (mcap recover)"
        what = f"cannot be read as a bag ({clipped(str(error).partition(chr(10))[0])})"
        raise InputError(what, where=path, remedy=remedy) from None


def _check_files(path: Path, names: Any) -> None:
    """Raises InputError for a bag of compressed files that unpack, onto the disk, to more than the limit."""
    zstd, unpacked, packed = _rosbags().mcap.zstd, 0, 0
    for file in {path / Path(str(name)).name for name in names}:
        if file.is_file():
            packed += file.stat().st_size
            with file.open("rb") as stream, zstd.open(stream, "rb") as opened:
                while piece := opened.read(1 << 20):
                    unpacked += len(piece)
                    if unpacked > most_memory(packed):
                        what = f"unpacks to more than {unpacked / 1e6:.0f} MB"
                        raise InputError(what, where=file, remedy="record it without --compression-mode file")


def _bound_unpacking() -> None:
    """Limit the size to which rosbags unpacks a chunk or message, from now on.

    It offers no other way: its functions are replaced by such as raise InputError.
    """
    take_all_schemas()
    rosbags = _rosbags()
    lz4, zstd = _bounded(rosbags.lz4.open), _bounded(rosbags.mcap.zstd.open)
    rosbags.bag.decompressors.update(bz2=_bounded(bz2.open), lz4=lz4)
    rosbags.mcap.DECOMPRESSORS.update(lz4=lz4, zstd=zstd)
    rosbags.folder.zstd = SimpleNamespace(open=rosbags.mcap.zstd.open, decompress=zstd)


def _rosbags() -> Any:
    import lz4.frame
    from rosbags.rosbag1 import reader as bag
    from rosbags.rosbag2 import reader as folder
    from rosbags.rosbag2 import storage_mcap as mcap

    return SimpleNamespace(lz4=lz4.frame, bag=bag, folder=folder, mcap=mcap)


def _bounded(opened: Callable[[BytesIO], Any]) -> Callable[..., bytes]:
    def unpacked(data: bytes, *_: int) -> bytes:
        most = MESSAGES.piece_bytes + MESSAGES.piece_factor * len(data)
        with opened(BytesIO(data)) as stream:
            raw: bytes = stream.read(most + 1)
        if len(raw) > most:
            raise InputError(f"{len(data)} bytes of it unpack to more than {most / 1e6:.0f} MB", remedy=_REMEDY)
        return raw

    return unpacked


def _refuse_bombs(reader: Any, path: Path) -> None:
    """Raises InputError for an opened bag that contains far more than its file's size: chunks of an MCAP file that
    are open at once, rows of a database that are computed or share their bytes."""
    whole = [one.storage for one in reader.readers if hasattr(one, "storage")]  # a file, or a folder of several
    for storage in (each for one in whole for each in getattr(one, "storages", [one])):
        size = storage.path.stat().st_size
        most = MESSAGES.piece_bytes + MESSAGES.piece_factor * size
        chunks = getattr(storage, "chunks", ())
        opens = [(chunk.message_start_time, -chunk.uncompressed_size) for chunk in chunks]
        closes = [(chunk.message_end_time, chunk.uncompressed_size) for chunk in chunks]
        largest = -min(accumulate(size for _, size in sorted(opens + closes)), default=0)
        if largest > most:
            what = f"unpacks to {largest / 1e6:.0f} MB at once"
            raise InputError(what, where=path, remedy=_REMEDY)
        if hasattr(storage, "dbconn"):
            ((stored,),) = storage.dbconn.execute("SELECT total(octet_length(data)) FROM messages")
            if stored > size:
                what = f"its messages have {stored / 1e6:.0f} MB, the file {size / 1e6:.3g} MB"
                raise InputError(what, where=path, remedy="it is damaged or forged: record it again")


_ROLES: dict[str, tuple[tuple[str, ...], ...]] = {
    "image": (
        ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
        ("foxglove_msgs/msg/CompressedImage", "foxglove.CompressedImage"),
    ),
    "moment": (
        ("geometry_msgs/msg/WrenchStamped", "std_msgs/msg/Float64"),
        ("geometry_msgs/msg/Wrench", "std_msgs/msg/Float32"),
    ),
    "joints": (("sensor_msgs/msg/JointState",),),
    "camera": (("sensor_msgs/msg/CameraInfo",),),
}
"""What a topic may be for → the types that are taken for it, the second group where a bag has none of the first."""
_ENCODINGS: dict[str, tuple[str, int, int | None]] = {
    **dict.fromkeys(("mono8", "8UC1"), ("u1", 1, None)),
    **dict.fromkeys(("mono16", "16UC1"), ("u2", 1, None)),
    **dict.fromkeys(("bgr8", "8UC3"), ("u1", 3, None)),
    **dict.fromkeys(("bgr16", "16UC3"), ("u2", 3, None)),
    **dict.fromkeys(("uyvy", "yuv422"), ("u1", 2, cv2.COLOR_YUV2BGR_UYVY)),
    **dict.fromkeys(("yuyv", "yuv422_yuy2"), ("u1", 2, cv2.COLOR_YUV2BGR_YUY2)),
    **{f"rgb{bits}": (kind, 3, cv2.COLOR_RGB2BGR) for bits, kind in ((8, "u1"), (16, "u2"))},
    **{f"rgba{bits}": (kind, 4, cv2.COLOR_RGBA2BGR) for bits, kind in ((8, "u1"), (16, "u2"))},
    **{f"bgra{bits}": (kind, 4, cv2.COLOR_BGRA2BGR) for bits, kind in ((8, "u1"), (16, "u2"))},
    # OpenCV names the pattern by its second row and column
    **{
        f"bayer_{name}{bits}": (kind, 1, code)
        for bits, kind in ((8, "u1"), (16, "u2"))
        for name, code in (
            ("rggb", cv2.COLOR_BayerBG2BGR),
            ("bggr", cv2.COLOR_BayerRG2BGR),
            ("gbrg", cv2.COLOR_BayerGR2BGR),
            ("grbg", cv2.COLOR_BayerGB2BGR),
        )
    },
    # a plane of brightness, then one of colour with half as many rows
    "nv12": ("u1", 1, cv2.COLOR_YUV2BGR_NV12),
    "nv21": ("u1", 1, cv2.COLOR_YUV2BGR_NV21),
    "32FC1": ("f4", 1, None),
}
"""ROS' name of an image's encoding: type and number of its channels, and OpenCV's conversion to blue, green, red."""


@dataclass(frozen=True)
class Topics:
    """The topics to read from a bag, and the fields in them; "" stands for the only topic of its kind.

    images : of several cameras, by name. pan, tilt : names of the joints. moment_axis : the component of a wrench's
    torque that is the moment, such as y or -y: of the right-handed torque about the antenna's y, the moment x·f_z −
    z·f_x is the negative. degrees : whether joints are in degrees, against ROS' rule. wrench : whether all components
    of a wrench are read.
    """

    image: str = ""
    moment: str = ""
    joints: str = ""
    camera: str = ""
    pan: str = ""
    tilt: str = ""
    moment_axis: str = "y"
    degrees: bool = False
    wrench: bool = False
    images: Mapping[str, str] = field(default_factory=dict)

    def check_cameras(self, cameras: Collection[str]) -> None:
        """Raises InputError for a topic named for another camera than these."""
        if unknown := [name for name in self.images if name not in cameras]:
            has = f"cameras {', '.join(cameras)}" if len(cameras) > 1 else "one camera, whose role is image"
            raise InputError(f"--topic is '{unknown[0]}={self.images[unknown[0]]}'", remedy=f"the rig has {has}")

    @staticmethod
    def of(named: Mapping[str, str], *, degrees: bool = False) -> Topics:
        """The topics from their names on the command line: topics, joints and axis."""
        values: dict[str, Any] = {**named, "degrees": degrees}
        return Topics(**values)


def open_bag(
    path: Path, topics: Topics, camera: Camera | Mapping[str, Camera] | None, offset_s: float | None = 0.0
) -> MessageSource:
    """The pictures and readings of a bag, in the order of logging.

    camera : the rig's, or several by name: one that CameraInfo or the topic's name shows to be another is refused. Of
    several, a camera's topic is the one with its name in between slashes, unless `topics` names it. offset_s : what
    will be added to the readings' times; None: it is to be estimated.
    Raises InputError for a bag that cannot be read, has no pictures, or several topics to choose from; while it is
    read, for joints that are not named or in degrees, pictures that cannot be decoded, and clocks that are far apart.
    """
    files = _bag_files(path)
    for each in files:
        if not os.path.isdir(each):
            require_file(each, "bag")
    highlevel = require_extra("rosbags.highlevel", "live")
    # bounded, which the reader's own YAML is not
    for each in files:
        _check_bag(each, read_yaml(each / "metadata.yaml") if os.path.isdir(each) else {})
    _bound_unpacking()
    standard = _typestore(files[0])
    stack = ExitStack()
    try:
        reader = highlevel.AnyReader(files, default_typestore=standard)
        reader.open()
        stack.callback(_close, reader)
        kinds = {name: info.msgtype for name, info in reader.topics.items()}
        _refuse_bombs(reader, path)
    except InputError:
        stack.close()
        raise
    except Exception as error:  # of a damaged file the reader lets anything through
        what = f"cannot be read as a bag ({type(error).__name__}: {clipped(str(error).partition(chr(10))[0])})"
        raise InputError(what, where=path, remedy="record or copy it again, or mend it (mcap recover)") from None
    cameras = dict(camera) if isinstance(camera, Mapping) else {"": camera}
    images = _image_topics(path, topics, cameras, kinds)
    taken = {role: _topic(path, role, getattr(topics, role), kinds) for role in ("moment", "joints")}
    of_moment = kinds.get(taken["moment"]) or ""
    if topics.moment_axis != Topics.moment_axis and of_moment.startswith("std_msgs"):
        number = of_moment.rpartition("/")[2]
        what = f"--moment-axis is of a WrenchStamped; {taken['moment']} is a {number}, which has no axes"
        raise InputError(what, where=path, remedy="leave it out, or choose a wrench: --topic moment=NAME")
    notes = _notes_on(taken, topics, kinds)
    if left := [name for name in cameras if name not in images.values()]:
        notes.append(f"{path.name} holds no pictures of {', '.join(left)}: name its topic, --topic {left[0]}=NAME")
    channels = {"moment_Nm"} if taken["moment"] else set()
    channels |= {"pan_rad", "tilt_rad"} if taken["joints"] else set()
    wanted = {name: role for role, name in taken.items() if name} | dict.fromkeys(images, "image")
    infos: dict[str, tuple[str, Camera]] = {}
    for topic, name in images.items() if topics.camera != "none" else ():
        if (own := cameras[name]) is None:
            continue
        _refuse_rectified(topic, own, path)
        near = topic.rpartition("/")[0]
        of_cameras = [name for name, kind in kinds.items() if kind in _ROLES["camera"][0]]
        infos |= {name: (topic, own) for name in of_cameras if near.startswith(name.rpartition("/")[0])}
    wanted |= dict.fromkeys(infos, "camera")
    connections = [each for each in reader.connections if each.topic in wanted]
    # by ROS' own definitions: those in the bag may say that a picture holds a billion of something
    ros = standard.deserialize_ros1 if files[0].suffix == ".bag" else standard.deserialize_cdr

    def parts(topic: str, message: Any, arrived_s: float) -> Iterator[Taken | Reading]:
        """The pictures and readings in a message. Raises InputError for one that cannot be read."""
        role = wanted[topic]
        if role == "image":
            at_s, image = stamp_s(message, arrived_s), picture_of(message)
            yield Taken(at_s, image, arrived_s, perf_counter(), camera=images[topic])
        elif role == "camera":
            _check_camera(message, *infos[topic], path)
        else:
            yield from readings_of(message, topics, arrived_s)

    def messages() -> Messages:
        good, broken, last, turns = Counter[str](), Counter[str](), dict[str, Exception](), 0
        lags: dict[str, list[float]] = {role: [] for role in _ROLES}
        with stack:
            for connection, logged_ns, data in _whole(reader.messages(connections), path, notes):
                topic, arrived_s = connection.topic, 1e-9 * logged_ns
                if wanted[topic] == "camera" and good[topic]:
                    continue
                try:
                    kind = connection.msgtype
                    message = _foxglove_picture(data, kind) if kind.startswith("foxglove.") else ros(data, kind)
                    found = list(parts(topic, message, arrived_s))
                except Exception as error:
                    if getattr(error, "where", None) == path:
                        raise
                    broken[topic] += 1
                    if broken[topic] == 1:
                        notes.append(f"{topic} holds messages that cannot be read ({clipped(str(error))})")
                    if broken[topic] == MESSAGES.patience and wanted[topic] in ("image", "joints") and not good[topic]:
                        raise _unreadable(topic, wanted[topic], error, path) from None
                    last[topic] = error
                    continue
                good[topic] += 1
                far = [each for each in found if isinstance(each, Reading) and not each.possible]
                turns += wanted[topic] == "joints" and bool(far)
                if turns == 3 and far:
                    raise _in_degrees(topic, far[0], path)
                lags_s = lags[wanted[topic]]
                if offset_s is not None and found and len(lags_s) < 5:
                    lags_s.append(found[0].time_s - arrived_s)
                    _refuse_two_clocks(lags, offset_s, path)
                yield from found
            for topic, fault in last.items():
                if wanted[topic] in ("image", "joints") and not good[topic]:
                    raise _unreadable(topic, wanted[topic], fault, path)

    return MessageSource(path.name, messages, frozenset(channels), notes=notes)


def _image_topics(
    path: Path, topics: Topics, cameras: Mapping[str, Camera | None], kinds: Mapping[str, str | None]
) -> dict[str, str]:
    """Topic of pictures → its camera's name, "" for the only one. Raises InputError where there is none, or no
    unique one."""
    topics.check_cameras(cameras)
    named = dict(topics.images)
    if len(cameras) > 1 and not topics.image:
        groups = [sorted(name for name, kind in kinds.items() if kind in group) for group in _ROLES["image"]]
        for name in cameras.keys() - named.keys():
            own = [topic for topic in next(filter(None, groups), []) if name in topic.split("/")]
            named |= {name: own[0]} if len(own) == 1 else {}
    first = next(iter(cameras))
    found = {topic: name for name, each in named.items() if (topic := _topic(path, "image", each, kinds))}
    if not found and (topic := _topic(path, "image", topics.image, kinds)):
        found[topic] = first
    if not found:
        what = f"holds no pictures; its topics are {', '.join(sorted(kinds)) or 'none'}"
        raise InputError(what, where=path, remedy="sensor_msgs/Image or CompressedImage is needed")
    return {topic: found[topic] for topic in sorted(found, key=lambda topic: list(cameras).index(found[topic]))}


def _unreadable(topic: str, role: str, error: Exception, path: Path) -> InputError:
    """The error for a topic of which no message can be read."""
    what, remedy = getattr(error, "what", str(error)), getattr(error, "remedy", None)
    if role == "image":
        remedy = remedy or "record them as Image, or as CompressedImage of JPEG or PNG"
        return InputError(f"none of the pictures of {topic} can be decoded: {clipped(what)}", where=path, remedy=remedy)
    return InputError(f"{topic}: {clipped(what)}", where=path, remedy=remedy)


def _in_degrees(topic: str, far: Reading, path: Path) -> InputError:
    """The error for a joint angle of more than a turn."""
    what = f"{topic} has {far.channel.removesuffix('_rad')} at {far.value:g} rad, more than a turn: in degrees?"
    return InputError(what, where=path, remedy="give --degrees if they are, or name other joints (--pan-joint)")


def _refuse_two_clocks(lags: Mapping[str, Sequence[float]], offset_s: float, path: Path) -> None:
    """Raises InputError where the first stamps of readings and of pictures, relative to their logging times, are far
    apart."""
    for role, words in (("moment", "the moments"), ("joints", "the joints")):
        if min(len(lags["image"]), len(lags[role])) < 5:
            continue
        ahead_s = float(np.median(lags["image"]) - np.median(lags[role]))
        if abs(ahead_s - offset_s) > MESSAGES.one_clock_s:
            side = "before" if ahead_s > 0.0 else "after"
            what = (
                f"{words} are stamped {abs(ahead_s):.6g} s {side} the pictures that were logged with them: two clocks"
            )
            remedy = f"give --clock-offset {ahead_s:.6g} to add that to their times, or --clock-offset estimate"
            raise InputError(what, where=path, remedy=remedy)


def _refuse_rectified(topic: str, camera: Camera, path: Path) -> None:
    """Raises InputError for a topic of rectified pictures where the rig's lens has distortion."""
    bends_px = _bend_px(camera)
    if says_rectified(topic) and bends_px > MESSAGES.straight_px:
        what = f"{topic} is of rectified pictures, the rig's lens that of raw ones: it bends by up to {bends_px:.0f} px"
        raise InputError(what, where=path, remedy=_raw_remedy("the name misleads"))


def _raw_remedy(unless: str) -> str:
    return f"take the raw pictures' topic, or calibrate with rectified ones; if {unless}, give --topic camera=none"


def _bend_px(camera: Camera) -> float:
    """Largest displacement in the picture, px, by a lens's distortion."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0.0, width - 1.0, 17), np.linspace(0.0, height - 1.0, 13))
    pixels = np.stack([u, v], axis=-1)
    points, valid = camera.unproject_normalized(pixels)
    straight = points * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    return float(np.linalg.norm(straight - pixels, axis=-1)[valid].max(initial=0.0))


def _close(reader: Any) -> None:
    with suppress(Exception):  # of a damaged bag it lets anything through here, too
        reader.close()


def _typestore(path: Path) -> Any:
    """Message definitions for bags that contain none: those of the last ROS version that wrote such bags, and
    Foxglove's picture."""
    typesys = require_extra("rosbags.typesys", "live")
    stores = typesys.Stores
    if path.suffix == ".bag":
        return typesys.get_typestore(stores.ROS1_NOETIC)
    store, name = typesys.get_typestore(stores.ROS2_HUMBLE), "foxglove_msgs/msg/CompressedImage"
    fields = "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n"
    store.register(typesys.get_types_from_msg(fields, name))
    return store


def _whole(messages: Iterator[Any], path: Path, notes: list[str]) -> Iterator[Any]:
    """The messages up to the place where a file is truncated, if it is."""
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


def _bag_files(path: Path) -> list[Path]:
    """The bag itself, or the files of a ROS 2 bag's folder without metadata.yaml."""
    if not os.path.isdir(path) or os.path.isfile(path / "metadata.yaml"):
        return [path]
    return sorted((each for each in path.iterdir() if is_bag(each)), key=lambda each: (len(each.name), each.name))


def _topic(path: Path, role: str, named: str, kinds: Mapping[str, str | None]) -> str:
    """The topic of a role; "" where there is none. Raises InputError where there are several and none is named."""
    groups = [sorted(name for name, kind in kinds.items() if kind in group) for group in _ROLES[role]]
    if named == "none":
        return ""
    if named:
        every = [name for fitting in groups for name in fitting]
        if named not in every:
            what = f"has no topic {named} for {role}"
            raise InputError(what, where=path, remedy=f"there are {', '.join(every) or 'none of that kind'}")
        return named
    fitting = next(filter(None, groups), [])
    if len(fitting) > 1:
        what = f"has several topics for {role}: {', '.join(fitting)}"
        raise InputError(what, where=path, remedy=f"choose: --topic {role}={fitting[0]}, or {role}=none")
    return fitting[0] if fitting else ""


def _notes_on(taken: Mapping[str, str], topics: Topics, kinds: Mapping[str, str | None]) -> list[str]:
    """Notes on the topics before they are read."""
    kind = kinds.get(taken["moment"]) or ""
    if kind in _ROLES["moment"][1]:
        return [f"the moment is that of {taken['moment']} ({kind}), stamped when it was logged"]
    if taken["moment"] or topics.moment == "none":
        return []
    known = ", ".join(each.rpartition("/")[2] for group in _ROLES["moment"] for each in group)
    others = [f"{name} ({kinds[name]})" for name in sorted(kinds) if name not in taken.values()]
    return [f"no moment is read: none of the bag's other topics, {', '.join(others) or 'none'}, is {known}"]


def stamp_s(message: Any, arrived_s: float) -> float:
    """A message's own time, or its logging time where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", getattr(message, "timestamp", None))
    return (0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec) or arrived_s


def picture_of(message: Any) -> np.ndarray:
    """(H, W) grey or (H, W, 3) blue, green, red, of an Image or CompressedImage. Raises InputError."""
    if hasattr(message, "format"):
        try:
            return read_picture(Path("picture"), bytes(message.data))
        except InputError as error:
            raise InputError(f"format {quoted(message.format)}: {error.what}", remedy=error.remedy) from None
    encoding, height, width = message.encoding, message.height, message.width
    if encoding not in _ENCODINGS:
        raise InputError(f"the encoding is {encoding!r}", remedy=f"one of {', '.join(_ENCODINGS)} is needed")
    kind, count, conversion = _ENCODINGS[encoding]
    rows = height * 3 // 2 if encoding.startswith("nv") else height
    row = width * count * int(kind[1])
    data = np.frombuffer(message.data, np.uint8)
    if not 0 < row <= message.step or data.size != message.step * rows or height == 0:
        raise InputError(f"{data.size} bytes are not {rows} rows of {message.step}", remedy="record it again")
    packed = np.ascontiguousarray(data.reshape(rows, message.step)[:, :row])
    pixels = packed.view(np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")).reshape(rows, width, count)
    pixels = pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
    if conversion is not None:
        try:
            pixels = np.asarray(cv2.cvtColor(pixels, conversion))
        except cv2.error:
            what = f"OpenCV cannot convert {encoding} of {width}x{height} px"
            raise InputError(what, remedy="record it with even sides") from None
    if kind == "f4":
        return _levels_of_floats(pixels[..., 0])
    return as_levels(pixels[..., 0] if pixels.shape[2:] == (1,) else pixels)


def _levels_of_floats(pixels: np.ndarray) -> np.ndarray:
    """Grey levels from floats: 0 to 255 unchanged, 0 to 1 times 255. Raises InputError for others, such as depths."""
    least, most = (float(pixels.min()), float(pixels.max())) if np.isfinite(pixels).all() else (np.nan, np.nan)
    if not 0.0 <= least <= most <= 255.0:
        what = f"its pixels are from {least:g} to {most:g}"
        raise InputError(what, remedy="levels from 0 to 1 or 255 are needed; is it a picture of depths?")
    return pixels * (255.0 if most <= 1.0 else 1.0)


def _foxglove_picture(data: bytes, kind: str) -> Any:
    """Time, format and bytes of a foxglove.CompressedImage in JSON or protobuf, in the form of ROS's message.

    Raises InputError for what is neither.
    """
    if kind != "foxglove.CompressedImage":
        raise InputError(f"the type is {kind}", remedy="CompressedImage is read")
    try:
        fields = _json_fields(data) if data[:1] == b"{" else _protobuf_fields(data)
        sec, nanosec, name, content = fields
    except (ValueError, KeyError, IndexError, TypeError, RecursionError):
        raise InputError("is neither JSON nor protobuf of foxglove.CompressedImage", remedy="record it again") from None
    header = SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec))
    return SimpleNamespace(header=header, format=name, data=content)


def _json_fields(data: bytes) -> tuple[int, int, str, bytes]:
    header = json.loads(data)
    stamp = header["timestamp"]
    return int(stamp["sec"]), int(stamp["nsec"]), str(header["format"]), base64.b64decode(header["data"], validate=True)


def _protobuf_fields(data: bytes) -> tuple[int, int, str, bytes]:
    """The fields of foxglove/CompressedImage.proto: timestamp 1 (seconds 1, nanos 2), data 2, format 3, frame_id 4."""
    fields = _protobuf(data)
    stamp = _protobuf(fields.get(1, b""))
    return stamp.get(1, 0), stamp.get(2, 0), fields.get(3, b"").decode(), fields[2]


def _protobuf(data: bytes) -> dict[int, Any]:
    """The fields of a protobuf message: number → whole number or bytes. Raises ValueError or IndexError for invalid
    data."""
    fields: dict[int, Any] = {}
    at = 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte, at = data[at], at + 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value
            if shift > 63:
                raise ValueError("a number without end")

    while at < len(data):
        key = number()
        if key & 7 == 0:
            fields[key >> 3] = number()
            continue
        length = {1: 8, 5: 4}.get(key & 7) or number()
        if key & 7 not in (1, 2, 5) or at + length > len(data):
            raise ValueError("no field")
        fields[key >> 3], at = data[at : at + length], at + length
    return fields


def readings_of(message: Any, topics: Topics, arrived_s: float) -> Iterator[Reading]:
    """The readings in a wrench, a number or a JointState. Raises InputError where the joints must be named."""
    time_s = stamp_s(message, arrived_s)
    wrench = getattr(message, "wrench", message)
    if hasattr(wrench, "torque"):
        axis = topics.moment_axis
        moment_Nm = float(getattr(wrench.torque, axis.removeprefix("-")))
        yield Reading(time_s, "moment_Nm", -moment_Nm if axis.startswith("-") else moment_Nm, arrived_s)
        if topics.wrench:
            parts = {"m": wrench.torque, "f": wrench.force}
            for name, channel in list(READINGS.items())[1:]:
                yield Reading(time_s, channel, float(getattr(parts[name[0]], name[1])), arrived_s)
    elif hasattr(message, "data"):
        yield Reading(time_s, "moment_Nm", float(message.data), arrived_s)
    else:
        for channel, named in (("pan_rad", topics.pan or "pan"), ("tilt_rad", topics.tilt or "tilt")):
            at = [i for i, name in enumerate(message.name) if name == named or (named in name and named in channel)]
            if len(at) != 1 or at[0] >= len(message.position):
                what = f"{len(at)} joints of {', '.join(map(str, message.name))} are called {named}"
                raise InputError(what, remedy="name two of them: --pan-joint NAME --tilt-joint NAME")
            angle = float(message.position[at[0]])
            yield Reading(time_s, channel, math.radians(angle) if topics.degrees else angle, arrived_s)


def _check_camera(message: Any, topic: str, camera: Camera, path: Path) -> None:
    """Raises InputError for a CameraInfo of another camera than the rig's, or of another kind of pictures.

    topic : of the pictures. Of raw ones k and d are the lens, of rectified ones p, without distortion.
    """
    size, own = camera.image_size, float(camera.matrix[0, 0])
    if (message.width, message.height) != tuple(size):
        what = f"CameraInfo says {message.width}x{message.height} px, the rig {size[0]}x{size[1]}"
        raise InputError(what, where=path, remedy="use the camera and resolution of the calibration")
    k, p, d = (np.asarray(getattr(message, name, getattr(message, name.upper(), ()))) for name in "kpd")
    if k.size != 9 or not k[0] > 0.0:
        return
    raw, bends_px = float(k[0]), _bend_px(camera)
    rectified = float(p[0]) if p.size == 12 and p[0] > 0.0 else raw
    fisheye = str(getattr(message, "distortion_model", "")) in ("equidistant", "fisheye")
    k_bends_px = 0.0
    with suppress(InputError):  # numbers that are no lens
        k_bends_px = _bend_px(Camera("fisheye" if fisheye else "opencv", size, k.reshape(3, 3), d)) if d.any() else 0.0
    both = f"CameraInfo's K, fx {raw:.1f} px and bent by up to {k_bends_px:.0f} px, is of raw pictures (image_raw), "
    both += f"its P, fx {rectified:.1f} px, of rectified ones (image_rect)"
    unlike = abs(own / (rectified if says_rectified(topic) else raw) - 1.0) > MESSAGES.focal_share
    if d.size and not d.any() and bends_px > MESSAGES.straight_px:
        what = f"CameraInfo says no distortion, as of rectified pictures; the rig's lens bends by {bends_px:.0f} px"
        raise InputError(what, where=path, remedy=_raw_remedy("CameraInfo is wrong"))
    if not says_rectified(topic) and k_bends_px > bends_px + MESSAGES.straight_px and bends_px < MESSAGES.straight_px:
        what = f"{both}; the rig's lens, fx {own:.1f} px, is straight, and {topic} does not say that it is rectified"
        raise InputError(what, where=path, remedy="give --topic camera=none if it is, else calibrate from raw ones")
    if unlike:
        what = f"CameraInfo says a focal length of {raw:.1f} px, the rig {own:.1f}"
        if abs(rectified / raw - 1.0) > 1e-6:
            kind = "rectified" if says_rectified(topic) else "raw"
            what = f"{both}: {topic} counts as {kind}, and the rig has a focal length of {own:.1f} px"
        raise InputError(what, where=path, remedy="is it the rig's camera, and its focus? if so, --topic camera=none")


@dataclass(frozen=True, eq=False)
class Logged:
    """A message to write: topic, ROS type, fields by name, and time, ns."""

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
        """Prepare the writing of messages of these types, which takes some 10 ms each, before the first one comes."""
        serialize = self._types.serialize_ros1 if self._ros1 else self._types.serialize_cdr
        for kind in kinds:
            serialize(self._built(kind, self._header(Logged("", kind, {}, 0))), kind)

    def flush(self) -> None:
        """Write to the disk so that a kill loses nothing of an .mcap so far; other bags are readable only once
        closed."""
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

    def _built(self, kind: str, fields: Mapping[str, Any]) -> Any:
        """A ROS message; missing fields are zero or empty."""
        values = {}
        for name, (node, of) in self._fields(kind):
            value = fields.get(name, fields.get(name.lower()))
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
