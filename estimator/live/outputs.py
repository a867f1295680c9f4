"""Outputs of live contacts: a growing table, JSON lines, datagrams, an MCAP file."""

from __future__ import annotations

import io
import json
import math
import pickle
import socket
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from estimator.diagnose import RecordingVerdict
from estimator.diagnose.consequences import changed_row
from estimator.table.contacts import LOCATED, ContactRow
from estimator.table.files import cells_of, check_format, header_line, row_line, write_contacts
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import disk_errors_named, refuse_overwrite
from vbaa_calib.core.folders import make_folder
from vbaa_calib.streams.bags import BagWriter, Logged
from vbaa_calib.streams.devices import udp_address

from .estimator import LiveContact

_KINDS = (
    "std_msgs/msg/String",
    *(f"geometry_msgs/msg/{name}" for name in ("PointStamped", "WrenchStamped", "PoseWithCovarianceStamped")),
)


class GrowingTable:
    """A contacts.csv that can be read while it grows: each frame's line is in the file at once.

    The final rows are kept in a file without a name, which nobody has to remove, and take its place when it is closed.
    Parquet cannot be read while it grows: NAME.parquet is written when it is closed; until then NAME.parquet.csv grows.
    """

    def __init__(
        self, path: Path, force: bool = False, inputs: Iterable[Path | None] = (), *, final: bool = True
    ) -> None:
        """inputs : files that it must not replace. final : whether there will be final rows. Raises InputError for
        an existing file, one of the inputs, or another format."""
        check_format(path)
        grows = path.suffix.lower() == ".csv"
        self._path, self._grown, self._final = path, path if grows else path.with_name(f"{path.name}.csv"), final
        for each in {self._path, self._grown}:
            refuse_overwrite(each, force, inputs)
        make_folder(path.parent)
        self._stream = _opened(self._grown)
        self._kept = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115 -- it lives as long as this
        self._rows = [0, 0]
        self.verdict = RecordingVerdict()

    def write(self, contact: LiveContact) -> None:
        with disk_errors_named(self._path):
            if not contact.final:
                _append_whole(self._stream, row_line(cells_of(contact.row)))
            if contact.final == self._final:
                pickle.dump(ContactRow.of(contact.item.frame, contact.item.contact), self._kept)
        self._rows[contact.final] += 1

    def close(self) -> None:
        """Replace the rows by the final ones, if every frame has one, with the recording's `verdict` applied."""
        with self._kept, disk_errors_named(self._path):
            self._stream.close()
            if self._rows[False] and self._rows[self._final] == self._rows[False]:
                self._kept.seek(0)
                write_contacts(self._path, self._again(), force=True)
                if self._grown != self._path:
                    self._grown.unlink()

    def _again(self) -> Iterator[ContactRow]:
        with suppress(EOFError):
            for number in count():
                row: ContactRow = pickle.load(self._kept)
                status, reason = changed_row(self.verdict, number, row.status, row.reason)
                yield replace(row, status=status, reason=reason)


def _opened(path: Path) -> io.FileIO:
    try:
        stream = path.open("wb", buffering=0)
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", where=path, remedy="write somewhere else") from None
    try:
        with disk_errors_named(path):
            _append_whole(stream, header_line())
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return stream


def _append_whole(stream: io.FileIO, line: str) -> None:
    """Append a line completely or not at all: on a full disk the part that was written is removed again."""
    begin, left = stream.tell(), line.encode()
    try:
        while left:
            left = left[stream.write(left) :]
    except OSError:
        stream.truncate(begin)
        raise


def json_line(contact: LiveContact) -> str:
    """A contact as a line of JSON: the columns of contacts.csv, null for missing numbers, and final, latency_s,
    age_s; `alarms` of a watched rig, if any."""
    cells: dict[str, Any] = {**cells_of(contact.row), "latency_s": contact.latency_s, "age_s": contact.age_s}
    plain = {
        name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in cells.items()
    }
    alarms = {"alarms": [one.to_dict() for one in contact.alarms]} if contact.alarms else {}
    return json.dumps({"final": contact.final, **plain, **alarms}, allow_nan=False)


class Datagrams:
    """Contacts by UDP, one JSON line in each datagram, without acknowledgement."""

    def __init__(self, address: str) -> None:
        """address : HOST:PORT, or PORT on this machine. Raises InputError for an invalid one."""
        self._address = udp_address(address, "--udp-out")
        try:
            family = socket.getaddrinfo(*self._address, type=socket.SOCK_DGRAM)[0][0]
        except OSError as error:
            what = f"{address} is not known ({error.strerror})"
            raise InputError(what, where="--udp-out", remedy="write it like 192.168.0.7:5006") from None
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def write(self, contact: LiveContact) -> None:
        with suppress(OSError):  # a net that is gone or full: the next one may get through
            self._socket.sendto(json_line(contact).encode(), self._address)

    def close(self) -> None:
        self._socket.close()


class ContactBag:
    """Contacts as ROS messages: PointStamped and WrenchStamped of located ones, the pose with its covariance, and
    every frame and alarm as JSON text (std_msgs/String); in an MCAP file, of which a kill loses the last second, or
    a ROS bag, by the suffix."""

    def __init__(self, path: Path) -> None:
        """path : of a new file, as `refuse_bag` has made sure."""
        self._path = path
        make_folder(path.parent)
        with disk_errors_named(path):
            self._writer = BagWriter(path)
            self._writer.ready(_KINDS)
        self._kept_s = time.monotonic()

    def write(self, contact: LiveContact) -> None:
        with disk_errors_named(self._path):
            for logged in contact_messages(contact):
                self._writer.write(logged)
            if time.monotonic() > self._kept_s + 0.5:  # a kill loses no more than a second
                self._writer.flush()
                self._kept_s = time.monotonic()

    def close(self) -> None:
        with disk_errors_named(self._path):
            self._writer.close()


def contact_messages(contact: LiveContact) -> list[Logged]:
    """The ROS messages of a contact, at the picture's time; world frame."""
    row = contact.row
    prefix, time_ns = "/contact/final" if contact.final else "/contact", max(round(1e9 * row.time_s), 0)
    text, placed, pressed, known = _KINDS
    messages = [Logged(f"{prefix}/row", text, {"data": json_line(contact)}, time_ns)]
    messages += [
        Logged(f"{prefix}/alarm", text, {"data": json.dumps(one.to_dict())}, time_ns) for one in contact.alarms
    ]
    if row.status not in LOCATED:
        return messages
    point = dict(zip("xyz", row.point_world_m.tolist(), strict=True))
    covariance = [0.0] * 36
    for i in range(3):
        for j in range(3):
            covariance[6 * i + j] = float(row.covariance_world_m2[i, j])
    pose = {"pose": {"position": point, "orientation": {"w": 1.0}}, "covariance": covariance}
    force = {"force": dict(zip("xyz", row.force_world_N.tolist(), strict=True))}
    messages += [
        Logged(f"{prefix}/point", placed, {"point": point}, time_ns),
        Logged(f"{prefix}/force", pressed, {"wrench": force}, time_ns),
        Logged(f"{prefix}/pose", known, {"pose": pose}, time_ns),
    ]
    return [one for one in messages if one.kind != pressed or math.isfinite(row.force_world_N[0])]
