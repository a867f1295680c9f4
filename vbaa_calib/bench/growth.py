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
    work = [(series, series.quick if options.quick else series.sizes) for series in SERIES]
    asked = [(series, sizes) for series, sizes in work if sizes]
    grown = [
        follow(series, sizes, options.seed, options.draws) for series, sizes in progress(asked, "growth", len(asked))
    ]
    left_out = "".join(f"\n{series.name}: not with --quick" for series, sizes in work if not sizes)
    worse = [each.series.name for each in grown if each.worse]
    said = f"{len(grown)} kinds of work, none grows faster than it should"
    return Findings(
        text=table(grown) + left_out,
        tables={"growth.csv": as_rows(grown)},
        figures={"growth.png": partial(write_figure, grown)},
        numbers=numbers(grown),
        headline=said if not worse else f"grows faster than it should: {', '.join(worse)}",
    )
