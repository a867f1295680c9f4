"""`vbaa bench`: our numbers beside the alternatives', measured in one run."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..console import say
from ..errors import InputError
from ..files import refuse_overwrite

SUBJECTS = ("metric", "calibration", "guided", "coverage", "vision", "estimator", "object", "paper")
POINTS, QUICK_POINTS = 1_000_000, 100_000
DRAWS = {
    "calibration": (20, 3),
    "guided": (20, 1),
    "coverage": (500, 20),
    "vision": (40, 4),
    "estimator": (400, 12),
    "object": (10, 1),
    "paper": (16, 2),
}
"""Subject → noise draws (vision: pictures of each hardship; estimator and object: of each cell), and with --quick."""
LEAST_DRAWS = {"calibration": 1, "guided": 1, "coverage": 2, "vision": 1, "estimator": 4, "object": 1, "paper": 1}
FIGURES = ("metric", "guided", "coverage", "vision", "estimator", "object")
FREE_FRAMES_PER_DRAW = 2_000
"""Frames without contact in which a first contact would be a false alarm, for each of object's draws."""
HOSTILE_PER_DRAW = 25
"""Pictures with and without an antenna, at random, for each of vision's draws."""
PACKAGES = {
    "metric": ("numpy", "opencv-contrib-python-headless", "torch", "kornia"),
    "calibration": ("numpy", "scipy", "opencv-contrib-python-headless"),
    **dict.fromkeys(("guided", "coverage"), ("numpy", "scipy", "opencv-contrib-python-headless", "torch")),
    "vision": ("numpy", "scipy", "opencv-contrib-python-headless"),
    **dict.fromkeys(("estimator", "object", "paper"), ("numpy", "scipy", "torch")),
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa bench`."""
    parser.add_argument(
        "subject",
        choices=SUBJECTS,
        help="metric: undistortion by OpenCV, kornia and the metric layer; calibration: lens solves by OpenCV, "
        "lensboy and mrcal (where an interpreter has them: VBAA_PEER_PYTHON) and ours, in mm on plane C; guided: "
        "pictures for the lens at suggested and at random poses, until plane C is known; coverage: "
        "whether the deviations that whole calibrations predict are those that sampling shows; vision: the antenna in "
        "hard pictures, beside other methods; estimator: contacts against the Cramér-Rao bound, speed against error, "
        "hard cases, random scenes; object: objects stroked by the antenna: surface, normals, friction, stiffness, "
        "first contact; paper: the paper's experiments redone (docs/experiments.md)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="folder for the table and (not of calibration) the figure: SUBJECT.csv, SUBJECT.png (default: print only)",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{QUICK_POINTS} points in place of {POINTS}; fewer draws",
    )
    usual = ", ".join(f"{subject}: {most}, quick {few}" for subject, (most, few) in DRAWS.items())
    parser.add_argument("--draws", type=int, help=f"noise draws a rig (default: {usual})")
    parser.add_argument("--jobs", type=int, default=1, help="processes, coverage alone; the numbers stay (default: 1)")
    parser.add_argument("--seed", type=int, default=0, help="of the random pixels, views and noise (default: 0)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run one benchmark; print its table, write its files."""
    from .timing import machine

    _check_numbers(args)
    suffixes = ("csv", "png") if args.subject in FIGURES else ("csv",)
    files = [args.out / f"{args.subject}.{suffix}" for suffix in suffixes] if args.out else []
    if args.out and not args.out.is_dir():
        raise InputError("no such folder", where=args.out, remedy="create it first")
    for path in files:
        refuse_overwrite(path, args.force)
    named = machine(PACKAGES[args.subject])
    subjects = {"metric": _metric, "calibration": _calibration, "coverage": _coverage, "vision": _vision}
    measure = (subjects | {"guided": _guided, "estimator": _estimator, "object": _object, "paper": _paper})[
        args.subject
    ]
    table, result = measure(args, files)
    table = f"{named}, seed {args.seed}\n{table}"
    if args.json:
        say(table)
    else:
        print(table)
    return {"machine": named, "seed": args.seed, **result}


def _check_numbers(args: argparse.Namespace) -> None:
    least = LEAST_DRAWS.get(args.subject)
    if args.draws is not None and (least is None or args.draws < least):
        remedy = "leave it out" if least is None else f"at least {least}"
        raise InputError(f"--draws {args.draws} for {args.subject}", remedy=remedy)
    if args.jobs < 1 or (args.jobs > 1 and args.subject != "coverage"):
        raise InputError(f"--jobs {args.jobs} for {args.subject}", remedy="1, or more for coverage")
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}", remedy="a number from 0 on")


def _draws(args: argparse.Namespace) -> int:
    usual, quick = DRAWS[args.subject]
    return int(args.draws or (quick if args.quick else usual))


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

    draws = _draws(args)
    rows = measure(draws, args.seed)
    if files:
        write_csv(files[0], rows, args.force)
    return as_text(rows, draws), {"draws": draws, "rows": [asdict(row) for row in rows]}


def _guided(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from .guided import run as measure
    from .guided_report import as_text, write_figure
    from .rows import write_csv

    draws = _draws(args)
    rows = measure(draws, args.seed)
    if files:
        write_csv(files[0], rows, args.force)
        write_figure(files[1], rows, args.force)
    return as_text(rows, draws), {"draws": draws, "rows": [asdict(row) for row in rows]}


def _coverage(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from .coverage import run as measure
    from .coverage_report import as_text, write_figure
    from .rows import write_csv

    draws = _draws(args)
    rows, rigs = measure(draws, args.seed, args.jobs)
    if files and rows:
        write_csv(files[0], rows, args.force)
        write_figure(files[1], rows, draws, args.force)
    result = {"draws": draws, "rows": [asdict(row) for row in rows], "rigs": [asdict(rig) for rig in rigs]}
    return as_text(rows, rigs, draws), result


def _vision(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from .rows import write_csv
    from .vision import hardships, hostile, methods
    from .vision_report import as_text, write_figure

    draws = _draws(args)
    beside = files[0].with_name("vision_methods.csv") if files else None
    if beside:
        refuse_overwrite(beside, args.force)
    compared = methods(max(draws // 4, 2), args.seed, repeats=5 if args.quick else 15)
    hard, mixed = hardships(draws, args.seed), hostile(HOSTILE_PER_DRAW * draws, args.seed)
    if files and beside:
        write_csv(files[0], hard, args.force)
        write_csv(beside, compared, args.force)
        write_figure(files[1], compared, hard, args.force)
    return as_text(compared, hard, mixed), {
        "methods": [asdict(row) for row in compared],
        "hardships": [asdict(row) for row in hard],
        "hostile": [asdict(row) for row in mixed],
    }


def _estimator(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from . import estimator_figure, estimator_grid_report
    from .estimator import measure
    from .rows import write_csv

    parts = ("rods", "speed", "hard", "random")
    beside = [path.with_name(f"estimator_{part}.csv") for path in files[:1] for part in parts]
    grid_figure = [path.with_name("estimator_grid.png") for path in files[:1]]
    for path in (*beside, *grid_figure):
        refuse_overwrite(path, args.force)
    found = measure(_draws(args), args.seed)
    if files:
        write_csv(files[0], found.grid, args.force)
        for path, part in zip(beside, parts, strict=True):
            write_csv(path, getattr(found, part), args.force)
        estimator_figure.write_figure(files[1], found.speed, args.force)
        estimator_grid_report.write_figure(grid_figure[0], found.grid, args.force)
    return found.text, found.as_dict()


def _object(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from . import object_onset
    from .object import run as measure
    from .object_report import as_text, write_figure
    from .rows import write_csv

    parts = [path.with_name(f"object_{part}.csv") for path in files[:1] for part in ("alarms", "onsets")]
    for path in parts:
        refuse_overwrite(path, args.force)
    draws = _draws(args)
    rows = measure(draws, args.seed)
    alarms = object_onset.alarms(FREE_FRAMES_PER_DRAW * draws, args.seed)
    onsets = object_onset.onsets(draws, args.seed)
    if files:
        write_csv(files[0], rows, args.force)
        write_figure(files[1], rows, args.force)
        write_csv(parts[0], alarms, args.force)
        write_csv(parts[1], onsets, args.force)
    return f"{as_text(rows, draws)}\n\n{object_onset.as_text(alarms, onsets)}", {
        "draws": draws,
        "rows": [asdict(row) for row in rows],
        "alarms": [asdict(row) for row in alarms],
        "onsets": [asdict(row) for row in onsets],
    }


def _paper(args: argparse.Namespace, files: list[Path]) -> tuple[str, dict[str, Any]]:
    from .paper import PARTS, measure
    from .paper_figure import figure_paths, write_figures
    from .paper_report import as_text
    from .rows import write_csv

    tables = [path.with_name(f"paper_{part}.csv") for path in files for part in PARTS]
    figures = [figure for path in files for figure in figure_paths(path.parent)]
    for path in (*tables, *figures):
        refuse_overwrite(path, args.force)
    found = measure(_draws(args), args.seed)
    for path, part in zip(tables, PARTS if files else (), strict=True):
        write_csv(path, getattr(found, part), args.force)
    for path in files:
        write_figures(path.parent, found, args.force)
    return as_text(found), found.as_dict()
