"""`vbaa bench`: our numbers beside the alternatives', measured in one run."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..console import say
from ..errors import InputError
from ..files import refuse_overwrite

SUBJECTS = ("metric", "calibration")
POINTS, QUICK_POINTS = 1_000_000, 100_000
DRAWS, QUICK_DRAWS = 10, 3
PACKAGES = {
    "metric": ("numpy", "opencv-contrib-python-headless", "torch", "kornia"),
    "calibration": ("numpy", "scipy", "opencv-contrib-python-headless"),
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa bench`."""
    parser.add_argument(
        "subject",
        choices=SUBJECTS,
        help="metric: undistortion by OpenCV, kornia and the metric layer; calibration: lens solves by OpenCV "
        "and ours, in mm on plane C",
    )
    parser.add_argument(
        "--out", type=Path, help="folder for the table (and the figure of metric): SUBJECT.csv (default: print only)"
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{QUICK_POINTS} points in place of {POINTS}, {QUICK_DRAWS} draws in place of {DRAWS}",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the random pixels and views (default: 0)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run one benchmark; print its table, write its files."""
    from .timing import machine

    suffixes = ("csv", "png") if args.subject == "metric" else ("csv",)
    files = [args.out / f"{args.subject}.{suffix}" for suffix in suffixes] if args.out else []
    if args.out and not args.out.is_dir():
        raise InputError("no such folder", where=args.out, remedy="create it first")
    for path in files:
        refuse_overwrite(path, args.force)
    named = machine(PACKAGES[args.subject])
    subject = _metric if args.subject == "metric" else _calibration
    table, result = subject(args, files)
    table = f"{named}, seed {args.seed}\n{table}"
    if args.json:
        say(table)
    else:
        print(table)
    return {"machine": named, "seed": args.seed, **result}


def _metric(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from .metric import run as measure
    from .metric_report import as_text, write_figure
    from .rows import write_csv

    points = QUICK_POINTS if args.quick else POINTS
    rows = measure(points, args.seed, repeats=3 if args.quick else 5)
    if files:
        write_csv(files[0], rows, args.force)
        write_figure(files[1], rows, points, args.force)
    return as_text(rows, points), {"points": points, "rows": [asdict(row) for row in rows]}


def _calibration(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from .calibration import run as measure
    from .calibration_report import as_text
    from .rows import write_csv

    draws = QUICK_DRAWS if args.quick else DRAWS
    rows = measure(draws, args.seed)
    if files:
        write_csv(files[0], rows, args.force)
    return as_text(rows, draws), {"draws": draws, "rows": [asdict(row) for row in rows]}
