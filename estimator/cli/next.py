"""`vbaa next contacts.csv --rig rig.json`: where to touch next."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_antenna, usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError, about
from vbaa_calib.core.files import refuse_overwrite, write_json

if TYPE_CHECKING:
    from estimator.object.next_touch import NextTouch


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("contacts", type=Path, help="contacts.csv or .parquet of one object that stands still")
    add_antenna(parser)
    parser.add_argument("--rig", type=Path, required=True, help="rig.json that the contacts were made with")
    # as `estimator.object.next_touch.GOALS`, not imported for a quick --help
    goals = ("surface", "friction", "stiffness")
    parser.add_argument("--goal", choices=goals, default=goals[0], help="what is to be known better (default: surface)")
    for name in ("pan", "tilt"):
        parser.add_argument(
            f"--{name}",
            type=float,
            nargs=2,
            metavar=("LOW", "HIGH"),
            help=f"limits of the {name}, rad (default: the angles of the recording)",
        )
    parser.add_argument("--degrees", action="store_true", help="--pan and --tilt are in degrees")
    parser.add_argument("-o", "--output", type=Path, metavar="NEXT", help="next.json to write")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Print where to touch next, and how much that would reduce the uncertainty."""
    from estimator.object.next_touch import JointLimits, next_touch
    from estimator.table.files import read_contacts

    if args.output is not None:
        refuse_overwrite(args.output, args.force, (args.contacts, args.rig))
        if args.output.suffix != ".json":
            raise InputError("is not a .json", where=args.output, remedy="name it next.json")
    pan, tilt = (_limits(args, name) for name in ("pan", "tilt"))
    table, rig = read_contacts(args.contacts, antenna=args.antenna), usable_rig(args.rig)
    with about(args.contacts):
        recorded = JointLimits.of(table, rig)
        one = next_touch(table, rig, args.goal, JointLimits(pan or recorded.pan_rad, tilt or recorded.tilt_rad))
    for line in _words(one):
        say(line)
    result = one.summary()
    if args.output is not None:
        write_json(args.output, {"schema": "vbaa.next/1", **result}, force=args.force)
        say(f"wrote {args.output}")
    return {**result, "next": None if args.output is None else str(args.output)}


def _limits(args: argparse.Namespace, name: str) -> tuple[float, float] | None:
    """A pair of limits of a joint, rad. Raises InputError for invalid ones."""
    limits = getattr(args, name)
    if limits is None:
        return None
    turn = 360.0 if args.degrees else 2.0 * math.pi
    if not -turn <= limits[0] < limits[1] <= turn:
        remedy = "give degrees" if args.degrees else "give radians, or add --degrees"
        raise InputError(
            f"--{name} is {limits[0]:g} to {limits[1]:g}", remedy=f"{remedy}, the lower limit first, up to a turn"
        )
    low, high = (math.radians(each) if args.degrees else each for each in limits)
    return low, high


def _words(one: NextTouch) -> list[str]:
    def joints(pair: tuple[float, float]) -> str:
        pan, tilt = pair
        return f"pan {pan:.4f}, tilt {tilt:.4f} rad ({math.degrees(pan):.2f}°, {math.degrees(tilt):.2f}°)"

    unit = {"surface": (1e3, "mm"), "friction": (1.0, ""), "stiffness": (1.0, "m/N")}[one.goal]
    of = {"surface": "the surface", "friction": "μ", "stiffness": "the compliance"}[one.goal]
    now, then = (f"{unit[0] * each:.3g}{' ' if unit[1] else ''}{unit[1]}" for each in (one.std, one.std_after))
    better = ", and no touch here would improve that" if now == then else f" and should then be known to {then}"
    place = ", ".join(f"{1e3 * each:.1f}" for each in one.point_m)
    lines = [
        f"begin clear of the object at {joints(one.begin_rad)}",
        f"first touch near               {joints(one.touch_rad)}",
        f"press to                       {joints(one.press_rad)}",
    ]
    if one.end_rad != one.press_rad:
        lines.append(f"stroke to                      {joints(one.end_rad)}, then back")
    return [
        *lines,
        f"the contact should come {1e3 * one.distance_m:.1f} mm along the antenna, at ({place}) mm, "
        f"with {1e3 * one.force_N:.3g} mN",
        f"{of} is known to {now}{better}; best of {one.compared} touches",
    ]
