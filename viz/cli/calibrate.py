"""`vbaa calibrate`: a session to rig.json; or several sessions of one rig over time to a rig for each, a table and a
page."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.cli.options import add_lens_file, wanted_of
from vbaa_calib.core.console import say
from vbaa_calib.core.csv_rows import csv_text, read_csv
from vbaa_calib.core.errors import InputError, VbaaError
from vbaa_calib.core.files import read_json, refuse_overwrite, sha256, write_json, write_text
from vbaa_calib.core.folders import make_folder
from viz.cli.intrinsics import MODELS

if TYPE_CHECKING:
    from vbaa_calib.rig.over_time import OverTime


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session",
        type=Path,
        nargs="+",
        help="the session folder (docs/formats.md); or many of one rig over time, with their dates in their names, or "
        "a CSV with the columns session and date",
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="rig.json to write; a folder for the rigs of many sessions"
    )
    parser.add_argument(
        "--lens-model",
        dest="model",
        default="auto",
        choices=MODELS,
        help="lens model (default: the one with the smallest expected error)",
    )
    parser.add_argument(
        "--camera",
        type=Path,
        metavar="FILE",
        help="start from a known lens: camera.json, rig.json, or any file that `vbaa convert` reads; "
        "intrinsics/ is not needed then, and tests it if it is there",
    )
    add_lens_file(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate; the exit code is 1 where the verdict is wrong."""
    sessions = args.session
    if len(sessions) == 1 and sessions[0].suffix != ".csv":
        args.session = sessions[0]
        return _one(args)
    return _over_time(args, _dated(sessions))


def _one(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate one session and write rig.json."""
    from estimator.budget.budget import next_observations
    from vbaa_calib.calibrate.given_lens import read_lens
    from vbaa_calib.calibrate.pipeline import calibrate
    from vbaa_calib.calibrate.report import report, rig_document, summary
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import load_session, refuse_measured

    inputs = [] if args.camera is None else [args.camera]
    refuse_overwrite(args.output, args.force, inputs)
    wanted = wanted_of(args, args.camera)
    if inputs and args.model != "auto":
        raise InputError("--camera brings its lens model", where="--lens-model", remedy="leave one of the two out")
    refuse_measured(args.output, args.session)
    session = load_session(args.session)
    known = None if args.camera is None else read_lens(args.camera, wanted)
    calibration = calibrate(session, args.model, known)
    guide = next_observations(calibration)
    report(calibration)
    if guide:
        say(f"next       {guide['words']}")
    write_json(args.output, rig_document(calibration, args.argv, guide), args.force, Rig.from_dict)
    say(f"wrote {args.output}")
    described = calibration.rig.to_dict()
    numbers = {key: described[key] for key in ("verdict", "T_antenna_camera", "antenna", "moment_sensor")}
    code = int(calibration.rig.verdict.severity == "wrong")
    return {"rig": str(args.output), **summary(calibration), **numbers, "guide": guide, "exit_code": code}


def _over_time(args: argparse.Namespace, sessions: list[tuple[datetime, Path]]) -> dict[str, Any]:
    from vbaa_calib.rig import Rig
    from vbaa_calib.rig.over_time import over_time
    from viz.report.over_time import page, words

    root = args.output
    if root.suffix == ".json" or (root.exists() and not root.is_dir()):
        raise InputError("is not a folder", where=root, remedy="many sessions make a folder: give -o rigs/")
    names = [path.absolute().name for _, path in sessions]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"two sessions are named {twice}", remedy="give each its own name")
    make_folder(root)
    rigs, days, failed, wrong = [], [], dict[str, str](), list[str]()
    for (date, path), name in zip(sessions, names, strict=True):
        output = root / f"{name}.json"
        try:
            if args.force or not _unchanged(output, path):
                say(f"{name}:")
                _one(argparse.Namespace(**{**vars(args), "session": path, "output": output, "force": True}))
            rigs.append(Rig.load(output))
            if rigs[-1].verdict.severity == "wrong":
                wrong.append(f"{name}: wrong: {rigs[-1].verdict.causes}")
            days.append((date - sessions[0][0]).total_seconds() / 86400.0)
        except VbaaError as error:
            say(f"{name}: {error}")
            failed[name] = str(error)
    if len(rigs) < 2:
        raise InputError("fewer than two sessions were calibrated", where=root, remedy="see the message on each")
    found = over_time(rigs, days)
    dates = [f"{date:%Y-%m-%d %H:%M}" for (date, _), name in zip(sessions, names, strict=True) if name not in failed]
    lines = [*words(found), *wrong, *(f"{name} was left out: {why}" for name, why in failed.items())]
    write_text(root / "over_time.csv", _table_csv(found, dates))
    write_text(root / "over_time.html", page(str(root), found, dates, lines))
    for line in lines:
        say(line)
    say(f"wrote {root / 'over_time.html'}")
    return {
        "rigs": str(root),
        "sessions": len(sessions),
        "failed": failed,
        "dates": dates,
        "scatter": [name for name, is_so in zip(found.names, found.scatters, strict=True) if is_so],
        "drift": [name for name, is_so in zip(found.names, found.drifts, strict=True) if is_so],
        "exit_code": 1 if failed or wrong else 0,
    }


def _unchanged(output: Path, session: Path) -> bool:
    """Whether a rig was made from the present content of the session."""
    if not output.exists():
        return False
    try:
        made_from = read_json(output).get("inputs_sha256") or {}
        return bool(made_from) and all(sha256(session / name) == digest for name, digest in made_from.items())
    except (InputError, AttributeError):
        return False


def _dated(known: list[Path]) -> list[tuple[datetime, Path]]:
    """Sessions by date, from a CSV with the columns session and date, or from the folders' names.

    Raises InputError for a session without a known date.
    """
    found: list[tuple[datetime, Path]] = []
    for path in known:
        if path.suffix == ".csv":
            for row in read_csv(path, ("session", "date")):
                place = f"{path} line {row['line']}"
                try:
                    date = datetime.fromisoformat(row["date"]).replace(tzinfo=None)
                except ValueError:
                    remedy = "give 2026-11-24, or 2026-11-24T10:30"
                    raise InputError(f"date is {row['date']!r}", where=place, remedy=remedy) from None
                found.append((date, path.parent / row["session"]))
            continue
        # a link has a name of its own
        pattern = r"(?<!\d)(\d{4})-?(\d\d)-?(\d\d)(?:[T_-]?(\d\d)[:-]?(\d\d))?(?!\d)"
        date_of = re.search(pattern, path.absolute().name)
        try:
            if date_of is None:
                raise ValueError
            year, month, day, hour, minute = (int(each or 0) for each in date_of.groups())
            found.append((datetime(year, month, day, hour, minute), path))
        except ValueError:
            remedy = "put its date into its name (2026-11-24), or give a CSV with the columns session and date"
            raise InputError("its date is not known", where=path, remedy=remedy) from None
    return sorted(found, key=lambda each: each[0])


def _table_csv(found: OverTime, dates: Sequence[str]) -> str:
    """A CSV with a row for each parameter and calibration: the change since the first."""
    columns, rows = ("parameter", "date", "days", "change", "std", "deviations_from_mean"), []
    for column, name in enumerate(found.names):
        for row, date in enumerate(dates):
            value, std = found.values[row, column], found.std[row, column]
            off = (value - found.mean[column]) / std if std > 0.0 else np.nan
            cells = (found.days[row], value, std, off)
            numbers = (f"{cell:.9g}" if np.isfinite(cell) else "" for cell in cells)
            rows.append(dict(zip(columns, (name, date, *numbers), strict=True)))
    return csv_text(rows, columns)
