"""Files changed at random, and every reader of ours on them: it returns, or raises InputError, within bounds.

`python -m tests.fuzz.fuzz --runs 1000000 --report fuzz.md` (`make fuzz`) keeps what broke a reader in `seeds/`, in the
reader's folder; `test_fuzz` runs those again, and a thousand new ones.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import tempfile
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from estimator.table.files import read_contacts
from vbaa_calib import Camera, Rig
from vbaa_calib.calibrate.antenna.stiffness import read_deflections
from vbaa_calib.calibrate.given_lens import read_lens
from vbaa_calib.calibrate.pose.robot_tables import read_corners, read_robot_poses
from vbaa_calib.convert import FORMATS
from vbaa_calib.convert.values import Wanted
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json, read_yaml, with_lines
from vbaa_calib.core.images import read_gray
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.session import centrelines_of, load_session, read_recording
from vbaa_calib.session.centrelines import read_centrelines
from vbaa_calib.session.tables import read_loads, read_noload, read_sweep
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.streams.bags import BagWriter, Logged, Topics, open_bag
from vbaa_calib.streams.devices import _datagrams as messages_of
from vbaa_calib.streams.recorded import _csv_readings, _open_lines, _open_table, _open_video
from vbaa_calib.wizard.questions import ReadingsTable
from vbaa_calib.wizard.store import _Journal
from viz.batch.recordings import recordings_of
from viz.batch.results import SCHEMA, Results
from viz.cli.calibrate import _dated
from viz.scene.truth import true_contacts, true_object

from ..hostile.case import TooLong, bounded
from ..hostile.conftest import good_files

SEEDS = Path(__file__).with_name("seeds")
LONGEST_S = 5.0
"""Of processor time, for one file."""


@dataclass(frozen=True)
class Reader:
    """A reader, the file that is changed, relative to the folder of good ones, and how seldom it runs.

    A reader that starts a process takes half a second: it runs once where others run `seldom` times.
    """

    name: str
    file: str
    read: Callable[[Path], Any]
    seldom: int = 1


def _of(path: Path, read: Callable[[Any], Any]) -> Any:
    return read(load_session(path.parent.parent))


def _all_of(items: Iterable[Any]) -> None:
    for _ in items:
        pass


def _every_centreline(lines: Any) -> None:
    _all_of(lines.values())


def _every_message(source: Any) -> None:
    """Three hundred at most: a table may name the same picture thousands of times, and each is read anew."""
    _all_of(islice(source.messages(), 300))


def _bag(path: Path) -> None:
    """A file, or the folder that it lies in."""
    whole = path.parent if (path.parent / "metadata.yaml").exists() else path
    _every_message(open_bag(whole, Topics(), Camera("opencv", (480, 360), np.diag([500.0, 500.0, 1.0]), np.zeros(0))))


def _lines(path: Path) -> None:
    with path.open("rb") as stream:
        _every_message(_open_lines(stream, 0.1, path.parent))


class _Datagrams:
    """In place of a socket: each paragraph of a file comes as one datagram."""

    def __init__(self, path: Path) -> None:
        self._several = path.read_bytes().split(b"\n\n")

    def recvmsg(self, most: int, _: int) -> tuple[bytes, list[tuple[int, int, bytes]], int, None]:
        if not self._several:
            raise BlockingIOError
        return self._several.pop(0)[:most], [], 0, None


def _datagrams(path: Path) -> None:
    received = messages_of(_Datagrams(path), [])  # type: ignore[arg-type]
    _all_of(iter(partial(next, received), None))


def _truth(path: Path) -> None:
    truth = read_json(path)
    true_contacts(read_contacts(path.with_name("contacts.csv")), truth, path)
    true_object(truth, path)


def _results(path: Path) -> None:
    """A batch's folder, or its one recording's contacts, which may be asked for what they were made of."""
    results = Results(path.parent if path.name == "batch.json" else path.parents[2])
    results.prepare([])
    results.write_summary([])
    results.summary.unlink()


def _session(path: Path) -> None:
    found = load_session(path.parent)
    assert np.isfinite([found.antenna.stiffness_Nm2, *found.gravity_world_m_s2]).all()


READERS = (
    Reader("session", "session/session.yaml", _session),
    Reader("board", "board.yaml", load_board),
    Reader("scene", "scene.yaml", load_scene, seldom=2),
    Reader("rig", "rig.json", Rig.load),
    Reader("camera", "camera.json", Camera.load),
    Reader("wizard", "store/wizard.json", _Journal.read),
    Reader("contacts", "contacts.csv", read_contacts),
    Reader("parquet", "contacts.parquet", read_contacts),
    Reader("recording", "session/recording/recording.csv", lambda path: _of(path, read_recording)),
    Reader("noload", "session/noload/noload.csv", lambda path: _of(path, read_noload)),
    Reader("loads", "session/loads/loads.csv", lambda path: _of(path, read_loads)),
    Reader("sweep", "swept/sweep/sweep.csv", lambda path: _of(path, read_sweep)),
    Reader(
        "centrelines",
        "lined/recording/centrelines.csv",
        lambda path: _of(path, lambda its: _every_centreline(read_centrelines(its))),
        seldom=2,
    ),
    Reader("deflections", "stiffness.csv", lambda path: read_deflections(path, 1.0, 0.2)),
    Reader("poses", "poses.csv", read_robot_poses),
    Reader("corners", "corners.csv", lambda path: read_corners(path, (480, 360), 88)),
    Reader("readings", "readings.csv", ReadingsTable.read),
    Reader("answers", "answers.yaml", read_yaml),
    Reader("truth", "truth.json", _truth),
    Reader("picture", "free.png", read_gray),
    Reader("ros", "ros.txt", FORMATS["ros"].read),
    Reader("kalibr", "kalibr.txt", lambda path: FORMATS["kalibr"].read(path, Wanted("cam0"))),
    Reader("colmap", "colmap.txt", lambda path: FORMATS["colmap"].read(path, Wanted("3"))),
    Reader("opencv", "opencv.txt", FORMATS["opencv"].read, seldom=50),
    Reader("mrcal", "mrcal.txt", FORMATS["mrcal"].read, seldom=50),
    *(Reader(name, f"{name}.txt", FORMATS[name].read) for name in ("numbers", "orbslam", "cahvor")),
    Reader("lens", "camera.json", read_lens),
    Reader(
        "tracked", "lined/recording/centrelines.csv", lambda path: _every_centreline(centrelines_of(path)), seldom=2
    ),
    Reader("mcap", "stream.mcap", _bag, seldom=50),
    Reader("bag", "stream.bag", _bag, seldom=50),
    Reader("bag_metadata", "stream/metadata.yaml", _bag, seldom=50),
    Reader("bag_database", "stream/stream.db3", _bag, seldom=50),
    Reader("stream_readings", "stream.csv", lambda path: _all_of(_csv_readings(path)[1])),
    Reader("stream_table", "stream_pictures.csv", lambda path: _every_message(_open_table(path))),
    Reader("lines", "stream.jsonl", _lines),
    Reader("datagrams", "datagrams.txt", _datagrams),
    Reader("video", "stream.avi", lambda path: _every_message(_open_video(path)), seldom=50),
    Reader("batch_list", "list.csv", lambda path: recordings_of([str(path)], path.with_name("rig.json"))),
    Reader("fleet", "fleet.csv", lambda path: _dated([path])),
    Reader("batch", "results/batch.json", _results),
    Reader("results", "results/contacts/recording=a/contacts.parquet", _results),
)

_TOKENS = (
    *(b"NaN", b"-Infinity", b"1e400", b"-1", b"0", b"1e-320", b"9" * 400, b"0x" + b"f" * 40, b"1_0", b"1:30", b"null"),
    *(
        b"true",
        b"''",
        b"[]",
        b"{}",
        b"[[[[[[[[",
        b"{a: &x [*x]}",
        b"!!python/object:os.system",
        b"!!binary a",
        b"<<: *a",
    ),
    *(b",", b";", b"\t", b"\n", b"\r", b'"', b"\0", b"\xff\xfe", b"\xef\xbb\xbf", "ü".encode(), b"%YAML 9.9", b"---"),
    *(b"1" * 5000, b"-", b"#", b"/dev/zero", b"../../../etc/passwd", b"\x7f\xff\xff\xff", b"\xff\xff\xff\xff"),
)
_ODD: tuple[Any, ...] = (
    *(None, True, -1, 0, 0.5, 1e-300, 1e300, 10**400, -(2**63), "", "x", "nan", [], {}, [0], {"a": 1}),
    *([0.0] * 3, [[0.0] * 3] * 3, [1e300] * 3, "9" * 400, {"schema": "x"}, ["x"] * 50),
)
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")


def add_streams(folder: Path) -> Path:
    """Recorded streams of the session that is among the good files of this folder, beside them."""
    pictures = [cv2.imread(str(path)) for path in sorted((folder / "session" / "recording").glob("*.png"))]
    video = cv2.VideoWriter(str(folder / "stream.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, pictures[0].shape[1::-1])
    writers = {name: BagWriter(folder / name) for name in ("stream.mcap", "stream.bag", "stream")}
    for number, picture in enumerate(pictures, 1):
        video.write(picture)
        small = np.ascontiguousarray(picture[::8, ::8, 0])
        raw = {"height": small.shape[0], "width": small.shape[1], "encoding": "mono8", "step": small.shape[1]}
        packed = {"format": "png", "data": cv2.imencode(".png", small)[1].ravel()}
        for name, writer in writers.items():
            image = ("CompressedImage", packed) if name == "stream.mcap" else ("Image", raw | {"data": small.ravel()})
            for kind, fields in (
                (f"sensor_msgs/msg/{image[0]}", image[1]),
                ("geometry_msgs/msg/WrenchStamped", {"wrench": {"torque": {"y": 0.001}}}),
                ("sensor_msgs/msg/JointState", {"name": ["pan", "tilt"], "position": [0.1, 0.2]}),
            ):
                writer.write(Logged(f"/{kind.rpartition('/')[2]}", kind, fields, 10**9 * number))
    for writer in writers.values():
        writer.close()
    video.release()
    (folder / "stream.csv").write_text("time_s,moment_Nm,pan_deg\n1,0.001,3\n1.1,,4\n1.2,0.002,\n")
    (folder / "stream_pictures.csv").write_text("time_s,image\n1,free.png\n2,jig.png\n")
    lines = '{"time_s": 1.5, "moment_Nm": 0.004, "image": "free.png"}\n{"time_s": 1.6, "pan_rad": 0.1}\n'
    (folder / "stream.jsonl").write_text(lines + '{"image": "data:image/png;base64,iVBORw0KGgo="}\n')
    (folder / "datagrams.txt").write_text(lines + "\n" + '{"tilt_rad": 0.1}\n')
    (folder / "list.csv").write_text("recording,rig,name\nsession,rig.json,mine\nlined,,\n")
    (folder / "fleet.csv").write_text("session,date\nsession,2026-01-01\nswept,2026-02-01T10:30\n")
    contacts = Results(folder / "results").contacts("a")
    contacts.parent.mkdir(parents=True)
    shutil.copy(folder / "contacts.parquet", contacts)
    (folder / "results" / "batch.json").write_text(json.dumps({"schema": SCHEMA, "command": []}))
    return folder


def mutated(data: bytes, path: str, rng: np.random.Generator) -> bytes:
    """The file changed at one to four places."""
    for _ in range(int(rng.integers(1, 5))):
        change = _in_structure if path.endswith((".yaml", ".json")) and rng.random() < 0.4 else _in_bytes
        data = change(data, path, rng)
    return data


def _in_bytes(data: bytes, _: str, rng: np.random.Generator) -> bytes:
    at, token = int(rng.integers(len(data) + 1)), _TOKENS[rng.integers(len(_TOKENS))]
    end = min(len(data), at + int(rng.geometric(0.02)))
    lines = data.split(b"\n")
    row = int(rng.integers(len(lines)))
    numbers = list(_NUMBER.finditer(data, at, at + 2000))
    kind = int(rng.integers(9))
    if kind == 0 and data:
        place = at % len(data)
        return data[:place] + bytes([data[place] ^ (1 << int(rng.integers(8)))]) + data[place + 1 :]
    if kind == 1:
        return data[:at] + data[end:]
    if kind == 2:
        return data[:at] + token + data[at:]
    if kind == 3:
        return data[:at] + token + data[end:]
    if kind == 4:
        return data[:at]
    if kind == 5:
        return data[:at] + data[at:end] * int(rng.integers(2, 200)) + data[end:]
    if kind == 6 and numbers:
        found = numbers[int(rng.integers(len(numbers)))]
        return data[: found.start()] + token + data[found.end() :]
    if kind == 7:
        return b"\n".join([*lines[:row], *[lines[row]] * int(rng.integers(0, 4)), *lines[row + 1 :]])
    return data[:at] + rng.bytes(int(rng.integers(1, 9))) + data[end:]


def _in_structure(data: bytes, path: str, rng: np.random.Generator) -> bytes:
    """One value of a YAML or JSON file replaced, removed or given another name; unchanged where it is none any more."""
    try:
        whole = json.loads(data) if path.endswith(".json") else with_lines(data.decode())[0]
    except (ValueError, ArithmeticError, AttributeError, LookupError, TypeError, yaml.YAMLError, RecursionError):
        return data
    place = whole
    for _ in range(6):
        keys = list(place) if isinstance(place, dict) else range(len(place)) if isinstance(place, list) else []
        if not len(keys):
            return data
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(place[key], dict | list) and place[key] and rng.random() < 0.7:
            place = place[key]
            continue
        kind, odd = int(rng.integers(4)), _ODD[rng.integers(len(_ODD))]
        if kind == 0:
            del place[key]
        elif kind == 1 and isinstance(place, dict):
            place[f"{key}x"] = place.pop(key)
        elif kind == 2 and isinstance(place[key], int | float) and abs(place[key]) < 1e290:
            place[key] = float(place[key]) * 10.0 ** int(rng.integers(-9, 10))
        else:
            place[key] = odd
        break
    with contextlib.suppress(ValueError, yaml.YAMLError):
        return (json.dumps(whole) if path.endswith(".json") else yaml.dump(whole, Dumper=yaml.CSafeDumper)).encode()
    return data


def outcome(reader: Reader, folder: Path, data: bytes) -> str:
    """What came of a reader on a file: "read", "refused", or in words what must not be."""
    path = folder / reader.file
    good = path.read_bytes()
    path.unlink()
    path.write_bytes(data)
    try:
        with warnings.catch_warnings(action="error"), bounded(LONGEST_S, 50 * len(data) + 200_000_000):
            reader.read(path)
        return "read"
    except InputError as error:
        return "refused" if "\n" not in str(error) and str(error) else f"words: {error}"
    except TooLong as error:
        return f"hangs: {error}"
    except (Exception, MemoryError) as error:
        return f"{type(error).__name__}: {error}"[:200]
    finally:
        path.write_bytes(good)


def runs(folder: Path, count: int, seed: int) -> Iterator[tuple[Reader, bytes, str]]:
    """So many runs over all readers in turn; what each file was and what came of it."""
    rng = np.random.default_rng(seed)
    good = {reader.name: (folder / reader.file).read_bytes() for reader in READERS}
    round_ = 0
    while count > 0:
        for reader in READERS:
            if count > 0 and round_ % reader.seldom == 0:
                count -= 1
                data = mutated(good[reader.name], reader.file, rng)
                yield reader, data, outcome(reader, folder, data)
        round_ += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--report", type=Path)
    args = parser.parse_args()
    counts: dict[str, Counter[str]] = {reader.name: Counter() for reader in READERS}
    broken: dict[tuple[str, str], str] = {}
    # syncing is for power cuts, which nothing here can show; and no disk, where memory serves as one
    os.fsync = lambda _: None  # type: ignore[assignment]
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as name:
        add_streams(Path(shutil.copytree(good_files(), name, dirs_exist_ok=True)))
        for number, (reader, data, came) in enumerate(runs(Path(name), args.runs, args.seed)):
            sound = came in ("read", "refused")
            counts[reader.name][came if sound else "broken"] += 1
            if not sound and (reader.name, came[:40]) not in broken:
                kept = SEEDS / reader.name / f"{zlib.crc32(data):08x}"
                kept.parent.mkdir(parents=True, exist_ok=True)
                kept.write_bytes(data)
                broken[reader.name, came[:40]] = f"{kept}: {came}"
                print(broken[reader.name, came[:40]], flush=True)
            if number % 10_000 == 9_999:
                print(f"{number + 1} of {args.runs} runs, {len(broken)} kinds of failure", flush=True)
    lines = [f"seed {args.seed}", "", "| reader | read | refused | broken |", "|---|---|---|---|"]
    lines += [f"| {name} | {one['read']} | {one['refused']} | {one['broken']} |" for name, one in counts.items()]
    report = "\n".join([*lines, "", *broken.values()]) + "\n"
    print(report)
    if args.report:
        args.report.write_text(report)
    raise SystemExit(1 if broken else 0)


if __name__ == "__main__":
    main()
