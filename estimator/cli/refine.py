"""`vbaa refine contacts.csv --rig rig.json --session SESSION -o refined.csv`: all frames of a recording in one
problem."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_accept_rig, add_antenna, usable_rig
from vbaa_calib.core.console import progress, say
from vbaa_calib.core.errors import InputError, about
from vbaa_calib.core.files import refuse_outputs, sha256, write_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.recording import Refined
    from estimator.table.contacts import ContactTable, Measured
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Session


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("contacts", type=Path, help="contacts.csv or .parquet, as vbaa estimate writes it")
    add_antenna(parser)
    parser.add_argument("--rig", type=Path, required=True, help="rig.json that the contacts were made with")
    parser.add_argument("--session", type=Path, required=True, help="the session folder that they were made of")
    parser.add_argument("-o", "--output", type=Path, required=True, help="refined.csv to write, or .parquet")
    parser.add_argument(
        "--update-rig",
        type=Path,
        metavar="RIG",
        help="write the rig as the recording determines it; best with known_object in session.yaml",
    )
    add_accept_rig(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Solve the recording in one problem, write refined.csv and, if asked for, the rig."""
    from estimator.recording import refine
    from estimator.table.files import check_format, read_contacts, write_contacts
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import refuse_measured

    outputs = [args.output] if args.update_rig is None else [args.output, args.update_rig]
    refuse_outputs(outputs, args.force, (args.contacts, args.rig))
    for path in outputs:
        refuse_measured(path, args.session)
    check_format(args.output)
    if args.update_rig is not None and args.update_rig.suffix != ".json":
        raise InputError("is not a .json", where=args.update_rig, remedy="name it something.json")
    table = read_contacts(args.contacts, antenna=args.antenna)
    rig, session, recording = _recording(table, args.rig, args.session, args.accept_rig)
    with about(args.contacts):
        found = refine(table, rig, recording, session.known_object)
    write_contacts(args.output, found.contacts.rows(), args.force)
    if args.update_rig is not None and not found.reason:
        write_json(args.update_rig, _document(args, found), args.force, Rig.from_dict)
    for line in _words(found):
        say(line)
    if args.update_rig is not None and found.reason:
        say(f"{args.update_rig} is not written")
        outputs = outputs[:1]
    say("wrote " + ", ".join(map(str, outputs)))
    updated = str(args.update_rig) if args.update_rig in outputs else None
    return {
        "contacts": str(args.output),
        "updated_rig": updated,
        "exit_code": 1 if args.update_rig is not None and updated is None else 0,
        **found.summary(),
    }


def _recording(
    table: ContactTable, rig_json: Path, folder: Path, accept_rig: bool
) -> tuple[Rig, Session, Sequence[Measured]]:
    """The rig, and the measurements of the table's frames. Raises InputError where the session has other frames."""
    import numpy as np

    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.recording import measured_recording
    from vbaa_calib.session import SILENT, check_pictures, load_session, read_recording

    rig, session = usable_rig(rig_json, accept_rig), load_session(folder)
    if session.drift is not None:
        rig = replace(rig, drift=session.drift)
    frames = {frame.frame: frame for frame in read_recording(session)}
    where = session.root / "recording" / "recording.csv"
    unknown = [int(each) for each in table.frame if int(each) not in frames]
    remedy = "give the session that the contacts were made of"
    if unknown:
        raise InputError(f"has no frame {unknown[0]}, which is among the contacts", where=where, remedy=remedy)
    chosen = [frames[int(each)] for each in table.frame]
    times = np.abs(np.array([frame.time_s for frame in chosen]) - table.time_s)
    if (times > 1e-6).any():
        what = f"frame {int(table.frame[np.argmax(times)])} has another time than among the contacts"
        raise InputError(what, where=where, remedy=remedy)
    pictures = [frame.image for frame in chosen if frame.image is not None]
    check_pictures(pictures, rig.camera.image_size, "the rig was calibrated at")
    # with --no-moment the readings were left aside
    silent = np.isnan(table.moment_residual_Nm) & table.located & rig.moment_sensor.exists
    chosen = [replace(frame, **SILENT) if quiet else frame for frame, quiet in zip(chosen, silent, strict=True)]
    measured = measured_recording(ContactEstimator(rig), session, chosen)
    return rig, session, list(progress(measured, "frames", len(chosen)) if pictures else measured)


def _words(found: Refined) -> list[str]:
    if found.reason:
        return [f"not refined: {found.reason}", "the contacts are unchanged"]
    numbers = found.summary()
    before, after = (1e3 * (numbers["distance_std_m"][name] or 0.0) for name in ("framewise", "refined"))
    common = 1e3 * (numbers["distance_shared_std_m"]["refined"] or 0.0)
    lines = [
        f"{numbers['refined']} of {numbers['located']} contacts refined: distance known to {after:.2f} mm (rms), "
        f"{common:.2f} mm of it common to all; before, frame by frame, to {before:.2f} mm",
        f"the rig is off by {found.offness:.1f} standard deviations of its calibration",
    ]
    mu = found.friction
    if mu is not None:
        lines.append(f"friction {mu.mu:.3f} ± {mu.std:.3f}, {mu.reason}" if mu.determined else f"friction: {mu.reason}")
    if found.object is not None:
        lines.append(found.object.compliance.reason)
    return [*lines, *found.notes]


def _document(args: argparse.Namespace, found: Refined) -> dict[str, Any]:
    """rig.json with the refined rig and its provenance."""
    inputs = {path.name: sha256(path) for path in (args.rig, args.contacts)}
    return {
        **found.rig.to_dict(),
        "refined": {
            key: value for key, value in found.summary().items() if key in ("frames", "refined", "notes", "rig")
        },
        "inputs_sha256": inputs,
        "command": list(args.argv),
    }
