"""`vbaa bench vision`: the antenna in good, hard and empty pictures, beside other methods."""

from __future__ import annotations

from collections.abc import Sequence

from .subject import Findings, Options
from .vision_report import as_text, write_figure
from .vision_run import HostileRow, MethodRow, hardships, hostile, methods

HOSTILE_PER_DRAW = {False: 25, True: 10}
"""Pictures with and without an antenna, at random, for each picture of a hardship; without and with --quick."""
GOOD_PER_DRAW, LEAST_GOOD = 4, 2
"""A good picture of each size for so many of a hardship, and at least so many."""
REPEATS = {False: 15, True: 5}
"""Timings of each method on each picture, without and with --quick."""


def measure(options: Options) -> Findings:
    """Methods on good pictures, one hardship at a time, several at random; a draw is a picture of each hardship."""
    draws, seed = options.draws, options.seed
    compared = methods(max(draws // GOOD_PER_DRAW, LEAST_GOOD), seed, REPEATS[options.quick])
    hard, mixed = hardships(draws, seed), hostile(HOSTILE_PER_DRAW[options.quick] * draws, seed)
    return Findings(
        as_text(compared, hard, mixed),
        {"vision.csv": hard, "vision_methods.csv": compared, "vision_random.csv": mixed},
        {"vision.png": lambda path, force: write_figure(path, compared, hard, force)},
        {"methods": compared, "hardships": hard, "hostile": mixed},
        headline(compared, mixed),
    )


def headline(compared: Sequence[MethodRow], mixed: Sequence[HostileRow]) -> str:
    """Speed and error of this finder on the smaller good pictures, and what it is confidently wrong about."""
    own = next(row for row in compared if row.method == "this finder")
    false = 100 * max(row.confident_false for row in mixed)
    return (
        f"{own.pictures_per_s:.0f} pictures/s of {own.size} at {own.rms_px:.3f} px; confident and false in "
        f"{false:.1f} % of hard pictures"
    )
