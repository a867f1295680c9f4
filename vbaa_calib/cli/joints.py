"""The options --pan and --tilt in radians, or in degrees with --degrees; and --antenna."""

from __future__ import annotations

import argparse
import math

from vbaa_calib.core.errors import InputError

_ANGLES = ("pan", "tilt")


def add_joints(parser: argparse._ActionsContainer, of: str = "joint angle") -> None:
    """Add --pan and --tilt (None by default) and --degrees."""
    for name in _ANGLES:
        parser.add_argument(f"--{name}", type=float, metavar="RAD", help=f"{of}, rad (default: 0)")
    parser.add_argument("--degrees", action="store_true", help="--pan, --tilt and a bag's joints are in degrees")


def add_antenna(parser: argparse._ActionsContainer) -> None:
    """Add --antenna, which selects one of several antennas."""
    parser.add_argument("--antenna", metavar="NAME", help="which antenna's contacts, where the table has several")


def joints_rad(args: argparse.Namespace) -> dict[str, float]:
    """The command line's joint angles by name, rad. Raises InputError for more than a turn."""
    angles = {name: getattr(args, name) for name in _ANGLES if getattr(args, name) is not None}
    for name, value in angles.items():
        if not abs(value) <= (360.0 if args.degrees else 2.0 * math.pi):
            remedy = "give degrees, up to a turn" if args.degrees else "give radians, up to a turn, or add --degrees"
            raise InputError(f"--{name} is {value:g}", remedy=remedy)
    return {name: math.radians(value) if args.degrees else value for name, value in angles.items()}


def pan_tilt_rad(args: argparse.Namespace) -> tuple[float, float]:
    """Pan and tilt, rad, 0 by default. Raises InputError as `joints_rad` does."""
    angles = joints_rad(args)
    return angles.get("pan", 0.0), angles.get("tilt", 0.0)
