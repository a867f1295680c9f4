"""`vbaa bench`: our numbers beside the alternatives', measured in one run; one subject, or the suite."""

from __future__ import annotations

import argparse
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError

from .subjects import SUBJECTS, Subject

if TYPE_CHECKING:
    from .subjects import Measured

ALL = "all"


MOST_DRAWS, MOST_JOBS = 10_000_000, 256
"""More do not fit into memory: a draw of `metric` takes some 100 bytes, a process some 300 MB."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa bench`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "subjects:\n" + "\n".join(
        f"  {subject.name:<13}{subject.about}\n{'':<15}--draws: {subject.draw}, {subject.draws[0]}, "
        f"with --quick {subject.draws[1]}"
        for subject in SUBJECTS.values()
    )
    suite = ", ".join(subject.name for subject in SUBJECTS.values() if subject.suite)
    jobs = ", ".join(subject.name for subject in SUBJECTS.values() if subject.jobs)
    parser.add_argument(
        "subject",
        nargs="?",
        choices=(*SUBJECTS, ALL),
        metavar="SUBJECT",
        help=f"one of those below, or {ALL} (default, the suite: {suite})",
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="folder for tables and figures, SUBJECT.csv, SUBJECT.png and more, and SUBJECT.json, which says what "
        "they were made with (default: print only)",
    )
    parser.add_argument("--quick", action="store_true", help="a first look: less of everything, within three minutes")
    parser.add_argument("--draws", type=int, help="how much of one subject (default: see below)")
    parser.add_argument("--jobs", type=int, default=1, help=f"processes, of {jobs}; the numbers stay (default: 1)")
    parser.add_argument("--seed", type=int, default=0, help="of everything that is random (default: 0)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Measure one subject, or several one after the other; print the tables, write the files."""
    from .subjects import refuse_folder

    chosen = _chosen(args)
    _check_numbers(args, chosen)
    if args.out:
        refuse_folder(args.out, chosen, args.force)
    return _one(args, chosen[0]) if args.subject in SUBJECTS else _several(args, chosen)


def _chosen(args: argparse.Namespace) -> list[Subject]:
    if args.subject in SUBJECTS:
        return [SUBJECTS[args.subject]]
    return [subject for subject in SUBJECTS.values() if subject.suite or args.subject == ALL]


def _check_numbers(args: argparse.Namespace, chosen: Sequence[Subject]) -> None:
    what = args.subject or "the suite"
    if args.draws is not None and len(chosen) > 1:
        raise InputError(
            f"--draws {args.draws} for {what}", remedy="name one subject: a draw means another thing in each"
        )
    if args.draws is not None and args.draws < chosen[0].least:
        raise InputError(f"--draws {args.draws} for {what}", remedy=f"at least {chosen[0].least}")
    if args.draws is not None and args.draws > MOST_DRAWS:
        raise InputError(f"--draws {args.draws} for {what}", remedy=f"at most {MOST_DRAWS}")
    if args.jobs > MOST_JOBS:
        raise InputError(f"--jobs {args.jobs} for {what}", remedy=f"at most {MOST_JOBS}, one for each core")
    if args.jobs < 1 or (args.jobs > 1 and not any(subject.jobs for subject in chosen)):
        able = " or ".join(subject.name for subject in SUBJECTS.values() if subject.jobs)
        raise InputError(f"--jobs {args.jobs} for {what}", remedy=f"1, or more for {able}")
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}", remedy="a number from 0 on")


def _one(args: argparse.Namespace, subject: Subject) -> dict[str, Any]:
    from .harness import as_json

    measured, _ = _measured(args, subject)
    return as_json(measured.found.numbers) | measured.record


def _measured(args: argparse.Namespace, subject: Subject) -> tuple[Measured, list[Path]]:
    """One subject measured, its table shown, its files written."""
    from .harness import machine
    from .subjects import Measured, write

    options = subject.options(args.seed, args.quick, args.draws, args.jobs)
    begun = time.perf_counter()
    found = subject.measure(options)
    named = machine(subject.packages, found.versions)
    measured = Measured(subject, options, named, found, time.perf_counter() - begun)
    _show(args, measured.text)
    return measured, write(args.out, measured, args.force) if args.out else []


def _show(args: argparse.Namespace, text: str) -> None:
    """A table: on stdout, unless that is kept for JSON."""
    if args.json:
        say(text)
    else:
        print(text, flush=True)


def _several(args: argparse.Namespace, chosen: Sequence[Subject]) -> dict[str, Any]:
    """Each subject in turn, whatever becomes of the others; a summary at the end."""
    from .harness import Line, as_json, as_text

    lines: list[Line] = []
    numbers: dict[str, Any] = {}
    for place, subject in enumerate(chosen, start=1):
        where = f"{place} of {len(chosen)}: {subject.name}"
        say(where)
        begun = time.perf_counter()
        try:
            measured, files = _measured(args, subject)
        # whatever a subject or a peer of it raises must not lose what the others find
        except Exception as error:
            if args.debug:
                traceback.print_exc()
            lines.append(Line(subject.name, "", time.perf_counter() - begun, (), f"{type(error).__name__}: {error}"))
        else:
            names = tuple(path.name for path in files)
            lines.append(Line(subject.name, measured.found.headline, time.perf_counter() - begun, names))
            numbers[subject.name] = as_json(measured.found.numbers) | measured.record
        say(f"{where}, {'failed after' if lines[-1].failure else 'done in'} {lines[-1].seconds:.0f} s")
        _show(args, "")
    _show(args, as_text(lines))
    failed = {line.subject: line.failure for line in lines if line.failure}
    return {"subjects": numbers, "failed": failed, "exit_code": int(bool(failed))}
