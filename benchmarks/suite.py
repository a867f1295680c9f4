"""`vbaa bench`: our numbers beside the alternatives', measured in one run; the subjects, and what each leaves."""

from __future__ import annotations

import argparse
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.files import read_yaml, refuse_overwrite, replacing, write_json

from .harness import AGAINST, Findings, Options, aligned, as_json, in_a_line, machine, write_csv

ALL = "all"
_MOST_DRAWS = 10_000_000
"""More do not fit into memory: a draw of `metric` takes some 100 bytes."""
_DPI = 110


@dataclass(frozen=True)
class Subject:
    """One subject of subjects.yaml, measured by `measure(options)` of its module.

    about : one line of help. draw : what a draw is, in words. draws : how many, usually and with --quick.
    left : tables (.csv) and figures (.png) that it leaves (default: NAME.csv NAME.png). least : fewest draws that say
    anything. suite : whether `vbaa bench` without a subject runs it.
    packages : those whose versions are named beside ours. module : in `benchmarks`, if it is not called NAME.
    """

    name: str
    about: str
    draw: str
    draws: Sequence[int]
    left: str = ""
    least: int = 1
    suite: bool = False
    packages: str = "numpy scipy opencv-contrib-python-headless torch"
    module: str = ""

    @property
    def files(self) -> tuple[str, ...]:
        """Tables and figures, all of them."""
        return tuple((self.left or f"{self.name}.csv {self.name}.png").split())

    @property
    def record(self) -> str:
        """File that says what the others were made with."""
        return f"{self.name}.json"


SUBJECTS = {name: Subject(name, **said) for name, said in read_yaml(Path(__file__).with_name("subjects.yaml")).items()}
"""Name → subject, in the order in which they are run."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa bench`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "subjects:\n" + "\n".join(
        f"  {subject.name:<13}{subject.about}\n{'':<15}--draws: {subject.draw}, {subject.draws[0]}, "
        f"with --quick {subject.draws[1]}"
        for subject in SUBJECTS.values()
    )
    suite = ", ".join(one.name for one in SUBJECTS.values() if one.suite)
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
    parser.add_argument("--seed", type=int, default=0, help="of everything that is random (default: 0)")
    parser.add_argument("--against", default=AGAINST, metavar="COMMIT", help=f"of waiting (default: {AGAINST})")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Measure one subject, or several one after the other; print the tables, write the files."""
    one = args.subject in SUBJECTS
    chosen = (
        [SUBJECTS[args.subject]] if one else [each for each in SUBJECTS.values() if each.suite or args.subject == ALL]
    )
    _refuse(args, chosen)
    return _measured(args, chosen[0])[0] if one else _several(args, chosen)


def _refuse(args: argparse.Namespace, chosen: Sequence[Subject]) -> None:
    """What makes no sense, or would overwrite something, before any work."""
    what, draws = args.subject or "the suite", args.draws
    for wrong, said, remedy in (
        (draws is not None and len(chosen) > 1, "draws", "name one subject: a draw means another thing in each"),
        (draws is not None and draws < chosen[0].least, "draws", f"at least {chosen[0].least}"),
        (draws is not None and draws > _MOST_DRAWS, "draws", f"at most {_MOST_DRAWS}"),
        (args.seed < 0, "seed", "a number from 0 on"),
    ):
        if wrong:
            raise InputError(f"--{said} {getattr(args, said)} for {what}", remedy=remedy)
    if args.out is None:
        return
    if args.out.exists() and not args.out.is_dir():
        raise InputError("is a file, not a folder", where=args.out, remedy="take another name")
    for name in (name for subject in chosen for name in (*subject.files, subject.record)):
        refuse_overwrite(args.out / name, args.force)


def _measured(args: argparse.Namespace, subject: Subject) -> tuple[dict[str, Any], str]:
    """One subject measured, its table shown, its files written: its numbers with what they were made with; headline."""
    draws = args.draws or subject.draws[args.quick]
    options = Options(args.seed, draws, args.quick, args.against)
    begun = time.perf_counter()
    measure: Callable[[Options], Findings] = import_module(f"benchmarks.{subject.module or subject.name}").measure
    found = measure(options)
    ran_on = machine(subject.packages.split(), found.versions)
    quick = ", quick" if args.quick else ""
    _show(args, f"{in_a_line(ran_on)}, {draws} {subject.draw}, seed {args.seed}{quick}\n{found.text}")
    flags = [f"--draws {draws}", f"--seed {args.seed}", *(["--quick"] if args.quick else [])]
    record = {
        "subject": subject.name,
        "headline": found.headline,
        "command": " ".join(["vbaa", "bench", subject.name, *flags]),
        "draw": subject.draw,
        "draws": draws,
        "seed": args.seed,
        "quick": args.quick,
        "machine": ran_on,
        "files": list(subject.files),
        "seconds": round(time.perf_counter() - begun, 1),
    }
    if args.out:
        _write(args, subject, found, record)
    return as_json(found.numbers) | record, found.headline


def _write(args: argparse.Namespace, subject: Subject, found: Findings, record: dict[str, Any]) -> None:
    """All files of one subject: a table or figure that fails leaves none of them.

    Raises SolveError for a table without rows, and where the files are not those that the subject is known for.
    """
    if {*found.tables, *found.figures} != set(subject.files):
        raise SolveError(f"{subject.name} has {sorted({*found.tables, *found.figures})}, not {sorted(subject.files)}")
    empty = [name for name, rows in found.tables.items() if not rows]
    if empty:
        raise SolveError(f"{subject.name} found nothing for {', '.join(empty)}: nothing is written")
    names = (*subject.files, subject.record)
    with ExitStack() as stack:
        ready = {name: stack.enter_context(replacing(args.out / name, args.force)) for name in names}
        for name, rows in found.tables.items():
            write_csv(ready[name], rows, force=True)
        for name, draw in found.figures.items():
            draw().savefig(ready[name], dpi=_DPI)
        write_json(ready[subject.record], record)


def _show(args: argparse.Namespace, text: str) -> None:
    """A table: on stdout, unless that is kept for JSON."""
    if args.json:
        say(text)
    else:
        print(text, flush=True)


def _several(args: argparse.Namespace, chosen: Sequence[Subject]) -> dict[str, Any]:
    """Each subject in turn, whatever becomes of the others; a summary at the end."""
    lines = [["subject", "s", "what it comes down to"]]
    numbers: dict[str, Any] = {}
    failed: dict[str, str] = {}
    started = time.perf_counter()
    for place, subject in enumerate(chosen, start=1):
        where = f"{place} of {len(chosen)}: {subject.name}"
        say(where)
        begun = time.perf_counter()
        try:
            numbers[subject.name], words = _measured(args, subject)
        # whatever a subject or a peer of it raises must not lose what the others find
        except Exception as error:
            if args.debug:
                traceback.print_exc()
            failed[subject.name] = f"{type(error).__name__}: {error}"
            words = f"failed: {failed[subject.name]}"
        seconds = f"{time.perf_counter() - begun:.0f}"
        lines.append([subject.name, seconds, words])
        if args.out and subject.name in numbers:
            lines.append(["", "", ", ".join((*subject.files, subject.record))])
        say(f"{where}, {'failed after' if subject.name in failed else 'done in'} {seconds} s")
        _show(args, "")
    total = f"{time.perf_counter() - started:.0f}"
    lines.append(["all", total, f"{len(numbers)} of {len(chosen)} subjects measured"])
    _show(args, aligned(lines, (True, False, True)))
    return {"subjects": numbers, "failed": failed, "exit_code": int(bool(failed))}
