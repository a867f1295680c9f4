"""The headline: pictures to contacts, speed against error, between two walls.

On one side the Cramér–Rao bound of the whole chain, on the other the time to read a picture once from memory.
"""

from __future__ import annotations

from dataclasses import asdict

from .chain_figure import write_figure
from .chain_report import as_text, headline
from .chain_run import run
from .subject import Findings, Options


def measure(options: Options) -> Findings:
    """The subject `chain` of `vbaa bench`; a draw is a picture, of each size and rig."""
    found = run(options.draws, options.seed, options.quick)
    return Findings(
        text=as_text(found.rows, found.stages, found.losses),
        tables={"chain.csv": found.rows, "chain_stages.csv": found.stages, "chain_losses.csv": found.losses},
        figures={"chain.png": lambda path, force: write_figure(path, found.rows, force)},
        numbers={name: [asdict(row) for row in getattr(found, name)] for name in ("rows", "stages", "losses")},
        headline=headline(found.rows),
    )
