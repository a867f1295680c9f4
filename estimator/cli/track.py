"""`vbaa track contacts.csv [--rig rig.json] -o track.csv [--smooth smoothed.csv]`."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_antenna, usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_outputs, write_text

if TYPE_CHECKING:
    from estimator.object.track import Track
    from estimator.table.contacts import ContactTable

COLUMNS = (
    *("frame", "time_s", "phase", "slip_m_s", "slip_std_m_s", "longitudinal_m_s", "lateral_m_s"),
    *("slip_X_m_s", "slip_Y_m_s", "slip_Z_m_s", "ringing"),
)
"""Of track.csv; a number that does not exist is an empty cell. The three in capitals are along the world's axes."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("contacts", type=Path, help="contacts.csv or .parquet, as vbaa estimate writes it")
    add_antenna(parser)
    parser.add_argument(
        "--rig", type=Path, help="rig.json of the contacts: separates noise from the calibration's errors"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="TRACK", help="track.csv to write")
    parser.add_argument(
        "--smooth",
        type=Path,
        metavar="CONTACTS",
        help="write the contacts smoothed in time as well, .csv or .parquet (needs --rig)",
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Track the recording and write track.csv. Returns the events and the number of frames in each phase."""
    from estimator.contact.common_errors import shared_errors
    from estimator.object.track import follow, smooth
    from estimator.table.files import check_format, read_contacts, write_contacts

    outputs = [args.output] if args.smooth is None else [args.output, args.smooth]
    refuse_outputs(outputs, args.force, (args.contacts, args.rig))
    if args.output.suffix != ".csv":
        raise InputError("is not a .csv", where=args.output, remedy="name it something.csv")
    if args.smooth is not None:
        check_format(args.smooth)
        if args.rig is None:
            remedy = "give the rig.json that the contacts were made with"
            raise InputError("--smooth needs --rig to separate noise from the calibration's errors", remedy=remedy)
    table = read_contacts(args.contacts, antenna=args.antenna)
    rig = None if args.rig is None else usable_rig(args.rig)
    shared = None if rig is None else shared_errors(rig, table)
    track = follow(table, rig, shared)
    smoothed = None if args.smooth is None or rig is None else smooth(table, rig, shared, track)
    write_text(args.output, _as_csv(table, track), args.force)
    if smoothed is not None:
        write_contacts(args.smooth, smoothed.rows(), args.force)
    counts = Counter(track.phase.tolist())
    say(f"{len(table)} frames: " + ", ".join(f"{count} {phase}" for phase, count in counts.most_common()))
    # printed; --json has all
    most = 20
    for event in track.events[:most]:
        say(f"  {event.words}")
    if len(track.events) > most:
        say(f"  … and {len(track.events) - most} more events: --json has all")
    for line in track.notes:
        say(f"  {line}")
    say("wrote " + ", ".join(map(str, outputs)))
    return {
        "track": str(args.output),
        "smoothed": None if args.smooth is None else str(args.smooth),
        "frames": len(table),
        "phases": dict(counts),
        "ringing": int(track.ringing.sum()),
        "events": [
            {name: None if value != value else value for name, value in vars(event).items()}  # NaN is unknown
            for event in track.events
        ],
        "notes": list(track.notes),
    }


def _as_csv(table: ContactTable, track: Track) -> str:
    """The text of track.csv: a line for every frame of the table."""
    import numpy as np

    def cell(value: float, digits: int = 9) -> str:
        return f"{value:.{digits}g}" if np.isfinite(value) else ""

    lines = [",".join(COLUMNS)]
    speed = np.linalg.norm(track.slip_velocity_m_s, axis=1)
    for i in range(len(table)):
        numbers = (speed[i], track.slip_std_m_s[i], track.longitudinal_m_s[i], track.lateral_m_s[i])
        cells = [cell(value) for value in (*numbers, *track.slip_velocity_m_s[i])]
        begin = (str(table.frame[i]), cell(table.time_s[i], 15), str(track.phase[i]))
        lines.append(",".join((*begin, *cells, str(bool(track.ringing[i])).lower())))
    return "\n".join(lines) + "\n"
