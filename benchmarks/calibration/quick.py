"""A few cells of the benchmark: `python -m benchmarks.calibration.quick [CELL ...]`, a line each.

CELL is part of a cell's name; without any, all of them. Solved are the oracle's and our lens alone; beside them stand
the other methods' ratios as they lie in calibration.csv.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path

from benchmarks.harness import one_thread, table

from .calibration import Row, run
from .methods import AUTO, ORACLE
from .scenes import cells

_TABLE = Path(__file__).parents[1] / "calibration.csv"
_OTHERS = ("mrcal", "lensboy")


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cells", nargs="*", metavar="CELL", help="part of a cell's name (default: all)")
    parser.add_argument("--draws", type=int, default=10, help="of each cell (default: 10)")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw (default: 0)")
    args = parser.parse_args(arguments)
    with _TABLE.open(encoding="utf-8", newline="") as lines:
        ratios = {(row["cell"], row["method"]): (row["ratio"], row["worst_ratio"]) for row in csv.DictReader(lines)}

    def beside(row: Row) -> str:
        told = [ratios.get((row.cell, other), ("", "")) for other in _OTHERS]
        return "  ".join("/".join(f"{float(one):.2f}" if one else "–" for one in pair) for pair in told)

    for name in [name for name in cells() if not args.cells or any(part in name for part in args.cells)]:
        with one_thread():
            rows = run(args.draws, args.seed, [name], (ORACLE, AUTO))
        own = [row for row in rows if row.method == AUTO]
        print(table(own, more={", ".join(_OTHERS): beside}), flush=True)


if __name__ == "__main__":
    main()
