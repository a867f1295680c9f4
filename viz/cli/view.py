"""`vbaa view`: the scene as a window, a PNG, a page that opens offline, or glTF."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_antenna, usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json
from viz.files.outputs import refuse_output

if TYPE_CHECKING:
    from viz.scene.scene import Scene


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("contacts", type=Path, help="contacts.csv, as vbaa estimate writes it")
    add_antenna(parser)
    parser.add_argument("--rig", type=Path, help="rig.json: draws the antenna, plane C and the camera, too")
    parser.add_argument("--framewise", type=Path, help="contacts.csv that vbaa refine made these of: drawn beside them")
    parser.add_argument("--plain", action="store_true", help="only what the files contain: no object, no friction")
    parser.add_argument("--truth", type=Path, help="truth.json of a synthetic session: draws the true object")
    pictures = parser.add_mutually_exclusive_group()
    pictures.add_argument("--session", type=Path, help="the recording's session: its pictures are drawn at the camera")
    pictures.add_argument("--picture", type=Path, help="one picture of the camera, for all times")
    colour = "what the contacts are coloured by (default: force); page and window can change it"
    parser.add_argument("--color", choices=("force", "time", "uncertainty"), default="force", help=colour)
    parser.add_argument("--screenshot", type=Path, metavar="PNG", help="write a picture instead of opening a window")
    parser.add_argument("--turntable", type=Path, metavar="FILM", help="write a .gif or .mp4 that turns once around")
    parser.add_argument("--html", type=Path, metavar="PAGE", help="write a page with a time slider that opens offline")
    parser.add_argument("--gltf", type=Path, metavar="FILE", help="write a .glb or .gltf for other 3-D programs")
    parser.add_argument(
        "--rerun",
        nargs="?",
        const="spawn",
        metavar="TARGET",
        help="in Rerun instead: alone, in a viewer that is opened; a URL, in one that runs; or a file.rrd to write",
    )
    parser.add_argument("--title", default="Contacts of the active antenna", help="title of the page")
    parser.set_defaults(run=_run)


def _in_rerun(args: argparse.Namespace) -> dict[str, Any]:
    """The contacts in Rerun's viewer, frame by frame. Raises InputError as `_run` does."""
    from estimator.table.files import read_contacts
    from viz.files.rerun_log import RerunLog

    table = read_contacts(args.contacts, several=True, antenna=args.antenna)
    log = RerunLog(args.rerun, args.force)
    try:
        for row in table.rows():
            log.row(row)
    finally:
        log.close()
    say(f"{len(table)} frames shown in Rerun: {args.rerun}")
    return {"contacts": int(table.located.sum()), "frames": len(table), "rerun": args.rerun}


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw the scene. Returns the scene's contents and the files written.

    Raises InputError for wrong input, a file in the way, or no display for a window; VbaaError where none works.
    """
    if args.rerun is not None:
        return _in_rerun(args)
    # What can be written → the suffixes that it may have.
    suffixes = {
        "screenshot": (".png",),
        "turntable": (".gif", ".mp4"),
        "html": (".html", ".htm"),
        "gltf": (".glb", ".gltf"),
    }
    outputs: dict[str, Path] = {name: path for name in suffixes if (path := getattr(args, name)) is not None}
    inputs = (args.contacts, args.rig, args.framewise, args.truth, args.picture)
    for name, path in outputs.items():
        refuse_output(path, suffixes[name], args.force, inputs)
    unseen = not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if not outputs and unseen and sys.platform.startswith("linux"):
        raise _no_display()

    # each kind of picture has libraries of its own, which are slow to load
    if not outputs:
        from viz.render.probe import require_opengl

        require_opengl()
    scene, frames = _scene_of(args)
    look = {"mode": args.color, "force": args.force}
    # page and glTF need no OpenGL: they are written before the picture may fail
    if args.html is not None:
        from viz.render.page import write_page

        write_page(scene, args.html, title=args.title, **look)
    if args.gltf is not None:
        from viz.render.gltf import write_gltf

        write_gltf(scene, args.gltf, **look)
    if args.screenshot is not None:
        from viz.render.screenshot import screenshot

        screenshot(scene, args.screenshot, **look)
    if args.turntable is not None:
        from viz.render.turntable import turntable

        turntable(scene, args.turntable, **look)
    for name, path in outputs.items():
        opens = ", opens offline in any browser" if name == "html" else ""
        say(f"{path}: {path.stat().st_size / 1e6:.1f} MB{opens}")
    if not outputs:
        from viz.render.window import show

        if not show(scene, mode=args.color):
            raise _no_display()
    return {
        "contacts": len(scene.contacts.points_m),
        "frames": frames,
        "moments": len(scene.instants),
        "facts": list(scene.facts),
        **{name: str(outputs[name]) if name in outputs else None for name in suffixes},
    }


def _no_display() -> Exception:
    remedy = "give --screenshot PNG, --turntable FILM, --html PAGE or --gltf FILE"
    return InputError("there is no display to open a window on", remedy=remedy)


def _scene_of(args: argparse.Namespace) -> tuple[Scene, int]:
    """The scene of all inputs, and its number of frames."""
    from estimator.object.estimate import estimate_object
    from estimator.table.files import read_contacts
    from viz.scene.rig_items import session_pictures, small_picture
    from viz.scene.scene import build_scene, framewise, refuse_out_of_reach

    table = read_contacts(args.contacts, several=True, antenna=args.antenna)
    if not table.located.any():
        raise InputError("no frame has a located contact", where=args.contacts, remedy="see its reason column")
    refuse_out_of_reach(table, args.contacts)
    truth = None
    if args.truth is not None:
        from viz.scene.truth import true_object

        truth = true_object(read_json(args.truth), args.truth)
    for name in ("session", "picture"):
        if args.rig is None and getattr(args, name) is not None:
            raise InputError("its pictures are drawn at the camera", where=f"--{name}", remedy="give --rig, too")
    rig = None if args.rig is None else usable_rig(args.rig)
    estimate = None
    if not args.plain:
        try:
            estimate = estimate_object(table, rig)
        except InputError as error:
            say(f"no object is drawn: {error}")
    scene = build_scene(table, rig, estimate, truth)
    if args.framewise is not None:
        before = framewise(args.framewise, table)
        refuse_out_of_reach(before, args.framewise)
        scene = replace(scene, framewise_m=before.point_world_m[scene.contacts.row])
    for fact in scene.facts:
        say(f"  {fact}")
    if rig is not None and args.session is not None:
        pictures = session_pictures(args.session, scene.instants.frame, rig.camera.image_size)
    elif rig is not None and args.picture is not None:
        pictures = (small_picture(args.picture, rig.camera.image_size),) * len(scene.instants)
    else:
        pictures = ()
    return replace(scene, pictures=pictures), len(table)
