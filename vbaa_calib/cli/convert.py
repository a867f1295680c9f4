"""`vbaa convert FILE --to FORMAT -o OUTPUT`: the camera to and from other programs' files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_lens_file, wanted_of
from vbaa_calib.core.console import say
from vbaa_calib.core.files import refuse_overwrite, write_text

if TYPE_CHECKING:
    from vbaa_calib.camera import Camera


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="rig.json, camera.json, or another program's file")
    names = ("vbaa", "ros", "opencv", "kalibr", "mrcal", "colmap")
    read = (*names, "numbers", "orbslam", "cahvor")
    parser.add_argument("--from", dest="source", choices=read, help="its format (default: guessed from its contents)")
    parser.add_argument(
        "--to",
        dest="target",
        choices=names,
        default="vbaa",
        help="ros: camera_info YAML; opencv: FileStorage YAML; kalibr: camchain.yaml; mrcal: .cameramodel; colmap: "
        "cameras.txt; vbaa: camera.json (default: vbaa)",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="the file to write")
    add_lens_file(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Convert one file. Returns the output's path, and what the format cannot hold.

    Raises InputError for a broken file, a lens that the format cannot hold, or a file in the way.
    """
    from vbaa_calib.convert import FORMATS, guessed

    inputs = [args.file] if args.file.is_file() else []
    refuse_overwrite(args.output, args.force, inputs)
    wanted = wanted_of(args, args.file)
    source = guessed(args.file) if args.source is None else FORMATS[args.source]
    target = FORMATS[args.target]
    exchanged = source.read(args.file, wanted)
    assert target.write is not None
    text, lost = target.write(exchanged), target.lost(exchanged)
    notes = [*exchanged.notes, *_folds(exchanged.camera)]
    write_text(args.output, text, args.force)
    camera = exchanged.camera
    say(f"read {args.file}: {source.what}, lens {camera.model} with {camera.distortion.size} coefficients")
    for note in notes:
        say(f"note  {note}")
    for words in lost:
        say(f"lost  {words}: {target.what} has no place for it")
    say(f"wrote {args.output}: {target.what}")
    return {
        "output": str(args.output),
        "from": source.name,
        "to": target.name,
        "model": camera.model,
        "coefficients": int(camera.distortion.size),
        "pose": exchanged.T_reference_camera is not None and target.with_pose,
        "lost": lost,
        "notes": notes,
    }


def _folds(camera: Camera) -> list[str]:
    """Warnings about a lens that does not map the picture one to one; empty for others."""
    share = camera.valid_region().image_fraction
    if share == 1.0:
        return []
    words = f"the lens folds inside the picture: {100 * (1 - share):.2g} % of it have no direction"
    return [f"{words}; vbaa calibrate refuses it"]
