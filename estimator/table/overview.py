"""Overview of a recording's frames: their readings, statuses, and reasons why some have no contact point."""

from __future__ import annotations

import math
import re
from array import array
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from vbaa_calib.session import CHANNELS, Frame

from .contacts import LOCATED, Contact, ContactTable, Measured


@dataclass(eq=False)
class Overview:
    """Counts of the frames of a recording, or of several, as they come.

    columns : of the rig's sensors; what else is read is not used.
    frames, read : how many there are, and with how many each channel was read. assumed_rad : values assumed for joint
        angles that were not read.
    status : how many frames have each. reasons : of those without a contact point, kinds of reasons that differ in
        numbers only: status, first frame and its reason, and how many.
    outside : centreline points outside the picture, which are left out; frames with such, and the points used in these.
    ends : frames in which the antenna's visible end was seen, and those in which it contradicts the rest and is not
        used.
    friction : frames that determine the friction angle, and those in which it is beyond twice its standard deviation
        beforehand (`--friction`).
    partly : contacts with a force that is unknown in some direction.
    """

    columns: tuple[str, ...] = ()
    frames: int = 0
    read: Counter[str] = field(default_factory=Counter)
    assumed_rad: dict[str, float] = field(default_factory=dict)
    status: Counter[str] = field(default_factory=Counter)
    reasons: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    outside: Counter[str] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    friction: Counter[str] = field(default_factory=Counter)
    partly: int = 0

    def __post_init__(self) -> None:
        # of every frame its number and the kind of its result, all that is kept of the rows
        self._rows, self._kinds = array("q"), array("q")
        self._first: dict[tuple[str, str], tuple[int, str]] = {}

    def add_readings(self, frame: Frame, measured: Measured | None = None, contact: Contact | None = None) -> None:
        """Count a frame's readings and its points outside the picture; with its contact, whether the antenna's end
        was used."""
        self.frames += 1
        if contact is not None and contact.end_used is not None:
            self.ends.update({"seen": 1, "unused": int(not contact.end_used)})
        if contact is not None and contact.status in LOCATED and math.isnan(contact.force_N[1] + contact.force_N[2]):
            self.partly += 1
        if contact is not None and contact.status in LOCATED:
            self._add_friction(contact)
        if measured is not None and measured.outside_points:
            used = len(measured.points_px)
            self.outside.update({"frames": 1, "points": measured.outside_points, "used": used})
        joints = {} if all(frame.joints_read) else dict(zip(CHANNELS[-2:], frame.joints_read, strict=True))
        for name in _named(self.columns):
            value = getattr(frame, name)
            if not joints.get(name, True):
                self.assumed_rad[name] = value
            elif value == value:
                self.read[name] += 1

    def add_table(self, table: ContactTable, read: Mapping[str, np.ndarray], points: np.ndarray) -> None:
        """Count many frames with their results. read : (B,) by channel, what was read, NaN where nothing was. points :
        (B, 2) of each, the number of those outside the picture, and of those that are used."""
        self.frames += len(table)
        self._add_friction(table, table.located)
        self.partly += int((table.located & np.isnan(table.force_y_N + table.force_z_N)).sum())
        if (lost := points[:, 0] > 0).any():
            outside, used = points[lost].sum(axis=0).tolist()
            self.outside.update({"frames": int(lost.sum()), "points": outside, "used": used})
        self.read.update({name: int((~np.isnan(read[name])).sum()) for name in _named(self.columns)})
        frames, statuses = table.frame.tolist(), table.status.tolist()
        if not (found := dict.fromkeys(statuses)).keys() <= {*LOCATED, "no_contact"}:
            for one in zip(frames, statuses, table.reason.tolist(), strict=True):
                self.add_result(*one)
            return
        self.status.update(statuses)
        places = {status: self._first.setdefault((status, ""), (len(self._first), ""))[0] for status in found}
        self._rows.extend(frames)
        self._kinds.extend(map(places.__getitem__, statuses))

    def _add_friction(self, found: Contact | ContactTable, located: np.ndarray | bool = True) -> None:
        """Count located frames with a friction angle known to half its prior, and those with one beyond twice it."""
        prior = found.friction_prior_rad
        known = located & (found.friction_angle_std_rad < 0.5 * prior)
        beyond = known & (np.abs(found.friction_angle_rad) > 2.0 * prior)
        self.friction.update({"known": int(np.sum(known)), "beyond": int(np.sum(beyond))})

    def add_result(self, frame: int, status: str, reason: str) -> None:
        """Count a frame's status and reason."""
        self.status[status] += 1
        kind = status, ""
        if status not in (*LOCATED, "no_contact"):
            kind = self._add_reason({"status": status, "frames": 1, "frame": frame, "reason": reason})
        place, _ = self._first.setdefault(kind, (len(self._first), reason if kind[1] else ""))
        self._rows.append(frame)
        self._kinds.append(place)

    def amend(self, changed: Callable[[int, str, str], tuple[str, str]]) -> None:
        """Recount the results with changed statuses and reasons. changed : from a row's number (from 0), its status
        and a reason of its kind."""
        before = [(status, reason) for (status, _), (_, reason) in self._first.items()]
        rows, kinds = self._rows, self._kinds
        self.status, self.reasons = Counter(), {}
        self.__post_init__()
        for number, (frame, kind) in enumerate(zip(rows, kinds, strict=True)):
            self.add_result(frame, *changed(number, *before[kind]))

    def _add_reason(self, one: dict[str, Any]) -> tuple[str, str]:
        """Count frames with a reason of the same kind."""
        status, reason = one["status"], one["reason"]
        kind = re.sub(r"\([^)]*\)", "", reason.partition("; ")[0])
        kind = re.sub(r"[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?", "#", kind)
        first = one | {"frames": 0, "remedy": _remedy(status, reason)}
        self.reasons.setdefault((status, kind), first)["frames"] += one["frames"]
        return status, kind or "#"

    def join(self, numbers: Mapping[str, Any], **where: str) -> None:
        """Add the `numbers` of another part or recording. where : prefix that identifies its frames."""
        readings = numbers["readings"]
        self.frames += readings["frames"]
        self.read.update({name: readings[name] for name in CHANNELS if readings.get(name)})
        self.columns = tuple(name for name in CHANNELS if name in self.columns or name in readings)
        self.assumed_rad |= readings["assumed_rad"]
        unused = numbers.get("set_aside", {})
        self.outside["frames"] += unused.get("outside_frames", 0)
        self.outside["points"] += unused.get("outside_points", 0)
        self.ends.update({"seen": unused.get("ends_seen", 0), "unused": unused.get("ends_unused", 0)})
        self.friction.update({name: unused.get(f"friction_{name}", 0) for name in ("known", "beyond")})
        self.partly += numbers.get("forces_partly_known", 0)
        self.status.update(numbers["status"])
        for one in numbers["reasons"]:
            self._add_reason(one | where)

    def numbers(self) -> dict[str, Any]:
        """The counts for `--json`: `status`, `readings`, `set_aside`, `forces_partly_known`, and `reasons` with the
        commonest kind first."""
        read = {name: self.read[name] for name in _named(self.columns)}
        return {
            "status": dict(self.status.most_common()),
            "readings": {"frames": self.frames, **read, "assumed_rad": dict(self.assumed_rad)},
            "set_aside": self.unused,
            "forces_partly_known": self.partly,
            "reasons": sorted(self.reasons.values(), key=lambda one: (-one["frames"], one["frame"])),
        }

    @property
    def unused(self) -> dict[str, int]:
        """Numbers of frames with a visible end, of ends not used, of frames with points outside the picture, of such
        points, of frames with a known friction angle, and of those beyond twice `--friction`."""
        counts = {f"ends_{name}": self.ends[name] for name in ("seen", "unused")}
        counts |= {f"friction_{name}": self.friction[name] for name in ("known", "beyond")}
        return counts | {f"outside_{name}": self.outside[name] for name in ("frames", "points")}

    def outside_in_words(self, image_size: tuple[int, int]) -> list[str]:
        """A list with the sentence on the points outside pictures of this size and the likely cause; empty without such
        points."""
        if not self.outside["points"]:
            return []
        points, frames, used = (self.outside[name] for name in ("points", "frames", "used"))
        exchanged = "are u_px and v_px exchanged, or are they of pictures of another size?"
        cause = exchanged if points > 0.1 * (points + used) else "a tracker's misses"
        counts = f"{points} point{'s' * (points != 1)} of {frames} frame{'s' * (frames != 1)}"
        return [f"{counts} outside the picture of {image_size[0]}x{image_size[1]} px left out: {cause}"]


@lru_cache
def _named(columns: tuple[str, ...]) -> list[str]:
    """Names of the channels that are counted: moment about y, pan and tilt, and those of the rig's columns."""
    return [name for name in CHANNELS if name in (CHANNELS[0], *CHANNELS[-2:], *columns)]


def _remedy(status: str, reason: str) -> str:
    """The remedy for a frame's reason in contacts.csv; empty where the reason contains it, or none is known."""
    own = re.search(r"\(remedy: (.*)\)$", reason)
    match status:
        case _ if own is not None:
            return own[1]
        case "no_antenna" if "joint angles" in reason:
            return "give joint angles nearer to the pictures, a larger --gap, or the clocks' --clock-offset"
        case "no_antenna" if "centreline points" in reason:
            return "look at these frames in one's own tracker: 5 points are needed, the more the better"
        case "no_antenna" | "failed" if "moment" not in reason and "rig has changed" not in reason:
            return "see what was taken for the antenna (--overlay DIR); --background auto where nothing else moves"
        case "failed" if "moment" in reason:
            return "read the sensor without contact: vbaa check rig.json --free PICTURE --moment READING"
        case "unobservable" if "edge-on" in reason:
            return "incline the camera by 30° across the antenna, or read the moment"
        case "unobservable":
            return "read the moment, or press harder"
        case "low_signal":
            return "press harder; vbaa budget rig.json names what limits it"
        case "not_quasistatic" if "swings" in reason:
            return "move slower, or wait until the antenna is at rest"
    return ""


def overview_in_words(numbers: Mapping[str, Any], most: int = 3) -> list[str]:
    """`Overview.numbers` in lines: statuses, readings, and the commonest reasons for frames without a contact point."""
    statuses, reasons = numbers["status"], numbers["reasons"]
    total, lost = sum(statuses.values()), sum(one["frames"] for one in reasons)
    lines = [
        f"{total} frames: " + ", ".join(f"{count} {name}" for name, count in statuses.items()),
        f"readings: {readings_in_words(numbers['readings'])}",
    ]
    if unused := _unused_in_words(numbers.get("set_aside", {}), total):
        lines.append(f"set aside: {unused}")
    if partly := numbers.get("forces_partly_known", 0):
        lines.append(
            f"the force along the line of sight is not determined in {partly} located frames, and empty there: only "
            "perspective shows it (lean the camera along the antenna, or read the moment)"
        )
    if not reasons:
        return lines
    lines.append(
        f"neither located nor free: {lost} of {total} frames" + ", the commonest reasons:" * (len(reasons) > most)
    )
    for one in reasons[:most]:
        own = one["reason"].partition(" (remedy: ")[0]
        what = f" (remedy: {one['remedy']})" if one["remedy"] else ""
        first = f"{one['recording']}, frame {one['frame']}" if "recording" in one else f"frame {one['frame']}"
        lines.append(f"  {one['frames']} {one['status']}, first {first}: {own}{what}")
    others = lost - sum(one["frames"] for one in reasons[:most])
    return [*lines, f"  {others} for {len(reasons) - most} other reasons"] if others else lines


def _unused_in_words(unused: Mapping[str, int], total: int) -> str:
    """A sentence on the measurements that contradict the rest of their frame and are not used, from
    `Overview.numbers`; empty without any."""
    words = []
    if unused.get("ends_unused"):
        words.append(f"the antenna's visible end in {unused['ends_unused']} of {unused['ends_seen']} frames with one")
    if unused.get("outside_points"):
        of = f"in {unused['outside_frames']} of {total} frames"
        words.append(f"{unused['outside_points']} points outside the picture {of}")
    return "; ".join(words)


def readings_in_words(readings: Mapping[str, Any]) -> str:
    """The readings of `Overview.numbers` in a line."""
    whole, words = readings["frames"], dict[str, str]()
    for name in CHANNELS:
        if name in readings:
            count = readings[name]
            words[name] = "none" if not count else "all frames" if count == whole else f"{count} of {whole} frames"
        if name in readings["assumed_rad"]:
            words[name] += f", {'else ' if readings[name] else ''}taken as {readings['assumed_rad'][name]:.4g}"
    pan, tilt = (words.pop(name) for name in CHANNELS[-2:])
    about = {"moment_Nm": "moment", "moment_z_Nm": "moment about z", "moment_x_Nm": "moment about x"}
    about |= {f"sensor_force_{axis}_N": f"force along {axis}" for axis in "xyz"}
    joints = f"joints: {pan}" if pan == tilt else f"pan: {pan}; tilt: {tilt}"
    return "; ".join([*(f"{about[name]}: {each}" for name, each in words.items()), joints])
