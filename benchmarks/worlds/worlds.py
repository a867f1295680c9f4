"""`vbaa bench worlds`: whole ways from pictures to contacts on rigs drawn at random.

Shapes are SciPy's, lenses and pictures this folder's: nothing is shared with `vbaa_calib.simulate` or what is tested.
A world again: `python -m benchmarks.worlds.session SEED NUMBER FOLDER`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.figures import AMBER, GREEN, GREY, label, panels
from benchmarks.harness import Findings, Options, column, covered, rms, row_of, table
from vbaa_calib.core.console import progress, say

from .judge import Judged, Outcome, outcome, together
from .rigs import World, draw_world
from .session import write_session

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _value(judged: Judged | None, statistic: Callable[[Judged], Any]) -> float:
    """Of the contacts of a recording, if there are any."""
    return float(statistic(judged)) if judged is not None and len(judged.error_m) else np.nan


def _covered(judged: Judged) -> float:
    return covered(judged.error_m, judged.std_m)


def _points_covered(judged: Judged) -> float:
    return judged.point_covered / len(judged.error_m)


def _stated(judged: Judged) -> float:
    return rms(judged.std_m)


def _column(
    name: str,
    heading: str,
    statistic: Callable[[Judged], Any],
    spec: str = ".2f",
    unit: float = 1e3,
    scale: float = 1.0,
) -> Any:
    """A column: a statistic of the contacts with one of the rigs, of m in mm."""
    return column(heading, spec, scale, lambda found: unit * _value(getattr(found, name), statistic))


@dataclass(frozen=True)
class Row:
    """One world.

    Attributes
    ----------
    calibrated : severity of the rig's verdict, or "refused". usable : share of touched frames that are located.
    error_mm, stated_mm : medians of the located distances' errors and standard deviations. relative : error over L.
    covered : share within 1.96 standard deviations; point_covered : of world points in their 95 % regions. silent :
        frames located and off by over five, or free. true_mm, true_covered : the same frames with the true rig.
    alone_mm, rms_mm, refined_mm : root mean squares with the calibrated rig alone, as estimated (free frames have shown
        more of the rig) and after `vbaa refine`. bound : how much smaller the last becomes than the second by the joint
        posterior of rig and frames, the Cramér–Rao bound of the same information.
    stiffness, focal, pose : errors of the calibration in its standard deviations.
    shared_mm, forecast_mm, followed_mm : deviation of distance that all frames share; as forecast with what the
        calibration advises to observe; and as it is with that.
    loads_out : clean loads that were left out. words : why something was refused, and what was found.
    """

    world: int = column("world", "d")
    rig: str = column("rig")
    calibrated: str = column("calibrated", of=lambda f: "refused" if f.pulls is None else f.verdict.partition(",")[0])
    lens: str = column("lens", of=lambda f: f.lens)
    touched: int = column()
    usable: float = column("usable %", ".0f", 100.0, lambda f: len(f.ours.error_m) / f.ours.touched if f.ours else 0.0)
    error_mm: float = _column("ours", "error mm", lambda own: np.median(np.abs(own.error_m)))
    stated_mm: float = _column("ours", "stated", lambda own: np.median(own.std_m))
    relative: float = column("% of L", ".2f", 100.0)
    covered: float = _column("ours", "covered %", _covered, ".0f", 1.0, 100.0)
    point_covered: float = _column("ours", "point %", _points_covered, ".0f", 1.0, 100.0)
    silent: int = column("silent", "d", of=lambda f: f.ours.silent if f.ours else 0)
    true_mm: float = _column("true", "true rig mm", lambda own: np.median(np.abs(own.error_m)))
    true_covered: float = _column("true", "covered %", _covered, ".0f", 1.0, 100.0)
    alone_mm: float = _column("alone", "alone mm", lambda own: rms(own.error_m))
    rms_mm: float = _column("ours", "rms mm", lambda own: rms(own.error_m))
    refined_mm: float = _column("refined", "refined", lambda own: rms(own.error_m))
    bound: float = column("bound", ".2f", of=lambda f: _value(f.ours, _stated) / _value(f.refined, _stated))
    stiffness: float = column("EI σ", ".1f", of=lambda f: (f.pulls or {}).get("stiffness", np.nan))
    focal: float = column("f σ", ".1f", of=lambda f: (f.pulls or {}).get("focal", np.nan))
    pose: float = column("pose σ", ".1f", of=lambda f: (f.pulls or {}).get("pose", np.nan))
    shared_mm: float = column("shared mm", ".3f", of=lambda f: 1e3 * f.shared_m[0])
    forecast_mm: float = column("forecast", ".3f", of=lambda f: 1e3 * f.shared_m[1])
    followed_mm: float = column("followed", ".3f", of=lambda f: 1e3 * f.shared_m[2])
    loads_out: int = column("loads out", "d", of=lambda f: f.loads_left_out)
    words: str = column(of=lambda f: "; ".join(filter(None, f.sentences)))


def row_of_world(world: World, found: Outcome) -> Row:
    """A world and what became of it."""
    touched = sum(any(shot.push_N) for shot in world.contacts)
    relative = _value(found.ours, lambda own: np.median(np.abs(own.error_m))) / world.wire.length_m
    return row_of(Row, found, world=world.number, rig=world.described, touched=touched, relative=relative)


def run(options: Options) -> list[tuple[Row, Outcome]]:
    """World after world; each is shown when it is done."""
    found = []
    for number in progress(range(options.draws), "worlds"):
        world = draw_world(options.seed, number)
        with TemporaryDirectory(prefix="vbaa-world-") as root:
            truth = write_session(world, Path(root) / "session")
            result = outcome(world, truth, Path(root) / "session")
        found.append((row_of_world(world, result), result))
        row = found[-1][0]
        say(f"{row.world}: {row.calibrated}, {row.error_mm:.2f} mm off, {row.stated_mm:.2f} stated; {row.rig}")
    return found


def summary(results: Sequence[tuple[Row, Outcome]]) -> dict[str, float]:
    """What `lines` says, as numbers."""
    rows, outcomes = zip(*results, strict=True)
    ours = [one.ours for one in outcomes if one.ours]
    errors, stds = together(ours)
    pulls = np.array([[abs(value) for value in one.pulls.values()] for one in outcomes if one.pulls]).reshape(-1, 3)
    refined = [row.rms_mm / row.refined_mm for row in rows if np.isfinite(row.refined_mm)]
    relative = np.array([row.relative for row in rows if np.isfinite(row.relative)])
    advised = np.array([[row.forecast_mm, row.followed_mm] for row in rows]) / [[row.shared_mm] for row in rows]
    advised = advised[np.isfinite(advised).all(axis=1)]
    shares = [row.error_mm / row.true_mm for row in rows if np.isfinite(row.error_mm) and np.isfinite(row.true_mm)]
    return {
        "worlds": len(rows),
        "refused": sum(row.calibrated == "refused" for row in rows),
        "wrong": sum(row.calibrated == "wrong" for row in rows),
        "contacts": sum(row.touched for row in rows),
        "located": len(errors),
        "silent": sum(row.silent for row in rows),
        "covered": covered(errors, stds),
        "worst_covered": min((row.covered for row in rows if np.isfinite(row.covered)), default=np.nan),
        "pulls_within_3": float((pulls[np.isfinite(pulls)] < 3.0).mean()) if len(pulls) else np.nan,
        "refine_gains_median": float(np.median(refined)) if refined else np.nan,
        "refined_of_alone_median": float(np.nanmedian([row.alone_mm / row.refined_mm for row in rows])),
        "refine_bound_median": float(np.nanmedian([row.bound for row in rows])),
        "refined": len(refined) / max(len(ours), 1),
        "relative_median": float(np.median(relative)) if len(relative) else np.nan,
        "relative_90": float(np.quantile(relative, 0.9)) if len(relative) else np.nan,
        "advised": len(advised),
        "shared_left": float(np.median(advised[:, 1])) if len(advised) else np.nan,
        "followed_over_forecast": float(np.median(advised[:, 1] / advised[:, 0])) if len(advised) else np.nan,
        "followed_over_forecast_90": float(np.quantile(advised[:, 1] / advised[:, 0], 0.9)) if len(advised) else np.nan,
        "loads_left_out": sum(row.loads_out for row in rows),
        "true_rig_share_median": float(np.median(shares)) if shares else np.nan,
    }


def lines(found: dict[str, float]) -> str:
    """The summary beside its bars."""
    return "\n".join(
        [
            f"{found['worlds']} worlds: {found['refused']} refused, {found['wrong']} wrong; "
            f"{found['contacts']} contacts, {found['located']} located",
            f"silent {found['silent']} (0); within 95 % intervals {100 * found['covered']:.1f} % (92 to 98), least of "
            f"a world {100 * found['worst_covered']:.0f} % (85)",
            f"EI, focal length, pose within 3 standard deviations {100 * found['pulls_within_3']:.1f} % (99)",
            f"distance, of L: median {100 * found['relative_median']:.2f} % (0.2), 90th percentile "
            f"{100 * found['relative_90']:.2f} % (0.6); {found['true_rig_share_median']:.1f} times the true rig's",
            f"guide: in {found['advised']} worlds what it advises leaves {100 * found['shared_left']:.0f} % of the "
            f"shared error (median), {found['followed_over_forecast']:.2f} times the forecast, 90th percentile "
            f"{found['followed_over_forecast_90']:.2f}",
            f"refine: {100 * found['refined']:.0f} % of worlds (95), rms smaller by {found['refine_gains_median']:.2f} "
            f"(1.3; the same information has {found['refine_bound_median']:.2f}), by "
            f"{found['refined_of_alone_median']:.2f} than with the calibration alone; clean loads left out "
            f"{found['loads_left_out']} (0)",
        ]
    )


def figure(rows: Sequence[Row]) -> Figure:
    """Error with the calibrated and with the true rig over the stated deviation, world by world."""
    drawn, (panel,) = panels(1, 1, (5.2, 4.2))
    for name, colour, what in (("error_mm", AMBER, "calibrated rig"), ("true_mm", GREY, "true rig")):
        panel.loglog(
            [row.stated_mm for row in rows], [getattr(row, name) for row in rows], "o", color=colour, label=what
        )
    ends = [value for row in rows for value in (row.stated_mm, row.error_mm) if np.isfinite(value) and value > 0]
    usual = np.array([min(ends, default=1.0), max(ends, default=1.0)])
    panel.plot(usual, 0.67 * usual, color=GREEN, lw=0.8, label="as stated")
    label(panel, "", "stated standard deviation, mm", "median error of distance, mm")
    panel.legend(fontsize=8)
    return drawn


def measure(options: Options) -> Findings:
    """Every world; a draw is a rig with its pictures, calibration and recording."""
    results = run(options)
    rows, found = [row for row, _ in results], summary(results)
    heard = "\n".join(f"{row.world}: {row.words}" for row in rows if row.words not in ("", "none"))
    return Findings(
        "\n\n".join([table(rows), lines(found), heard]),
        {"worlds.csv": rows},
        {"worlds.png": lambda: figure(rows)},
        {"rows": rows, "summary": found},
        f"{found['refused']} of {found['worlds']} refused, {found['silent']} silent, distance "
        f"{100 * found['relative_median']:.2f} % of L",
    )
