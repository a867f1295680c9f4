"""`vbaa bench calibration`: lenses from corners, in millimetres on plane C, beside an oracle and other calibrators."""

from __future__ import annotations

from collections.abc import Sequence

from .calibration_figure import write_figure
from .calibration_peers import versions
from .calibration_report import as_text
from .calibration_run import Row, run
from .subject import Findings, Options


def measure(options: Options) -> Findings:
    """Every method on every rig; a draw is one set of views."""
    rows = run(options.draws, options.seed)
    return Findings(
        as_text(rows, options.draws),
        {"calibration.csv": rows},
        {"calibration.png": lambda path, force: write_figure(path, rows, options.draws, force)},
        {"rows": rows},
        headline(rows),
        versions(),
    )


def headline(rows: Sequence[Row]) -> str:
    """Rms errors over the oracle's, ours and OpenCV's."""
    return f"rms error over the oracle's: ours {_span(rows, 'ours, auto')}, OpenCV {_span(rows, 'OpenCV, default')}"


def _span(rows: Sequence[Row], method: str) -> str:
    own = [row for row in rows if row.method == method]
    ratios = [row.rms_ratio for row in own if row.rms_ratio is not None]
    failed = f", no lens on {len(own) - len(ratios)} of {len(own)} rigs" if len(ratios) < len(own) else ""
    return f"{min(ratios):.2f} to {max(ratios):.2f}{failed}" if ratios else "without a lens"
