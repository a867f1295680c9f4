"""`vbaa export rig.json --to SIMULATOR -o FILE`: the antenna as calibrated, for simulators."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vbaa_calib.core.console import say
from vbaa_calib.core.files import refuse_overwrite

from .options import add_accept_rig, usable_rig


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rig", type=Path, help="rig.json")
    parser.add_argument(
        "--to",
        dest="target",
        choices=("mujoco", "pyelastica", "urdf-beam", "json"),
        required=True,
        help="mujoco: MJCF, which Newton reads, too; pyelastica: a Python file; urdf-beam: URDF with Gazebo's springs; "
        "json: plain numbers",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="the file to write")
    parser.add_argument(
        "--segments", type=int, default=40, metavar="N", help="parts of the antenna, 3 to 200 (default: 40)"
    )
    add_accept_rig(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Write one file. Returns the output's path, and what the format cannot hold."""
    from vbaa_calib.export.simulators import EXPORTS, export

    refuse_overwrite(args.output, args.force, [args.rig])
    _, what, lost = EXPORTS[args.target]
    export(usable_rig(args.rig, args.accept_rig), args.target, args.output, segments=args.segments, force=args.force)
    say(f"wrote {args.output}: {what}")
    say(f"lost  {lost}: the file has no place for it")
    return {"output": str(args.output), "to": args.target, "segments": args.segments, "lost": lost}
