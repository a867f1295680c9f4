"""How the cost grows with the work: frames, points, pixels, views, contacts."""

from __future__ import annotations

from functools import partial

from ..console import progress
from .growth_figure import write_figure
from .growth_follow import follow
from .growth_report import as_rows, numbers, table
from .growth_series import SERIES
from .subject import Findings, Options


def measure(options: Options) -> Findings:
    """Every series; a draw is a timing of each size, of which the least counts."""
    grown = [
        follow(series, series.quick if options.quick else series.sizes, options.seed, options.draws)
        for series in progress(SERIES, "growth", len(SERIES))
    ]
    worse = [each.series.name for each in grown if each.worse]
    said = f"{len(grown)} kinds of work, none grows faster than it should"
    return Findings(
        text=table(grown),
        tables={"growth.csv": as_rows(grown)},
        figures={"growth.png": partial(write_figure, grown)},
        numbers=numbers(grown),
        headline=said if not worse else f"grows faster than it should: {', '.join(worse)}",
    )
