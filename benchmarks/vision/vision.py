"""`vbaa bench vision`: the antenna in good, hard and empty pictures, beside other methods."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from benchmarks.harness import Findings, Options, least_seconds, new_figure, rms, save
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import SolveError
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.finder import AntennaFinder

from .hard import HARDSHIPS, good, mixed
from .judge import FALSE_PX, Score, bound_px, corridor, peers, score, usual_height
from .scenes import Shot, photograph, truth

SIZES = ((512, 512), (1280, 720))
HARD_SIZE = (400, 300)
BOUND_PICTURES = 4
"""Of each hardship so many pictures are held against the Cramér–Rao bound: it takes several renderings each."""


@dataclass(frozen=True)
class MethodRow:
    """One method on good pictures of one size.

    Attributes
    ----------
    ms : least time for one picture, the median over pictures; pictures_per_s : what that makes.
    rms_px, bias_px : of the points that are no further off than `FALSE_PX`. false : share of those that are.
    kept : share of the visible antenna that has a point.
    """

    size: str
    method: str
    ms: float
    pictures_per_s: float
    rms_px: float
    bias_px: float
    false: float
    kept: float


@dataclass(frozen=True)
class HardRow:
    """One hardship.

    Attributes
    ----------
    found : share of the pictures whose verdict is "ok"; the rest of the row is about these.
    rms_px, bias_px : of the points that are not false. of_bound : their rms over the Cramér–Rao bound's.
    of_sigma : rms over the rms of the predicted deviations. kept, false : as in `vision_judge.Score`.
    """

    hardship: str
    pictures: int
    found: float
    rms_px: float
    bias_px: float
    of_bound: float
    of_sigma: float
    kept: float
    false: float


@dataclass(frozen=True)
class HostileRow:
    """Pictures with several hardships at once. `confident_false`: share whose verdict is "ok" where there is no
    antenna, or where more than half of the points are false."""

    kind: str
    pictures: int
    ok: float
    no_antenna: float
    too_little: float
    ambiguous: float
    confident_false: float


def methods(pictures: int, seed: int, repeats: int) -> list[MethodRow]:
    """Ours and the peers on the same good pictures, one thread, decoding not counted."""
    rows = []
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for size in SIZES:
            rows += _methods_at(size, pictures, seed, repeats)
    finally:
        cv2.setNumThreads(threads)
    return rows


def _methods_at(size: tuple[int, int], pictures: int, seed: int, repeats: int) -> list[MethodRow]:
    times: dict[str, list[float]] = {}
    scores: dict[str, list[Score]] = {}
    for index in progress(range(pictures), f"{size[0]}x{size[1]}"):
        rng = np.random.default_rng([seed, index])
        shot = good(rng, size)
        where, image, actual = corridor(shot, rng), photograph(shot, rng), truth(shot)
        finder = AntennaFinder.prepare(where, size)
        run: dict[str, Callable[[], np.ndarray]] = {"this finder": partial(_found, finder, image)}
        run |= {name: partial(peer, image) for name, peer in peers(where, size).items()}
        for name, method in run.items():
            points = method()
            times.setdefault(name, []).append(least_seconds(method, repeats))
            line = Centreline(points, np.zeros(len(points)), 0.0, 0.0, 1.0)
            scores.setdefault(name, []).append(score(line, actual))
    return [_method_row(f"{size[0]}x{size[1]}", name, times[name], scores[name]) for name in times]


def _found(finder: AntennaFinder, image: np.ndarray) -> np.ndarray:
    return finder.find(image).points_px


def _method_row(size: str, name: str, seconds: Sequence[float], scores: Sequence[Score]) -> MethodRow:
    errors, false = np.concatenate([s.errors_px for s in scores]), np.concatenate([s.false for s in scores])
    near = errors[np.abs(errors) <= FALSE_PX]
    typical = float(np.median(seconds))
    return MethodRow(
        size=size,
        method=name,
        ms=1e3 * typical,
        pictures_per_s=1.0 / typical,
        rms_px=rms(near),
        bias_px=float(near.mean()),
        false=float(false.mean()),
        kept=float(np.mean([s.kept for s in scores])),
    )


def hardships(pictures: int, seed: int, names: Sequence[str] = ("none", *HARDSHIPS)) -> list[HardRow]:
    """Good pictures ("none"), then every hardship by itself."""
    return [_hard_row(name, pictures, seed) for name in progress(names, "hardships", len(names))]


def _hard_row(name: str, pictures: int, seed: int) -> HardRow:
    scores: list[Score] = []
    bounds: list[np.ndarray] = []
    held: list[np.ndarray] = []
    for index in range(pictures):
        rng = np.random.default_rng([seed, index, *name.encode()])
        shot = good(rng, SIZES[0])
        shot = HARDSHIPS[name](rng, shot) if name in HARDSHIPS else shot
        line = _seen(shot, rng)
        if line.found:
            judged = score(line, truth(shot))
            scores.append(judged)
            if len(bounds) < BOUND_PICTURES:
                bounds.append(bound_px(shot, line.points_px[~judged.false]))
                held.append(judged.errors_px[~judged.false])
    if not scores:
        return HardRow(name, pictures, 0.0, *[float("nan")] * 6)
    true = [~s.false for s in scores]
    errors = np.concatenate([s.errors_px[t] for s, t in zip(scores, true, strict=True)])
    sigma = np.concatenate([s.sigma_px[t] for s, t in zip(scores, true, strict=True)])
    return HardRow(
        hardship=name,
        pictures=pictures,
        found=len(scores) / pictures,
        rms_px=rms(errors),
        bias_px=float(errors.mean()),
        of_bound=rms(np.concatenate(held) / np.concatenate(bounds)),
        of_sigma=rms(errors) / rms(sigma),
        kept=float(np.mean([s.kept for s in scores])),
        false=float(np.concatenate([s.false for s in scores]).mean()),
    )


def hostile(pictures: int, seed: int, size: tuple[int, int] = HARD_SIZE) -> list[HostileRow]:
    """As many pictures with an antenna under several hardships as without one."""
    return [_hostile_row(empty, pictures, seed, size) for empty in (False, True)]


def _hostile_row(empty: bool, pictures: int, seed: int, size: tuple[int, int]) -> HostileRow:
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
    kind = "no antenna, clutter" if empty else "two to four hardships"
    return HostileRow(
        kind=kind,
        pictures=pictures,
        ok=verdicts["ok"] / pictures,
        no_antenna=verdicts["no_antenna"] / pictures,
        too_little=verdicts["too_little"] / pictures,
        ambiguous=verdicts["ambiguous"] / pictures,
        confident_false=float(wrong / pictures),
    )


def _seen(shot: Shot, rng: np.random.Generator) -> Centreline:
    finder = AntennaFinder.prepare(corridor(shot, rng), shot.size)
    return finder.with_usual_height(usual_height(shot, rng)).find(photograph(shot, rng), not shot.dark)


def as_text(methods: Sequence[MethodRow], hard: Sequence[HardRow], hostile: Sequence[HostileRow]) -> str:
    """The tables for people."""
    lines = [
        f"good pictures, one thread, decoding not counted; rms of the points within {FALSE_PX} px, false: the others",
        f"{'picture':<10}{'method':<24}{'ms':>8}{'pictures/s':>12}{'rms px':>9}{'bias px':>9}{'kept %':>8}"
        f"{'false %':>9}",
    ]
    for row in methods:
        lines.append(
            f"{row.size:<10}{row.method:<24}{row.ms:>8.2f}{row.pictures_per_s:>12.0f}{row.rms_px:>9.4f}"
            f"{row.bias_px:>+9.4f}{100 * row.kept:>8.1f}{100 * row.false:>9.2f}"
        )
    lines += [
        "",
        "one hardship at a time, 512x512; × bound: rms over the Cramér–Rao bound's; × sigma: over the predicted",
        f"{'hardship':<22}{'found %':>8}{'rms px':>9}{'bias px':>9}{'× bound':>9}{'× sigma':>9}{'kept %':>8}"
        f"{'false %':>9}",
    ]
    for item in hard:
        lines.append(
            f"{item.hardship:<22}{100 * item.found:>8.1f}{item.rms_px:>9.4f}{item.bias_px:>+9.4f}{item.of_bound:>9.2f}"
            f"{item.of_sigma:>9.2f}{100 * item.kept:>8.1f}{100 * item.false:>9.3f}"
        )
    lines += ["", "hard pictures at random: verdicts in %, and confident ones that are false"]
    for mix in hostile:
        lines.append(
            f"{mix.kind:<24}{mix.pictures:>7} pictures: ok {100 * mix.ok:.1f}, no_antenna {100 * mix.no_antenna:.1f}, "
            f"too_little {100 * mix.too_little:.1f}, ambiguous {100 * mix.ambiguous:.1f}; "
            f"false {100 * mix.confident_false:.2f}"
        )
    return "\n".join(lines)


MARKS = {
    "this finder": ("#0f766e", "s"),
    "cv2.ximgproc.thinning": ("#b45309", "o"),
    "RidgeDetectionFilter": ("#6d28d9", "^"),
    "centroid per column": ("#1d4ed8", "D"),
}
"""Method → its colour and mark."""


def write_figure(path: Path, methods: Sequence[MethodRow], hard: Sequence[HardRow], force: bool) -> None:
    """Speed against error on the left, every hardship's error on the right."""
    figure = new_figure(11, 4.2)
    speed, errors = figure.subplots(1, 2)
    for row in methods:
        colour, mark = MARKS[row.method]
        big = row.size.startswith("1280")
        style = {"fillstyle": "none" if big else "full", "label": "_" if big else row.method}
        speed.loglog(row.pictures_per_s, row.rms_px, mark, color=colour, ls="", **style)
    speed.legend(fontsize=8, title="hollow: 1280x720, full: 512x512", title_fontsize=8)
    speed.set_xlabel("pictures per second, one thread")
    speed.set_ylabel("rms error across the antenna, px")
    speed.grid(alpha=0.3)
    names = [item.hardship for item in hard]
    errors.barh(names, [item.rms_px for item in hard], color="#0f766e")
    errors.invert_yaxis()
    errors.set_xlabel("rms error, px")
    errors.tick_params(labelsize=7)
    errors.grid(alpha=0.3, axis="x")
    save(figure, path, force)


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
