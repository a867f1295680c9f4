"""`vbaa reconstruct`: contacts.csv to the object's surface."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `vbaa reconstruct`."""
    parser.add_argument("contacts", type=Path, help="contacts.csv, as vbaa estimate writes it")
    parser.add_argument("--rig", type=Path, help="rig.json: its antenna's radius lies between contact and object")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OBJECT", help="object.vtp or object.ply")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the surface. Returns what it is made of. Raises InputError for wrong input or a file in the way."""
    import numpy as np

    from estimator.surface import reconstruct
    from estimator.table import read_contacts
    from vbaa_calib.console import say
    from vbaa_calib.errors import InputError
    from vbaa_calib.files import refuse_overwrite

    from .object_file import check_suffix, write_object

    check_suffix(args.output)
    refuse_overwrite(args.output, args.force)
    table = read_contacts(args.contacts)
    radius = 0.0
    if args.rig is None:
        say("without --rig the antenna's radius is not known: the surface runs through the antenna's centreline")
    else:
        from vbaa_calib.rig import Rig

        radius = Rig.load(args.rig).antenna.diameter_m / 2
    if not table.located.any():
        raise InputError("no frame has a located contact", where=args.contacts, remedy="see its reason column")
    surface = reconstruct(table, radius)
    write_object(surface, args.output, force=args.force)
    patches = int(surface.patch.max()) + 1
    say(
        f"{args.output}: {len(surface.points_m)} points in {patches} patches, {len(surface.triangles)} triangles, "
        f"{len(surface.lines)} line segments"
    )
    for note in surface.notes:
        say(f"  {note}")
    known = surface.std_m[np.isfinite(surface.std_m)]
    return {
        "object": str(args.output),
        "points": len(surface.points_m),
        "patches": patches,
        "triangles": len(surface.triangles),
        "lines": len(surface.lines),
        "median_std_m": float(np.median(known)) if len(known) else None,
        "notes": list(surface.notes),
    }
