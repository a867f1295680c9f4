"""Plane C: where the camera stands on the antenna's base."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vbaa_calib.calibrate.guide.jig_views import plane_progress
from vbaa_calib.calibrate.plane_c import PlaneC
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.wizard.sources.offered import Offered
from vbaa_calib.wizard.state.progress import Judged, Number, Progress
from vbaa_calib.wizard.state.session_state import Known

from .pictures import judged
from .step import Step

ENOUGH = {"plane": 4, "sweep": 10, "over": 3}
LEAST = {"plane": 1, "sweep": 5, "over": 1}
SHOOT = {
    "plane": "the board in the jig, the jig fixed to the antenna's base",
    "sweep": "the board fixed in the world; turn pan and tilt to another place, let them rest, read them",
    "over": "the board flat under the free antenna, at rest",
}


def judge(known: Known, offered: Offered, readings: Mapping[str, float] | None) -> Judged:
    """A picture of the board that shows plane C."""
    return judged(known, offered, readings is None)[1]


def look(known: Known) -> Progress:
    """How far plane C is."""
    way, count = known.store.folder("plane"), len(known.taken("plane"))
    seen = [f"{count} picture{'' if count == 1 else 's'}"]
    if count < LEAST[way]:
        return Progress(tuple(seen), (f"{LEAST[way] - count} more at least",), SHOOT[way])
    try:
        plane = known.plane()
    except VbaaError as error:
        return Progress(tuple(seen), (str(error),), SHOOT[way])
    estimate = plane.estimates[0]
    position = 1e3 * estimate.T_antenna_camera.translation_m
    seen.append(f"camera at ({position[0]:.1f}, {position[1]:.1f}, {position[2]:.1f}) mm in the antenna frame")
    if way == "plane":
        return _jig(known, plane, seen)
    enough = count >= ENOUGH[way]
    return Progress(
        seen=tuple(seen),
        missing=() if enough else (f"{ENOUGH[way] - count} more would average out noise and show a board that moves",),
        next="enough, more will not help" if enough else SHOOT[way],
        enough=enough,
        usable=True,
        numbers=_numbers(known, plane),
    )


def _jig(known: Known, plane: PlaneC, seen: list[str]) -> Progress:
    lens, views = known.lens(), known.views("plane")
    now = plane_progress(views, known.board, lens.camera, lens.board_flex.bend, known.work_plane())
    return Progress(
        seen=tuple(seen),
        missing=() if now.enough else (now.words,),
        next="enough, more will not help" if now.enough else SHOOT["plane"],
        enough=now.enough,
        usable=True,
        numbers=(
            *([Number("plane C by lens and jig's pictures", f"± {1e3 * now.std_m:.3f} mm")] if now.std_m >= 0 else []),
            *_numbers(known, plane),
        ),
    )


def _numbers(known: Known, plane: PlaneC) -> tuple[Number, ...]:
    """How well the camera stands on the base, the jig's own deviation in it."""
    estimate, lens = plane.estimates[0], known.lens().camera.covariance
    covariance = estimate.covariance
    if lens is not None:
        covariance = covariance + estimate.lens_sensitivity @ lens @ estimate.lens_sensitivity.T
    std = np.sqrt(np.diag(covariance))
    return (
        Number("camera's place, with what the jig itself is worth", f"± {1e3 * std[3:].max():.2f} mm"),
        Number("camera's angles, the same", f"± {1e3 * std[:3].max():.2f} mrad"),
    )


STEP = Step(
    "plane",
    "Plane C",
    "Show the camera where the antenna's base is: the board in its jig, a sweep of the joints, or the board under it.",
    "The antenna bends in this plane. Pixels become millimetres of the antenna only when it is known.",
    look,
    judge,
)
