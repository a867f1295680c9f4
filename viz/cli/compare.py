"""`vbaa compare A B`: two contacts files, results of vbaa batch, or rigs side by side."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import write_text
from viz.files.outputs import PAGES, refuse_output

if TYPE_CHECKING:
    from viz.report.compare import ComparedContacts

_MOST_LINES = 10


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="contacts.csv or .parquet, a results folder, or rig.json")
    parser.add_argument("b", type=Path, metavar="B", help="another of the same kind")
    parser.add_argument(
        "--tolerance",
        type=float,
        default=3.0,
        metavar="STD",
        help="how many deviations two numbers may lie apart (default: 3); two versions on the same data: 0.1",
    )
    parser.add_argument(
        "--allow",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="the share of frames that may be further apart or have another status (default: 0)",
    )
    parser.add_argument("--html", type=Path, metavar="PAGE", help="write a page that opens offline in any browser")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Compare two results; the exit code is 1 where they differ by more than the tolerance."""
    if not (args.tolerance > 0.0 and math.isfinite(args.tolerance)):
        raise InputError(f"--tolerance is {args.tolerance:g}", remedy="give a number of deviations, above 0")
    if not 0.0 <= args.allow <= 1.0:
        raise InputError(f"--allow is {args.allow:g}", remedy="give a share of the frames, 0 to 1")
    if args.html is not None:
        refuse_output(args.html, PAGES, args.force, (args.a, args.b))
    kinds = [_kind(path) for path in (args.a, args.b)]
    if kinds[0] != kinds[1]:
        names = {"rigs": "a rig", "results": "a results folder", "contacts": "a table of contacts"}
        what = f"{args.a} is {names[kinds[0]]}, {args.b} {names[kinds[1]]}"
        raise InputError(what, where="vbaa compare", remedy="give two of a kind")
    result, page = (_rigs if kinds[0] == "rigs" else _contacts)(args, kinds[0])
    for line in (*result["words"], *result.get("missing", ())[:_MOST_LINES]):
        say(line)
    say("they agree" if result["agree"] else "they differ")
    if args.html is not None:
        write_text(args.html, page, args.force)
        say(f"wrote {args.html}")
    return {"kind": kinds[0], **result, "exit_code": 0 if result["agree"] else 1}


def _kind(path: Path) -> str:
    if path.is_dir():
        return "results"
    return "rigs" if path.suffix == ".json" else "contacts"


def _rigs(args: argparse.Namespace, _kind: str) -> tuple[dict[str, Any], str]:
    from vbaa_calib.rig import Rig
    from viz.report.compare import compare_rigs, rigs_page

    compared = compare_rigs(Rig.load(args.a), Rig.load(args.b))
    numbers = compared.to_dict(args.tolerance)
    beyond = numbers["beyond"]
    far = [name for name in beyond if name not in compared.settings]
    words = [f"{len(compared.names)} parameters compared, {len(far)} of them off{': ' * bool(far)}{', '.join(far)}"]
    words += [f"{name} is not the same" for name in compared.settings]
    result = {"tolerance": args.tolerance, **numbers, "agree": not beyond, "words": words}
    return result, rigs_page(_title(args), compared, result)


def _contacts(args: argparse.Namespace, kind: str) -> tuple[dict[str, Any], str]:
    from estimator.table.files import read_contacts
    from viz.report.compare import compare_contacts, contacts_page

    of_a, of_b = ({"contacts": path} if kind == "contacts" else _tables(path) for path in (args.a, args.b))
    both = sorted(set(of_a) & set(of_b))
    compared = {name: compare_contacts(read_contacts(of_a[name]), read_contacts(of_b[name])) for name in both}
    missing = [f"{name} is not in B" for name in sorted(set(of_a) - set(of_b))]
    missing += [f"{name} is not in A" for name in sorted(set(of_b) - set(of_a))]
    off, count = (
        sum(each.off(args.tolerance) for each in compared.values()),
        sum(each.count for each in compared.values()),
    )
    words = [f"{off} of {count} frames differ by more than {args.tolerance:g} deviations or in their status"]
    words += [line for name, each in compared.items() for line in _lines(name, each, args.tolerance)][:_MOST_LINES]
    result = {
        "tolerance": args.tolerance,
        "allow": args.allow,
        "agree": off <= args.allow * count and not missing,
        "frames": count,
        "off": off,
        "missing": missing,
        "recordings": {name: each.to_dict(args.tolerance) for name, each in compared.items()},
        "words": words,
    }
    return result, contacts_page(_title(args), compared, missing, result)


def _lines(name: str, one: ComparedContacts, tolerance: float) -> list[str]:
    if not one.off(tolerance):
        return []
    changed = [f"{count} x {a} to {b}" for (a, b), count in one.changed.items()]
    largest = one.to_dict(tolerance)["deviations"]
    largest_words = [
        f"{what} {each['largest']:.2g}" for what, each in largest.items() if each and each["largest"] is not None
    ]
    alone = [f"{count} frames only in {side}" for side, count in (("A", one.only_a), ("B", one.only_b)) if count]
    return [f"{name}: " + "; ".join([*changed, *alone, "largest deviations: " + (", ".join(largest_words) or "none")])]


def _tables(root: Path) -> dict[str, Path]:
    """The contacts of a batch, by recording. Raises InputError for another folder."""
    found = {path.parent.name.partition("=")[2]: path for path in root.glob("contacts/recording=*/contacts.parquet")}
    if not found:
        raise InputError("holds no results of vbaa batch", where=root, remedy="name the folder that it wrote")
    return found


def _title(args: argparse.Namespace) -> str:
    return f"{args.a} and {args.b}"
