"""`vbaa bench metric`: speed against error, in one run with the alternatives."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..console import say
from ..errors import InputError
from ..files import refuse_overwrite

SUBJECTS = ("metric",)
POINTS, QUICK_POINTS = 1_000_000, 100_000
PACKAGES = ("numpy", "opencv-contrib-python-headless", "torch", "kornia")


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa bench`."""
    parser.add_argument("subject", choices=SUBJECTS, help="metric: undistortion by OpenCV, kornia and the metric layer")
    parser.add_argument(
        "--out", type=Path, help="folder for the table, metric.csv and metric.png (default: print only)"
    )
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_POINTS} points in place of {POINTS}")
    parser.add_argument("--seed", type=int, default=0, help="of the random pixels (default: 0)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run one benchmark; print its table, write its files."""
    from .metric import run as measure
    from .metric_report import as_text, write_csv, write_figure
    from .timing import machine

    files = [args.out / f"{args.subject}.{suffix}" for suffix in ("csv", "png")] if args.out else []
    if args.out and not args.out.is_dir():
        raise InputError("no such folder", where=args.out, remedy="create it first")
    for path in files:
        refuse_overwrite(path, args.force)
    points = QUICK_POINTS if args.quick else POINTS
    rows = measure(points, args.seed, repeats=3 if args.quick else 5)
    named = machine(PACKAGES)
    table = f"{named}, seed {args.seed}\n{as_text(rows, points)}"
    if args.json:
        say(table)
    else:
        print(table)
    if files:
        write_csv(files[0], rows, args.force)
        write_figure(files[1], rows, points, args.force)
    return {"machine": named, "seed": args.seed, "points": points, "rows": [asdict(row) for row in rows]}
