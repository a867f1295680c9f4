"""`vbaa view`: the scene as a window, a PNG, or a page that opens offline."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `vbaa view`."""
    parser.add_argument("contacts", type=Path, help="contacts.csv, as vbaa estimate writes it")
    parser.add_argument("--rig", type=Path, help="rig.json: draws the antenna, plane C and the camera, too")
    parser.add_argument("--object", type=Path, help="object.vtp or .ply, as vbaa reconstruct writes it")
    parser.add_argument("--truth", type=Path, help="truth.json of a synthetic session: draws the true object")
    parser.add_argument("--screenshot", type=Path, metavar="PNG", help="write a picture instead of opening a window")
    parser.add_argument("--html", type=Path, metavar="PAGE", help="write a page that opens offline, without a window")
    parser.add_argument("--title", default="Contacts of the active antenna", help="title of the page")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw the scene. Returns what was drawn and written.

    Raises InputError for wrong input, a file in the way, or no display for a window; OpenGLError where none works.
    """
    window = args.screenshot is None and args.html is None
    _check_outputs(args, window)

    from estimator.table import read_contacts
    from vbaa_calib.console import say
    from vbaa_calib.errors import InputError
    from vbaa_calib.files import read_json

    from .object_file import read_object
    from .render import require_opengl, screenshot, show, write_page
    from .scene import build_scene, truth_object

    table = read_contacts(args.contacts)
    if not table.located.any():
        raise InputError("no frame has a located contact", where=args.contacts, remedy="see its reason column")
    rig = None
    if args.rig is not None:
        from vbaa_calib.rig import Rig

        from .rig_items import rig_items

        rig = rig_items(Rig.load(args.rig), table)
    scene = build_scene(
        table,
        rig=rig,
        surface=None if args.object is None else read_object(args.object),
        truth=None if args.truth is None else truth_object(read_json(args.truth), args.truth),
    )
    # the page needs no OpenGL: it is written before the picture may fail
    if args.html is not None:
        write_page(scene, args.html, title=args.title, force=args.force)
        say(f"{args.html}: {args.html.stat().st_size / 1e6:.1f} MB, opens offline in any browser")
    if args.screenshot is not None:
        require_opengl()
        screenshot(scene, args.screenshot, force=args.force)
        say(f"{args.screenshot}: {args.screenshot.stat().st_size / 1e6:.1f} MB")
    if window:
        show(scene)
    return {
        "contacts": len(scene.contacts.points_m),
        "frames": len(table),
        "screenshot": None if args.screenshot is None else str(args.screenshot),
        "html": None if args.html is None else str(args.html),
    }


def _check_outputs(args: argparse.Namespace, window: bool) -> None:
    """Everything that can be refused before the work."""
    from vbaa_calib.errors import InputError
    from vbaa_calib.files import refuse_overwrite

    for path, suffixes in ((args.screenshot, (".png",)), (args.html, (".html", ".htm"))):
        if path is not None:
            if path.suffix.lower() not in suffixes:
                raise InputError(f"is not a {suffixes[0]}", where=path, remedy=f"name it something{suffixes[0]}")
            refuse_overwrite(path, args.force)
    if window and sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise InputError("there is no display to open a window on", remedy="give --screenshot PNG or --html PAGE")
