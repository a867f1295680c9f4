"""`vbaa bench vision`: the antenna in good, hard and empty pictures, beside other methods."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figures import AMBER, BLUE, GREEN, VIOLET, label, legend, panels
from benchmarks.harness import Draws, Findings, Options, column, least_seconds, one_thread, rms, table
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import SolveError
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.finder import AntennaFinder

from .judge import FALSE_PX, Score, bound_px, corridor, peers, score, usual_height
from .scenes import HARDSHIPS, Shot, good, mixed, photograph, truth

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZES = ((512, 512), (1280, 720))
_HARD_SIZE = (400, 300)
_BOUND_PICTURES = 4
"""Of each hardship so many pictures are held against the Cramér–Rao bound: it takes several renderings each."""


@dataclass(frozen=True)
class MethodRow:
    """One method on good pictures of one size.

    ms : least time for one picture, the median over pictures; pictures_per_s : what that makes.
    rms_px, bias_px : of the points that are no further off than `FALSE_PX`. false : share of those that are.
    kept : share of the visible antenna that has a point.
    """

    size: str = column("picture")
    method: str = column("method")
    ms: float = column("ms", ".2f")
    pictures_per_s: float = column("pictures/s", ".0f")
    rms_px: float = column("rms px", ".4f")
    bias_px: float = column("bias px", "+.4f")
    false: float = column("false %", ".2f", 100)
    kept: float = column("kept %", ".1f", 100)


@dataclass(frozen=True)
class HardRow:
    """One hardship.

    found : share of the pictures whose verdict is "ok"; the rest of the row is about these.
    rms_px, bias_px : of the points that are not false. of_bound : their rms over the Cramér–Rao bound's.
    of_sigma : rms over the rms of the predicted deviations. kept, false : as in `judge.Score`.
    """

    hardship: str = column("hardship")
    pictures: int = column()
    found: float = column("found %", ".1f", 100)
    rms_px: float = column("rms px", ".4f", default=np.nan)
    bias_px: float = column("bias px", "+.4f", default=np.nan)
    of_bound: float = column("× bound", ".2f", default=np.nan)
    of_sigma: float = column("× sigma", ".2f", default=np.nan)
    kept: float = column("kept %", ".1f", 100, default=np.nan)
    false: float = column("false %", ".3f", 100, default=np.nan)


@dataclass(frozen=True)
class HostileRow:
    """Pictures with several hardships at once: shares of the verdicts. `confident_false`: share whose verdict is "ok"
    where there is no antenna, or where more than half of the points are false."""

    kind: str = column("kind")
    pictures: int = column("pictures", "d")
    ok: float = column("ok %", ".1f", 100)
    no_antenna: float = column("no_antenna %", ".1f", 100)
    too_little: float = column("too_little %", ".1f", 100)
    ambiguous: float = column("ambiguous %", ".1f", 100)
    confident_false: float = column("false %", ".2f", 100)


def _named(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _methods(pictures: int, seed: int, repeats: int) -> list[MethodRow]:
    """Ours and the peers on the same good pictures, one thread, decoding not counted."""
    rows = []
    with one_thread():
        for size in SIZES:
            found: dict[str, list[tuple[float, Score]]] = {}
            for index in progress(range(pictures), _named(size)):
                rng = np.random.default_rng([seed, index])
                shot = good(rng, size)
                where, image, actual = corridor(shot, rng), photograph(shot, rng), truth(shot)
                finder = AntennaFinder.prepare(where, size)
                run = {"this finder": lambda picture, finder=finder: finder.find(picture).points_px}
                for name, method in (run | peers(where, size)).items():
                    points, seconds = method(image), least_seconds(partial(method, image), repeats)
                    line = Centreline(points, np.zeros(len(points)), 0.0, 0.0, 1.0)
                    found.setdefault(name, []).append((seconds, score(line, actual)))
            for name, results in found.items():
                scores = Draws([each for _, each in results])
                near = scores.errors_px[np.abs(scores.errors_px) <= FALSE_PX]
                typical = float(np.median([seconds for seconds, _ in results]))
                quality = rms(near), float(near.mean()), float(scores.false.mean()), float(scores.kept.mean())
                rows.append(MethodRow(_named(size), name, 1e3 * typical, 1.0 / typical, *quality))
    return rows


def hardships(pictures: int, seed: int, names: Sequence[str] = ("none", *HARDSHIPS)) -> list[HardRow]:
    """Good pictures ("none"), then every hardship by itself."""
    return [_hard_row(name, pictures, seed) for name in progress(names, "hardships", len(names))]


def _hard_row(name: str, pictures: int, seed: int) -> HardRow:
    scores: list[Score] = []
    of_bound: list[np.ndarray] = []
    for index in range(pictures):
        rng = np.random.default_rng([seed, index, *name.encode()])
        shot = good(rng, SIZES[0])
        shot = HARDSHIPS[name](rng, shot) if name in HARDSHIPS else shot
        line = _seen(shot, rng)
        if line.found:
            scores.append(score(line, truth(shot)))
            if len(of_bound) < _BOUND_PICTURES:
                true = ~scores[-1].false
                of_bound.append(scores[-1].errors_px[true] / bound_px(shot, line.points_px[true]))
    if not scores:
        return HardRow(name, pictures, 0.0)
    every = Draws(scores)
    errors, sigma = every.errors_px[~every.false], every.sigma_px[~every.false]
    return HardRow(
        name,
        pictures,
        len(scores) / pictures,
        rms_px=rms(errors),
        bias_px=float(errors.mean()),
        of_bound=rms(np.concatenate(of_bound)),
        of_sigma=rms(errors) / rms(sigma),
        kept=float(every.kept.mean()),
        false=float(every.false.mean()),
    )


def hostile(pictures: int, seed: int, size: tuple[int, int] = _HARD_SIZE) -> list[HostileRow]:
    """As many pictures with an antenna under several hardships as without one."""
    rows = []
    for kind, empty in (("two to four hardships", False), ("no antenna, clutter", True)):
        verdicts: Counter[str] = Counter()
        wrong = 0
        for index in progress(range(pictures), "without an antenna" if empty else "hard pictures"):
            rng = np.random.default_rng([seed, index, int(empty)])
            shot = mixed(rng, size, empty)
            line = _seen(shot, rng)
            if not (np.isfinite(line.points_px).all() and np.isfinite(line.sigma_px).all()):
                raise SolveError(f"not a number in the centreline of picture {index} of seed {seed}")
            verdicts[line.verdict] += 1
            if line.found:
                wrong += empty or score(line, truth(shot)).false.mean() > 0.5
        shares = {name: verdicts[name] / pictures for name in ("ok", "no_antenna", "too_little", "ambiguous")}
        rows.append(HostileRow(kind, pictures, **shares, confident_false=float(wrong / pictures)))
    return rows


def _seen(shot: Shot, rng: np.random.Generator) -> Centreline:
    finder = AntennaFinder.prepare(corridor(shot, rng), shot.size)
    return finder.with_usual_height(usual_height(shot, rng)).find(photograph(shot, rng), not shot.dark)


_GOOD_TITLE = (
    f"good pictures, one thread, decoding not counted; rms of the points within {FALSE_PX} px, false: the others"
)
_HARD_TITLE = (
    f"one hardship at a time, {_named(SIZES[0])}; × bound: rms over the Cramér–Rao bound's; × sigma: over the predicted"
)
_MIXED_TITLE = "hard pictures at random: verdicts, and confident ones that are false"
_STYLES = {
    "this finder": (GREEN, "s"),
    "cv2.ximgproc.thinning": (AMBER, "o"),
    "Steger, scikit-image": (VIOLET, "^"),
    "centroid per column": (BLUE, "D"),
}
"""Method → its colour and mark."""


def _figure(compared: Sequence[MethodRow], hard: Sequence[HardRow]) -> Figure:
    """Speed against error on the left, every hardship's error on the right."""
    drawn, (speed, errors) = panels(2, 2, (5.5, 4.4))
    for row in compared:
        colour, mark = _STYLES[row.method]
        fill = "full" if row.size == _named(SIZES[0]) else "none"
        speed.loglog(row.pictures_per_s, row.rms_px, mark, color=colour, ls="", fillstyle=fill)
    legend(drawn, _STYLES, f"hollow: {_named(SIZES[1])}, full: {_named(SIZES[0])}")
    label(speed, "", "pictures per second, one thread", "rms error across the antenna, px")
    errors.barh([row.hardship for row in hard], [row.rms_px for row in hard], color=GREEN)
    errors.invert_yaxis()
    errors.tick_params(labelsize=7)
    label(errors, "", "rms error, px")
    return drawn


_GOOD_PER_DRAW, _LEAST_GOOD = 4, 2
"""A good picture of each size for so many of a hardship, and at least so many."""


def measure(options: Options) -> Findings:
    """Methods on good pictures, one hardship at a time, several at random; a draw is a picture of each hardship."""
    draws, seed = options.draws, options.seed
    # pictures at random for each of a hardship, and timings of each method on each picture
    per_draw, repeats = (10, 5) if options.quick else (25, 15)
    compared = _methods(max(draws // _GOOD_PER_DRAW, _LEAST_GOOD), seed, repeats)
    hard, mixed = hardships(draws, seed), hostile(per_draw * draws, seed)
    own = next(row for row in compared if row.method == "this finder")
    false = 100 * max(row.confident_false for row in mixed)
    return Findings(
        "\n\n".join((table(compared, _GOOD_TITLE, 1), table(hard, _HARD_TITLE), table(mixed, _MIXED_TITLE))),
        {"vision.csv": hard, "vision_methods.csv": compared, "vision_random.csv": mixed},
        {"vision.png": lambda: _figure(compared, hard)},
        {"methods": compared, "hardships": hard, "hostile": mixed},
        f"{own.pictures_per_s:.0f} pictures/s of {own.size} at {own.rms_px:.3f} px; confident and false in {false:.1f} "
        "% of hard pictures",
    )
