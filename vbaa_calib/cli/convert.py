"""`vbaa convert FILE --to FORMAT -o OUTPUT`: the camera to and from other programs' files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vbaa_calib.core.console import say
from vbaa_calib.core.files import refuse_overwrite, write_text

_NAMES = ("vbaa", "ros", "opencv", "kalibr", "mrcal", "colmap")


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="rig.json, camera.json, or another program's file")
    parser.add_argument("--from", dest="source", choices=_NAMES, help="its format (default: guessed from its contents)")
    parser.add_argument(
        "--to",
        dest="target",
        choices=_NAMES,
        default="vbaa",
        help="ros: camera_info YAML; opencv: FileStorage YAML; kalibr: camchain.yaml; mrcal: .cameramodel; colmap: "
        "cameras.txt; vbaa: camera.json (default: vbaa)",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="the file to write")
    parser.add_argument("--camera-name", metavar="NAME", help="which one, where FILE holds several (cam1; CAMERA_ID)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Convert one file. Returns what was written, and what the format has no place for.

    Raises InputError for a broken file, a lens that the format cannot hold, or a file in the way.
    """
    from vbaa_calib.convert import FORMATS, guessed

    refuse_overwrite(args.output, args.force, [args.file])
    source = guessed(args.file) if args.source is None else FORMATS[args.source]
    target = FORMATS[args.target]
    given = source.read(args.file, args.camera_name)
    text, lost = target.write(given), target.lost(given)
    write_text(args.output, text, args.force)
    say(f"read {args.file}: {source.what}, lens {given.camera.model} with {given.camera.distortion.size} coefficients")
    for note in given.notes:
        say(f"note  {note}")
    for words in lost:
        say(f"lost  {words}: {target.what} has no place for it")
    say(f"wrote {args.output}: {target.what}")
    return {
        "output": str(args.output),
        "from": source.name,
        "to": target.name,
        "model": given.camera.model,
        "coefficients": int(given.camera.distortion.size),
        "pose": given.T_reference_camera is not None and target.with_pose,
        "lost": lost,
        "notes": list(given.notes),
    }
