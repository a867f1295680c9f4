"""Readers of untrusted files, run in a process of their own with limits of time and memory.

A damaged or forged file can crash a C++ reader or keep it busy for ever, and Python's parser needs a hundred times the
file's size of memory: only the child process is lost then.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import json
import os
import re
import signal
import subprocess
import sys
import warnings
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

_SECONDS = 4.0
"""Limit of processor time for any file; it has a twentieth more per megabyte."""
_ERROR = "error"

Arrays = Mapping[str, np.ndarray]


def says_rectified(topic: str) -> bool:
    """Whether a topic's name is that of rectified pictures, such as image_rect and image_rect_color."""
    return re.search(r"(?:^|[/_])rect(?:ified)?(?:[/_]|$)", topic) is not None


def read_in_child(reader: Callable[[Path], Arrays], path: Path) -> dict[str, np.ndarray]:
    """The arrays that `reader(path)` returns, read in another process, which imports the reader's module.

    Raises
    ------
    ValueError : the reader failed, crashed, or took too much time or memory.
    """
    from vbaa_calib.core.files import most_memory  # which the child, that runs this file, has no need of

    files = path.iterdir() if path.is_dir() else [path]
    size = sum(each.stat().st_size for each in files if each.is_file())
    seconds = _SECONDS * (1.0 + 0.05 * size / 1e6)
    limits = f"{seconds:.0f}", str(most_memory(size))
    # as a script: with -m the whole package would be imported, which takes longer than any reading
    module = "" if reader.__module__ == __name__ else reader.__module__
    call = [sys.executable, "-P", __file__, module, reader.__name__, str(path.absolute()), *limits]
    places = os.pathsep.join(each or os.getcwd() for each in sys.path)
    try:
        # limit of the wall clock, in multiples of the processor's time
        done = subprocess.run(
            call,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": places},
            timeout=20.0 * seconds,
        )
    except subprocess.TimeoutExpired:
        raise ValueError(f"no end within {seconds:.0f} s") from None
    if done.returncode == -getattr(signal, "SIGXCPU", signal.SIGTERM):
        raise ValueError(f"no end within {seconds:.0f} s")
    if done.returncode != 0:
        raise ValueError("its reader crashed")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as loaded:
        found = dict(loaded)
    if _ERROR in found:
        raise ValueError(str(found[_ERROR]))
    return found


def read_storage(path: Path) -> dict[str, np.ndarray]:
    """The top-level numbers, as (), and matrices, two-dimensional, of a YAML, XML or JSON file; an .npz's arrays.

    Raises
    ------
    ValueError : OpenCV, or NumPy, cannot read it; in its words.
    """
    if path.read_bytes()[:2] == b"PK":
        return _arrays(path)
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    found = {}
    try:
        storage = cv2.FileStorage(path.read_text(encoding="utf-8-sig"), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        for key in root.keys() if root.isMap() else ():
            node = root.getNode(key)
            if node.isInt() or node.isReal():
                found[key] = np.array(node.real())
            matrix = node.mat() if node.isMap() else None
            if matrix is not None and matrix.size and matrix.ndim == 2:
                found[key] = matrix.astype(float)
    except (cv2.error, SystemError) as error:
        raise ValueError(str(getattr(error, "err", "") or error).strip().partition("\n")[0]) from None
    return found


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of up to a hundred numbers in an .npz.

    Raises
    ------
    ValueError : NumPy cannot read it.
    """
    found = {}
    try:
        with np.load(path, allow_pickle=False) as stored:
            for name in stored.files:
                with contextlib.suppress(ValueError):  # lists of poses are stored as Python's objects
                    array = stored[name]
                    if array.dtype.kind in "iuf" and array.size <= 100:
                        found[name] = array.astype(float)
    except (OSError, zipfile.BadZipFile, EOFError, zlib.error) as error:
        raise ValueError(f"{error}") from None
    return found


def read_literal(path: Path) -> dict[str, np.ndarray]:
    """The entries that describe a lens in a file that contains a Python mapping, each value as JSON.

    Raises
    ------
    ValueError : the file is no mapping, or holds values that JSON cannot express.
    """
    try:
        with warnings.catch_warnings(action="ignore"):  # of odd escapes in its strings
            data = ast.literal_eval(path.read_text(encoding="utf-8-sig"))
        if not isinstance(data, dict):
            raise ValueError("is no mapping")
        keys = ("lens_model", "lensmodel", "intrinsics", "extrinsics", "imagersize", "valid_intrinsics_region")
        return {key: np.array(json.dumps(data[key])) for key in keys if key in data}
    except (SyntaxError, TypeError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        raise ValueError(f"line {line} is no Python" if line else "is no Python literal") from None


def take_all_schemas() -> None:
    """Make rosbags open MCAP files with JSON or protobuf messages, too, without decoding these."""
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
    from rosbags.rosbag2 import storage_mcap

    of_ros: Any = storage_mcap.get_msgdef
    if of_ros.__module__ == __name__:
        return

    def definition(schema: Any) -> Any:
        foreign = schema is not None and schema.encoding in ("jsonschema", "protobuf")
        return MessageDefinition(MessageDefinitionFormat.NONE, "") if foreign else of_ros(schema)

    def text(stream: io.BytesIO) -> str:
        # what a record begins with is the file's profile: without one it is of no ROS, but its records are the same
        first = stream.tell() == 0
        found = storage_mcap.read_bytes(stream).decode(errors="replace")
        return "ros2" if first and found in ("", "json", "protobuf") else found

    vars(storage_mcap).update(get_msgdef=definition, read_string=text)


def read_bag_head(path: Path) -> dict[str, np.ndarray]:
    """Open a bag, to test whether that is possible; returns nothing.

    Raises
    ------
    Exception : rosbags cannot open it; for a damaged file of any type.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    take_all_schemas()
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)):
        return {}


def read_camera_infos(path: Path) -> dict[str, np.ndarray]:
    """The first message of each topic of CameraInfo in a bag: TOPIC.field → its value, roi as x, y, width, height;
    and as TOPIC.rectified the topics of rectified pictures next to it.

    Raises
    ------
    Exception : rosbags cannot read it; for a damaged file of any type.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[str, np.ndarray] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        of_cameras = [one for one in reader.connections if one.msgtype == "sensor_msgs/msg/CameraInfo"]
        for one in of_cameras:
            for connection, _, data in reader.messages([one]):
                message = reader.deserialize(data, connection.msgtype)
                fields = {name.lower(): getattr(message, name) for name in vars(message)}
                roi = fields.pop("roi")
                fields["roi"] = [roi.x_offset, roi.y_offset, roi.width, roi.height]
                del fields["header"]
                near = one.topic.rpartition("/")[0] + "/"
                fields["rectified"] = [name for name in reader.topics if name.startswith(near) and says_rectified(name)]
                found |= {f"{one.topic}.{name}": np.array(value) for name, value in fields.items()}
                break
    return found


def read_video_head(path: Path) -> dict[str, np.ndarray]:
    """`size`, (width, height) px, of a video, if its first frame can be read.

    Raises
    ------
    ValueError : FFmpeg cannot read it.
    """
    import cv2

    # each thread would count as memory
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    if not video.isOpened() or not video.grab():
        raise ValueError("cannot be read")
    return {"size": np.array([video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)])}


def _limit(seconds: int, memory: int) -> None:
    """Limit this process beyond what its libraries use; systems without limits have the parent's timeout."""
    try:
        import resource
    except ImportError:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    spent = int(used.ru_utime + used.ru_stime) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (spent + seconds, spent + seconds + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if sys.platform == "linux":
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        wanted = taken + memory
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard < 0 else min(wanted, hard), hard))


def _main(module: str, name: str, path: str, seconds: str, memory: str) -> None:
    reader = getattr(importlib.import_module(module), name) if module else globals()[name]
    if reader in (read_storage, read_video_head):
        importlib.import_module("cv2")  # not later: with the limits in force it could not be loaded
    _limit(int(seconds), int(memory))
    try:
        found = dict(reader(Path(path)))
    except MemoryError:
        found = {_ERROR: np.array("it asks for too much memory")}
    except Exception as error:
        found = {_ERROR: np.array(f"{error}"[:200] or type(error).__name__)}
    packed = io.BytesIO()
    np.savez(packed, allow_pickle=False, **found)
    sys.stdout.buffer.write(packed.getbuffer())
    sys.stdout.flush()


if __name__ == "__main__":
    _main(*sys.argv[1:])
