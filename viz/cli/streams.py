"""Options about streams that `vbaa live`, `estimate` and `batch` share, and the sources that they select."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_joints, pan_tilt_rad
from vbaa_calib.core.errors import InputError

if TYPE_CHECKING:
    from estimator.contact.source import RecordedStream
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Centrelines, Frame
    from vbaa_calib.streams import Timing
    from vbaa_calib.streams.bags import Topics

_ROLES = ("image", "moment", "joints", "camera")


def add_watch(parser: argparse.ArgumentParser) -> None:
    """Add --watch, for a rig in use."""
    parser.add_argument(
        "--watch",
        nargs="?",
        const="alarm",
        choices=("alarm", "stop"),
        help="say at once when the rig is not as calibrated any more, as by a knock; stop: and end",
    )


def configure(parser: argparse.ArgumentParser, *, readings: bool = True) -> None:
    """Add the options about streams. readings : also those of a file of readings."""
    group = parser.add_argument_group("streams")
    if readings:
        group.add_argument(
            "--readings",
            type=Path,
            metavar="FILE",
            help="a table of readings: time_s and any of moment_Nm, moment_z_Nm, pan_rad, tilt_rad (or pan_deg, "
            "tilt_deg)",
        )
    group.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="ROLE=NAME",
        help=f"of a bag, which topic to take, or none; the roles are {', '.join(_ROLES)}, and the names of several "
        "cameras (default: the only one, or the one with the camera's name in its own)",
    )
    group.add_argument("--pan-joint", default="", metavar="NAME", help="the joint of a JointState that is pan")
    group.add_argument("--tilt-joint", default="", metavar="NAME", help="the joint that is tilt")
    group.add_argument(
        "--moment-axis",
        default="y",
        choices=("x", "y", "z", "-x", "-y", "-z"),
        metavar="AXIS",
        help="the part of a WrenchStamped's torque that is the moment + l·f_z: x, y, z, or with a minus; -y of a "
        "right-handed sensor in the antenna's frame (default: y)",
    )
    group.add_argument(
        "--clock-offset",
        default="0",
        metavar="S|estimate",
        help="what is added to the readings' times to have them on the pictures' clock (default: 0); estimate: of a "
        "recording, from the moment and the bend that the pictures show",
    )
    group.add_argument(
        "--gap",
        type=float,
        default=0.1,
        metavar="S",
        help="readings further apart are not interpolated: the picture has none (default: 0.1)",
    )
    group.add_argument(
        "--wait",
        type=float,
        default=0.25,
        metavar="S",
        help="how long a picture waits for the readings after it (default: 0.25)",
    )
    if readings:
        group.add_argument(
            "--source",
            action="append",
            dest="camera_sources",
            default=[],
            metavar="NAME=SOURCE",
            help="of a rig with several cameras, one that has a source of its own",
        )
        group.add_argument(
            "--camera-offset",
            action="append",
            default=[],
            metavar="NAME=S|estimate",
            help="what is added to a camera's times to have them on the first camera's clock; estimate: of a "
            "recording, from how the antenna bends in both",
        )
    group.add_argument(
        "--together",
        type=float,
        default=0.01,
        metavar="S",
        help="pictures of several cameras that are so near in time are one frame (default: 0.01)",
    )
    add_joints(group, "joint angle where it is not read")


ESTIMATE = "estimate"


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Topics and timing of reading bags and videos. Raises InputError as `timing_of` and `_topics_of`."""
    return {"topics": _topics_of(args), "timing": timing_of(args)}


def timing_of(args: argparse.Namespace, rig: Rig | None = None) -> Timing:
    """How readings and pictures are matched, with this rig's sensor; the clocks' offset is 0 where it is to be
    estimated.

    Raises InputError for impossible times and angles, and for an offset to be estimated that nothing shows.
    """
    from vbaa_calib.streams import Timing

    if args.clock_offset == ESTIMATE and args.no_moment:
        remedy = "leave out --no-moment, or state the offset"
        raise InputError("--clock-offset estimate needs the moment", where="--no-moment", remedy=remedy)
    try:
        offset_s = 0.0 if args.clock_offset == ESTIMATE else float(args.clock_offset)
    except ValueError:
        offset_s = float("nan")
    if not abs(offset_s) <= 1e12:
        remedy = "give seconds, like 0.012, or estimate"
        raise InputError(f"--clock-offset is {args.clock_offset!r}", remedy=remedy)
    for name, least, most in (("gap", 1e-6, 3600.0), ("wait", 0.0, 3600.0), ("together", 0.0, 3600.0)):
        value = getattr(args, name)
        if not least <= value <= most:  # NaN is not, either
            raise InputError(f"--{name} is {value}", remedy=f"give a number from {least:g} to {most:g}")
    more: dict[str, Any] = {"together_s": args.together, "estimate_offset": args.clock_offset == ESTIMATE}
    timing = Timing(offset_s, args.gap, args.wait, pan_tilt_rad(args), **more)
    return timing if rig is None else replace(timing, moment_std_Nm=rig.reading_noise)


def _topics_of(args: argparse.Namespace) -> Topics:
    """The topics to read from a bag. Raises InputError for an unknown role."""
    from vbaa_calib.streams.bags import Topics

    named = named_topics(args.topic, None)
    images = {name: named.pop(name) for name in tuple(named) if name not in _ROLES}
    named |= {"pan": args.pan_joint, "tilt": args.tilt_joint, "moment_axis": args.moment_axis}
    return replace(Topics.of(named, degrees=args.degrees), images=images)


def views_of(args: argparse.Namespace, rig: Rig) -> dict[str, tuple[str, float]]:
    """Sources and time offsets of the cameras in --source and --camera-offset; "" without a source of its own.
    Raises InputError."""
    flags = {"--source": args.camera_sources, "--camera-offset": args.camera_offset}
    sources, offsets = (_by_camera(flag, entries, rig) for flag, entries in flags.items())
    views = {}
    for name in {**sources, **offsets}:
        try:
            text = offsets.get(name, "0")
            shift_s = 0.0 if text == ESTIMATE else float(text)
        except ValueError:
            shift_s = math.nan
        if not abs(shift_s) <= 1e12:
            remedy = f"give seconds, like --camera-offset {name}=0.012"
            raise InputError(f"--camera-offset is {name}={offsets[name]}", remedy=remedy)
        views[name] = sources.get(name, ""), shift_s
    return views


def _by_camera(flag: str, entries: Iterable[str], rig: Rig) -> dict[str, str]:
    """Values of NAME=VALUE by camera. Raises InputError for a camera that the rig does not have, and for a second
    value."""
    found: dict[str, str] = {}
    for text in entries:
        name, _, value = text.partition("=")
        if not rig.others or name not in rig.cameras or not value or name in found:
            has = f"cameras {', '.join(rig.cameras)}" if rig.others else "one camera: leave it out"
            raise InputError(f"{flag} is {text!r}", remedy=f"write {flag} NAME=…, each name once; the rig has {has}")
        found[name] = value
    return found


def named_topics(entries: Iterable[str], roles: Sequence[str] | None = _ROLES) -> dict[str, str]:
    """Topics of ROLE=NAME by role; without `roles` of any role. Raises InputError for an unknown role."""
    named = {}
    for text in entries:
        role, _, name = text.partition("=")
        if (roles is not None and role not in roles) or not role or not name:
            raise InputError(f"--topic is {text!r}", remedy="write it like --topic image=/camera/image_raw")
        named[role] = name
    return named


def stream_of(args: argparse.Namespace, path: Path, rig: Rig, timing: Timing) -> RecordedStream:
    """A bag, a video or a table of pictures, with its readings. Raises InputError."""
    from estimator.contact.source import RecordedStream
    from vbaa_calib.core.files import is_bag

    table = args.readings
    if table is None and not is_bag(path) and path.suffix.lower() == ".csv":
        table = path
    unclocked = [name for name, _, text in (each.partition("=") for each in args.camera_offset) if text == ESTIMATE]
    views = views_of(args, rig)
    return RecordedStream(path, rig, _topics_of(args), timing, table, args.no_moment, views, tuple(unclocked))


def frames_of(args: argparse.Namespace, lines: Mapping[str, Centrelines]) -> Sequence[Frame]:
    """Frames for centrelines of another tracker, by the camera's or antenna's name: one for each number in their
    tables. Raises InputError with file, line and remedy.

    Without readings: vision alone, the joints as --pan and --tilt say, times by --rate, or else a second from frame to
    frame, so that none is tested for motion.
    """
    from vbaa_calib.core.console import say
    from vbaa_calib.session import Frame, recording_of

    path, readings, joints = args.centrelines, args.readings, pan_tilt_rad(args)
    for name, each in lines.items():
        if each.note:
            say(f"read {path}{f', {name}' if name else ''}: {each.note}")
    if readings is None:
        first = Frame(None, *joints, math.nan, frame=0, time_s=0.0, joints_read=(False, False))
        numbers = sorted(set().union(*(each.frames.tolist() for each in lines.values())))
        return [replace(first, frame=frame, time_s=frame / (args.rate or 1.0)) for frame in numbers]
    frames = recording_of(readings, with_images=False)
    for each in lines.values():
        each.checked(frames, str(readings))
    return frames
