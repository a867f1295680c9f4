"""A few cells of the benchmark, a line each: `python -m benchmarks.calibration.quick [CELL ...] --beside draws.csv`.

CELL is part of a cell's name; without any, all of them. What other methods made of the same draws is read from the
file where it has it, and added to it otherwise; ours is solved anew each time.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from benchmarks.harness import as_json, one_thread, write_csv

from .calibration import Row, solved, summarised
from .judge import Judged
from .methods import AUTO, methods
from .scenes import cells

_PEERS = ("mrcal", "lensboy")


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cells", nargs="*", metavar="CELL", help="part of a cell's name (default: all)")
    parser.add_argument("--draws", type=int, default=10, help="of each cell (default: 10)")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw (default: 0)")
    parser.add_argument("--beside", type=Path, help="what the other methods made of the draws (CSV)")
    parser.add_argument("--given", action="store_true", help="our solve with the lens model given, not auto")
    parser.add_argument("--each", action="store_true", help="a line for each draw, too")
    parser.add_argument("--list", action="store_true", help="name the cells and stop")
    args = parser.parse_args(arguments)
    names = [name for name in cells() if not args.cells or any(part in name for part in args.cells)]
    if args.list:
        print("\n".join(names))
        return
    ours = "ours, lens given" if args.given else AUTO
    known = _read(args.beside)
    begun = time.perf_counter()
    print(_HEAD)
    with one_thread():
        for name in names:
            seeds = range(args.seed, args.seed + args.draws)
            print(_line(*_found(name, seeds, ours, known), ours), flush=True)
            if args.each:
                print(*(_draw(known, name, seed, ours) for seed in seeds), sep="\n", flush=True)
            if args.beside:
                others = [one for (_, _, method), one in known.items() if not method.startswith("ours")]
                write_csv(args.beside, others, force=True)
    print(f"{time.perf_counter() - begun:.0f} s")


Known = dict[tuple[str, int, str], Judged]
"""By cell, seed and method."""


def _read(path: Path | None) -> Known:
    if path is None or not path.exists():
        return {}
    kinds: dict[str, Any] = {one.name: one.type for one in fields(Judged)}
    found = {}
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            one = Judged(**{name: _value(row[name], kind) for name, kind in kinds.items()})
            found[one.cell, one.seed, one.method] = one
    return found


def _value(text: str, kind: str) -> Any:
    if kind == "str":
        return text
    return (
        None if not text else text == "True" if kind.startswith("bool") else int(text) if kind == "int" else float(text)
    )


def _found(name: str, seeds: Sequence[int], ours: str, known: Known) -> tuple[list[Row], float]:
    """The cell's rows; seconds that our solves took. What is solved is added to what is known."""
    every = {method: solve for method, solve in methods().items() if not isinstance(solve, str)}
    for method, solve in every.items():
        if method.startswith("ours") and method != ours:
            continue
        missing = [seed for seed in seeds if method == ours or (name, seed, method) not in known]
        for one in solved(cells()[name], missing, [(method, solve)]) if missing else ():
            known[one.cell, one.seed, one.method] = one
    own = [one for (cell, seed, method), one in known.items() if cell == name and seed in seeds]
    return summarised(own), sum(one.seconds or 0.0 for one in own if one.method == ours)


_HEAD = (
    f"{'cell':46} {'true pose, mm':>14} {'× oracle':>11} {'jig, µm':>13} {'× oracle':>11} "
    + " ".join(f"{f'{peer} ×':>11} {'jig ×':>11}" for peer in _PEERS)
    + f" {'stated':>6} {'in':>3} {'jig':>5} {'in':>3} {'lost':>5} {'caught':>6} {'views':>5} {'trust':>5} {'wrong':>5} "
    f"{'folds':>5} {'failed':>6} {'s':>5}  models"
)


def _line(rows: Sequence[Row], seconds: float, ours: str) -> str:
    by = {row.method: row for row in rows}
    own = by[ours]
    beside = " ".join(
        f"{_pair(by[peer].ratio, by[peer].worst_ratio)} {_pair(by[peer].jig_ratio, by[peer].jig_worst_ratio)}"
        if peer in by
        else f"{'-':>11} {'-':>11}"
        for peer in _PEERS
    )
    shares = [
        _cell(value, width, digits, 100.0)
        for value, width, digits in (
            (own.good_dropped, 5, 2),
            (own.outliers_found, 6, 1),
            (own.views_dropped, 5, 1),
            (own.trusted, 5, 0),
            (own.wrong, 5, 0),
            (own.folds, 5, 0),
            (own.failed, 6, 0),
        )
    ]
    middle, worst = (None if value is None else 1e3 * value for value in (own.jig_error_mm, own.jig_worst_mm))
    return " ".join(
        [
            f"{own.cell:46}",
            _pair(own.error_mm, own.worst_mm, 14, 3),
            _pair(own.ratio, own.worst_ratio),
            _pair(middle, worst, 13, 1),
            _pair(own.jig_ratio, own.jig_worst_ratio),
            beside,
            *(_cell(own.stated, 6, 2), _cell(own.covered, 3, 0, 100.0)),
            *(_cell(own.jig_stated, 5, 2), _cell(own.jig_covered, 3, 0, 100.0)),
            *shares,
            f"{seconds:5.1f}  {own.models}{'; ' + own.note if own.note else ''}",
        ]
    )


def _draw(known: Known, name: str, seed: int, ours: str) -> str:
    """One draw of ours."""
    own, oracle = known[name, seed, ours], known[name, seed, "oracle"]
    said = {
        key: value for key, value in as_json(own).items() if value not in (None, "") and key not in ("cell", "method")
    }
    words = ", ".join(
        f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in said.items()
    )
    return f"    {words}; oracle {oracle.error_mm:.3g}, {oracle.jig_error_mm:.3g}; {cells()[name].rig(seed).name}"


def _pair(middle: float | None, worst: float | None, width: int = 11, digits: int = 2) -> str:
    both = "/".join("-" if value is None else f"{value:.{digits}f}" for value in (middle, worst))
    return f"{both:>{width}}"


def _cell(value: float | None, width: int, digits: int, scale: float = 1.0) -> str:
    return f"{'-' if value is None else f'{scale * value:.{digits}f}':>{width}}"


if __name__ == "__main__":
    main()
