"""`vbaa bench guided`: pictures of the board where suggested and at random, until plane C is known."""

from __future__ import annotations

from collections.abc import Sequence

from .guided_report import as_text, pictures_needed, write_figure
from .guided_rigs import GOAL_MM
from .guided_run import Row, run
from .guided_ways import PEOPLE, SUGGESTED
from .subject import Findings, Options


def measure(options: Options) -> Findings:
    """Every way to choose poses on every rig; a draw is one sequence of pictures."""
    rows = run(options.draws, options.seed)
    return Findings(
        as_text(rows, options.draws),
        {"guided.csv": rows},
        {"guided.png": lambda path, force: write_figure(path, rows, force)},
        {"rows": rows},
        headline(rows),
    )


def headline(rows: Sequence[Row]) -> str:
    """Pictures needed, by suggestion and by chance."""
    suggested, random = _needed(rows, SUGGESTED), _needed(rows, PEOPLE)
    return f"{GOAL_MM} mm on plane C takes {suggested} suggested pictures, {random} at random"


def _needed(rows: Sequence[Row], way: str) -> str:
    """On the rigs in turn: how many, or more than were taken."""
    counts = []
    for rig in dict.fromkeys(row.rig for row in rows):
        own = [row for row in rows if (row.rig, row.way) == (rig, way)]
        if own:
            needed = pictures_needed(own, "true_rms_mm")
            counts.append(f"> {max(row.pictures for row in own)}" if needed is None else str(needed))
    return ", ".join(counts)
