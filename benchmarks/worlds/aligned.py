"""Thin wires along rows of pixels, in every variant of pictures: what a sensor does to a line that follows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.harness import column
from vbaa_calib.core.console import progress, say
from vbaa_calib.rig import Rig

from .judge import CERTAIN, Judged, called, contacts_of, judge, together
from .pictures import VARIANTS
from .rigs import World, draw_world
from .session import write_session

_SIZE, _WIDTHS_PX = (640, 480), (1.2, 4.0)
"""Pictures, and widths of thin wires in them."""


@dataclass(frozen=True)
class Aligned:
    """One variant of pictures, over all rigs.

    Attributes
    ----------
    usable : share of touched frames that are located. error_mm, stated_mm : medians of the located distances' errors
        and standard deviations. over_well_sampled : median over the rigs of a rig's rms error over the well sampled
        one's. held : share within 1.96 standard deviations. silent : as of any world.
    """

    variant: str = column("variant")
    rigs: int = column("rigs", "d")
    contacts: int = column("contacts", "d")
    usable: float = column("usable %", ".0f", 100.0)
    error_mm: float = column("error mm", ".2f")
    stated_mm: float = column("stated", ".2f")
    over_well_sampled: float = column("times the well sampled", ".2f")
    held: float = column("held %", ".0f", 100.0)
    silent: int = column("silent", "d")


def aligned_world(seed: int, number: int) -> World:
    """The world `number` of those drawn in which a thin wire runs along the rows of a small picture."""
    drawn = -1
    while number >= 0:
        drawn += 1
        world = draw_world(seed, drawn, 0.02)
        away = world.camera.inverse().of(np.array([[world.wire.length_m / 2, 0.0, 0.0]]))[0, 2]
        width_px = world.wire.diameter_m * world.optics.focal_px[0] / away
        number -= world.optics.size == _SIZE and _WIDTHS_PX[0] < width_px < _WIDTHS_PX[1]
    return world


def _judged(world: World) -> Judged | None:
    with TemporaryDirectory(prefix="vbaa-world-") as root:
        folder, rig = Path(root) / "session", Path(root) / "rig.json"
        truth = write_session(world, folder)
        if called("calibrate", folder, "-o", rig, "--force")[0] > 1:
            return None
        Rig.load(rig)
        table = contacts_of(folder, rig, Path(root) / "contacts.csv")[2]
        return None if table is None else judge(table, truth)


def run_aligned(seed: int, rigs: int) -> list[Aligned]:
    """Every variant, of the same rigs."""
    worlds = [aligned_world(seed, number) for number in range(rigs)]
    found: dict[str, list[Judged | None]] = {variant: [] for variant in VARIANTS}
    for world in progress(worlds, "rigs along rows"):
        for variant, several in found.items():
            several.append(_judged(replace(world, sensor=replace(world.sensor, variant=variant))))
            one = several[-1]
            rms_mm = np.nan if one is None else 1e3 * _rms(one)
            say(f"{world.described.rpartition(',')[0]}, {variant}: {rms_mm:.2f} mm rms")
    well = found[VARIANTS[0]]
    return [_row(variant, several, well) for variant, several in found.items()]


def _rms(one: Judged) -> float:
    return float(np.sqrt(np.mean(one.error_m**2))) if len(one.error_m) else np.nan


def _row(variant: str, several: Sequence[Judged | None], well: Sequence[Judged | None]) -> Aligned:
    errors, stds = together([one for one in several if one])
    ratios = [_rms(one) / _rms(other) for one, other in zip(several, well, strict=True) if one and other]
    touched = sum(one.touched for one in several if one)
    return Aligned(
        variant,
        len(several),
        touched,
        len(errors) / max(touched, 1),
        1e3 * float(np.median(np.abs(errors))),
        1e3 * float(np.median(stds)),
        float(np.nanmedian(ratios)),
        float((np.abs(errors) < CERTAIN * stds).mean()),
        sum(one.silent for one in several if one),
    )
