"""`vbaa view`: the scene as a window, a PNG, a page that opens offline, or glTF."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from estimator.table.contacts import ContactTable
    from vbaa_calib.rig import Rig
    from viz.scene.scene import Scene

OUTPUTS = {"screenshot": (".png",), "html": (".html", ".htm"), "gltf": (".glb", ".gltf")}
"""What can be written → the suffixes that it may have."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `vbaa view`."""
    parser.add_argument("contacts", type=Path, help="contacts.csv, as vbaa estimate writes it")
    parser.add_argument("--rig", type=Path, help="rig.json: draws the antenna, plane C and the camera, too")
    parser.add_argument(
        "--object",
        type=Path,
        help="object.vtp, .ply or .glb, as vbaa reconstruct writes it, instead of estimating it",
    )
    parser.add_argument(
        "--plain", action="store_true", help="only what stands in the files: find no object, no friction"
    )
    parser.add_argument("--truth", type=Path, help="truth.json of a synthetic session: draws the true object")
    pictures = parser.add_mutually_exclusive_group()
    pictures.add_argument("--session", type=Path, help="the recording's session: its pictures hang before the camera")
    pictures.add_argument("--picture", type=Path, help="one picture of the camera, for all moments")
    parser.add_argument(
        "--color",
        choices=("force", "time", "uncertainty"),
        default="force",
        help="what the contacts are coloured by (default: force); page and window can change it",
    )
    parser.add_argument("--screenshot", type=Path, metavar="PNG", help="write a picture instead of opening a window")
    parser.add_argument("--html", type=Path, metavar="PAGE", help="write a page with a time slider that opens offline")
    parser.add_argument(
        "--gltf", type=Path, metavar="FILE", help="write scene.glb or scene.gltf for other 3-D programs"
    )
    parser.add_argument("--title", default="Contacts of the active antenna", help="title of the page")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw the scene. Returns what was drawn and written.

    Raises InputError for wrong input, a file in the way, or no display for a window; OpenGLError where none works.
    """
    window = not any(getattr(args, name) for name in OUTPUTS)
    _check_outputs(args, window)

    from vbaa_calib.core.console import say
    from viz.render.render import require_opengl, screenshot, show, write_gltf, write_page

    if window:
        require_opengl()
    scene, frames = _scene(args)
    # page and glTF need no OpenGL: they are written before the picture may fail
    if args.html is not None:
        write_page(scene, args.html, title=args.title, mode=args.color, force=args.force)
        say(f"{args.html}: {args.html.stat().st_size / 1e6:.1f} MB, opens offline in any browser")
    if args.gltf is not None:
        write_gltf(scene, args.gltf, mode=args.color, force=args.force)
        say(f"{args.gltf}: {args.gltf.stat().st_size / 1e6:.1f} MB")
    if args.screenshot is not None:
        screenshot(scene, args.screenshot, mode=args.color, force=args.force)
        say(f"{args.screenshot}: {args.screenshot.stat().st_size / 1e6:.1f} MB")
    if window:
        show(scene, mode=args.color)
    return {
        "contacts": len(scene.contacts.points_m),
        "frames": frames,
        "moments": len(scene.moments),
        "facts": [] if scene.estimate is None else list(scene.estimate.facts),
        **{name: None if getattr(args, name) is None else str(getattr(args, name)) for name in OUTPUTS},
    }


def _scene(args: argparse.Namespace) -> tuple[Scene, int]:
    """All that is read and found, as a scene, and how many frames that was."""
    from estimator.table.files import read_contacts
    from vbaa_calib.core.errors import InputError
    from vbaa_calib.core.files import read_json
    from viz.files.object_file import read_object
    from viz.scene.moments import moments_of, refuse_absurd
    from viz.scene.scene import Contacts, Scene
    from viz.scene.truth import true_object

    table = read_contacts(args.contacts)
    if not table.located.any():
        raise InputError("no frame has a located contact", where=args.contacts, remedy="see its reason column")
    refuse_absurd(table, args.contacts)
    truth = None if args.truth is None else true_object(read_json(args.truth), args.truth)
    rig = _rig(args)
    surface = None if args.object is None else read_object(args.object)
    estimate = phase = None
    if args.object is None and not args.plain:
        surface, estimate, phase = _estimated(table, rig)
    moments = moments_of(table, phase)
    items = None
    pictures: tuple[np.ndarray | None, ...] = ()
    if rig is not None:
        from viz.scene.rig_items import one_picture, rig_items, session_pictures

        items = rig_items(rig, table, moments)
        if args.session is not None:
            pictures = session_pictures(args.session, moments.frame, rig.camera.image_size)
        elif args.picture is not None:
            pictures = one_picture(args.picture, rig.camera.image_size, len(moments))
    return Scene(Contacts.of(table), moments, items, surface, truth, estimate, pictures), len(table)


def _rig(args: argparse.Namespace) -> Rig | None:
    from vbaa_calib.core.errors import InputError
    from vbaa_calib.rig import Rig

    if args.rig is not None:
        return Rig.load(args.rig)
    for name in ("session", "picture"):
        if getattr(args, name) is not None:
            raise InputError("its pictures hang before the camera", where=f"--{name}", remedy="give --rig, too")
    return None


def _estimated(table: ContactTable, rig: Rig | None) -> tuple[Any, Any, Any]:
    """Surface, object estimate and phases; nothing, and why, where the contacts do not determine them."""
    from estimator.object.estimate import estimate_object
    from vbaa_calib.core.console import say
    from vbaa_calib.core.errors import InputError
    from viz.scene.facts import drawn_estimate
    from viz.scene.scene import ObjectMesh

    try:
        found = estimate_object(table, rig)
    except InputError as error:
        say(f"no object is drawn: {error}")
        return None, None, None
    drawn = drawn_estimate(found)
    for fact in drawn.facts:
        say(f"  {fact}")
    return ObjectMesh.of(found.surface), drawn, found.track.phase


def _check_outputs(args: argparse.Namespace, window: bool) -> None:
    """Everything that can be refused before the work."""
    from vbaa_calib.core.errors import InputError
    from vbaa_calib.core.files import refuse_overwrite
    from viz.render.display import require_display

    for name, suffixes in OUTPUTS.items():
        path = getattr(args, name)
        if path is not None:
            if path.suffix.lower() not in suffixes:
                raise InputError(
                    f"is not a {' or '.join(suffixes)}", where=path, remedy=f"name it something{suffixes[0]}"
                )
            refuse_overwrite(path, args.force, (args.contacts, args.rig, args.object, args.truth, args.picture))
    if window:
        require_display()
