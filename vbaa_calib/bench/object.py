"""`vbaa bench object`: objects felt by stroking them, against what is true of them."""

from __future__ import annotations

from collections.abc import Sequence

from . import object_onset
from .object_onset import SPEEDS_M_S, AlarmRow
from .object_report import as_text, write_figure
from .object_run import ObjectRow, cells, few_cells, run
from .subject import Findings, Options

FREE_FRAMES_PER_DRAW = {False: 2_000, True: 600}
"""Frames without contact in which a first contact would be a false alarm, for each recording of a kind."""


def measure(options: Options) -> Findings:
    """Every cell, false alarms and first contacts; a draw is one recording of each."""
    draws, seed = options.draws, options.seed
    rows = run(draws, seed, few_cells() if options.quick else cells())
    alarms = object_onset.alarms(FREE_FRAMES_PER_DRAW[options.quick] * draws, seed)
    onsets = object_onset.onsets(draws, seed, SPEEDS_M_S[:: 3 if options.quick else 1])
    return Findings(
        f"{as_text(rows, draws)}\n\n{object_onset.as_text(alarms, onsets)}",
        {"object.csv": rows, "object_alarms.csv": alarms, "object_onsets.csv": onsets},
        {"object.png": lambda path, force: write_figure(path, rows, force)},
        {"rows": rows, "alarms": alarms, "onsets": onsets},
        headline(rows, alarms),
    )


def headline(rows: Sequence[ObjectRow], alarms: Sequence[AlarmRow]) -> str:
    """Cells that meet every goal, the worst surface, first contacts imagined."""
    met, worst = sum(not row.misses for row in rows), max(row.surface_mm for row in rows)
    imagined, frames = sum(row.alarms for row in alarms), sum(row.frames for row in alarms)
    return (
        f"{met} of {len(rows)} cells meet every goal; surface within {worst:.2f} mm rms; "
        f"{imagined} first contacts imagined in {frames} free frames"
    )
