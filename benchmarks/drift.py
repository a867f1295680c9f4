"""`vbaa bench drift`: contacts of rigs that have changed since their calibration, with and without free frames.

Rigs and recordings are those of `benchmarks.mistakes`: the static rod's shapes and the simulator's lens, which share no
code with what is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from benchmarks.harness import SILENT, Draws, Findings, Options, column, covered, mean, rms, table, timed
from benchmarks.mistakes.recordings import Motion, Recording, recorded
from benchmarks.mistakes.rigs import KINDS, Calibrated, calibrated_rig, drifted
from estimator import Contact, ContactEstimator
from estimator.table.contacts import LOCATED, Measured
from vbaa_calib.core.console import progress
from vbaa_calib.rig import Rig
from vbaa_calib.session import DRIFTS, Drift

FREE, TOUCHED = 10, 30
"""Frames of a recording: of the free antenna, which come first, and of contacts."""
"""Deviations beyond which an `ok` frame counts as wrong."""
_REACH, _SLOPE_RAD = (0.3, 0.92), (0.03, 0.12)
"""Contact distances, in antenna lengths, and slopes of the antenna there."""


NOTHING, ALL = "nothing", "all of it"
CHANGES = {
    NOTHING: Drift(),
    "picture 0.02 px": Drift(picture_shift_px=0.02),
    "picture 0.1 px": Drift(picture_shift_px=0.1),
    "picture 0.5 px": Drift(picture_shift_px=0.5),
    "camera 0.3 mrad, 0.2 mm": Drift(3e-4, 2e-4),
    "scale 1e-4": Drift(picture_scale=1e-4),
    "light 0.03 px": Drift(light_px=0.03),
    "zero 10 std": Drift(moment_zero=10.0),
    "EI 0.5 %": Drift(stiffness=5e-3),
    ALL: Drift(3e-4, 2e-4, 0.5, 1e-4, stiffness=5e-3, moment_gain=2e-3, moment_zero=10.0, light_px=0.03),
}
"""Name → the largest that may have changed; each draw takes it evenly within."""
_DRAWN = [14, 14, 14, 14, 9, *range(6), 6, 7, 8, 10, 11, 12, 13, 14]
"""Of 16 parts drawn, which change what: in the order of `drifted`; clamp and bow stay."""
NONE, UNSEEN, SEEN = "as calibrated", "drift, no free frame", "drift, free frames"
WAYS = (NONE, UNSEEN, SEEN)
"""Drift ignored; allowed for; and learnt from free frames."""


@dataclass(frozen=True)
class Row:
    """One change, in one way, over rigs and draws.

    Attributes
    ----------
    usable : share of contacts that are located. lost : share of those that were so without the change, and are not now.
    silent : share of located contacts whose distance is off by over five deviations. worst : the largest of these.
    ratio : l_rms over that without the change, drift ignored, of the contacts that are located in both, in parts of
        their antennas. bound : the same of the deviations stated.
    covered : share of distances within their 95 % intervals. free : share of free frames that are so called.
    """

    change: str = column("change")
    way: str = column("estimated")
    contacts: int = column("contacts", "d")
    usable: float = column("usable %", ".1f", 100.0)
    lost: float = column("lost %", ".1f", 100.0)
    silent: float = column("silent %", ".2f", 100.0)
    worst: float = column("worst", ".1f")
    l_rms: float = column("l rms, % L", ".3f", 100.0)
    l_median: float = column("median", ".3f", 100.0)
    ratio: float = column("× unchanged", ".2f")
    bound: float = column("stated", ".2f")
    covered: float = column("covered %", ".1f", 100.0)
    free: float = column("free %", ".1f", 100.0)
    frame_ms: float = column("ms a frame", ".1f")


def changed(known: Calibrated, change: Drift, seed: int) -> Recording:
    """A recording after a change; the same seed gives the same contacts, noise and directions."""
    rng, count, antenna = np.random.default_rng((57, seed)), FREE + TOUCHED, known.world.kind.antenna
    pan, tilt = rng.uniform(-0.5, 0.5, count), rng.uniform(-0.8, 0.8, count)
    distance, roll = rng.uniform(*_REACH, count) * antenna.length_m, rng.uniform(-np.pi, np.pi, count)
    size_N = 2.0 * antenna.stiffness_Nm2 * rng.uniform(*_SLOPE_RAD, count) / distance**2
    size_N[:FREE] = 0.0
    force_N = np.column_stack([np.zeros(count), size_N * np.cos(roll), size_N * np.sin(roll)])
    world = drifted(known.world, rng.uniform(-1.0, 1.0, 16)[_DRAWN], change)
    return recorded(known.rig, [world] * count, Motion(np.full(count, np.nan), pan, tilt, distance, force_N), seed)


def estimated(rig: Rig, way: str, frames: Sequence[Measured]) -> list[Contact]:
    """All frames in one of `WAYS`; where no free frame may tell of the drift, each is estimated by itself."""
    estimator = ContactEstimator(replace(rig, drift=Drift() if way == NONE else DRIFTS["lab"]))
    return list(estimator.run(frames) if way == SEEN else estimator.measure_batch(frames))


def _judge(recording: Recording, way: str) -> SimpleNamespace:
    """One recording, one way: errors and deviations (F,) in antenna lengths, NaN where nothing is located."""
    found, seconds = timed(lambda: estimated(recording.rig, way, recording.frames))
    located = np.array([one.status in LOCATED for one in found])
    error, std = np.array([[one.distance_m, one.distance_std_m] for one in found]).T / recording.rig.antenna.length_m
    error = np.where(located, error - recording.truth.distance_m / recording.rig.antenna.length_m, np.nan)
    free = np.array([one.status == "no_contact" for one in found])
    return SimpleNamespace(
        error=error, std=np.where(located, std, np.nan), free=free, touched=recording.motion.touched, seconds=seconds
    )


def run(options: Options) -> list[Row]:
    """Every change and way over all rigs and draws."""
    judged: dict[tuple[str, str], list[SimpleNamespace]] = {}
    kinds = KINDS[: 1 if options.quick else None]
    for number in progress(range(options.draws), "rigs"):
        known = calibrated_rig(kinds[number % len(kinds)], 1000 * options.seed + number)
        for name, change in CHANGES.items():
            recording = changed(known, change, 1000 * options.seed + number)
            for way in WAYS:
                judged.setdefault((name, way), []).append(_judge(recording, way))
    base = Draws(judged[NOTHING, NONE])
    return [_row(change, way, Draws(several), base) for (change, way), several in judged.items()]


def _row(change: str, way: str, now: Draws, base: Draws) -> Row:
    located, was = (each.touched & np.isfinite(each.error) for each in (now, base))
    off, both = np.abs(now.error[located] / now.std[located]), located & was
    return Row(
        change=change,
        way=way,
        contacts=int(now.touched.sum()),
        usable=float(located.sum() / now.touched.sum()),
        lost=float((was & ~located).sum() / max(was.sum(), 1)),
        silent=mean(off > SILENT),
        worst=float(off.max(initial=0.0)),
        l_rms=rms(now.error[located]),
        l_median=float(np.median(np.abs(now.error[located]))) if located.any() else np.nan,
        ratio=rms(now.error[both]) / rms(base.error[both]),
        bound=rms(now.std[both]) / rms(base.std[both]),
        covered=covered(off),
        free=float(now.free[~now.touched].mean()),
        frame_ms=1e3 * float(now.seconds.sum()) / len(now.touched),
    )


def measure(options: Options) -> Findings:
    """Every change and way; a draw is a rig with its own calibration, change and recording."""
    rows = run(options)
    worst, lost = (
        {way: max(getattr(row, name) for row in rows if row.way == way) for way in WAYS} for name in ("worst", "lost")
    )
    title = (
        f"{FREE} free frames and {TOUCHED} contacts a rig; lost: located without the change, and not with it; "
        f"silent: off by over {SILENT:g} deviations"
    )
    return Findings(
        table(rows, title, once=1),
        {"drift.csv": rows},
        numbers={"rows": rows},
        headline=f"lost at most {100 * lost[SEEN]:.0f} % (as calibrated {100 * lost[NONE]:.0f}), "
        f"worst {worst[SEEN]:.1f} deviations ({worst[NONE]:.0f})",
    )
