"""`vbaa reconstruct`: contacts.csv to the object's surface and stiffness."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vbaa_calib.cli.options import add_antenna, usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from viz.files.outputs import refuse_output


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("contacts", type=Path, help="contacts.csv, as vbaa estimate writes it")
    add_antenna(parser)
    why = "rig.json: its antenna's radius lies between contact and object, its errors are common to all contacts"
    parser.add_argument("--rig", type=Path, help=why)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OBJECT", help="a .vtp, .ply or .glb")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the surface. Returns its numbers. Raises InputError for wrong input or an existing file."""
    from estimator.object.surface import reconstruct, touches_of
    from estimator.table.files import read_contacts
    from vbaa_calib.core.robust import finite_median, finite_or_none
    from viz.files.object_file import SUFFIXES, write_object

    refuse_output(args.output, SUFFIXES, args.force, (args.contacts, args.rig))
    table = read_contacts(args.contacts, several=True, antenna=args.antenna)
    if not table.located.any():
        raise InputError("no frame has a located contact", where=args.contacts, remedy="see its reason column")
    rig, shared = None, None
    if args.rig is None:
        say(
            "without --rig the antenna's radius is not known: the surface runs through the antenna's centreline; and "
            "calibration errors count as each contact's own, so that the uncertainty comes out too small"
        )
    else:
        from estimator.contact.common_errors import shared_errors

        rig = usable_rig(args.rig)
        shared = None if table.clamp_moves else shared_errors(rig, table)
    touches = touches_of(table, shared)
    radius = 0.0 if rig is None else rig.of_antenna(str(table.antenna[0])).antenna.radius_at(touches.distance_m)
    surface = reconstruct(touches, radius)
    write_object(surface, args.output, force=args.force)
    patches, soft = int(surface.patch.max()) + 1, surface.compliance
    say(
        f"{args.output}: {len(surface.touched_m)} contacts in {patches} patches, {len(surface.triangles)} triangles, "
        f"{len(surface.lines)} line segments"
    )
    for note in (*surface.notes, soft.reason):
        say(f"  {note}")
    numbers = {
        "median_std_m": finite_median(surface.std_m),
        "median_contact_std_m": finite_median(surface.touched_std_m),
        "stiffness_N_m": soft.stiffness_N_m,
        "stiffness_low_N_m": soft.interval_N_m[0],
        "stiffness_high_N_m": soft.interval_N_m[1],
        "compliance_m_N": soft.compliance_m_N,
        "compliance_std_m_N": soft.std_m_N,
    }
    return {
        "object": str(args.output),
        "contacts": len(surface.touched_m),
        "points": len(surface.points_m),
        "patches": patches,
        "triangles": len(surface.triangles),
        "lines": len(surface.lines),
        "left_out": int(surface.outlier.sum()),
        **{name: finite_or_none(value) for name, value in numbers.items()},
        "stiffness_told": soft.determined,
        "stiffness_in_words": soft.reason,
        "notes": list(surface.notes),
    }
