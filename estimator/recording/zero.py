"""Whether the moment sensor's zero walks while the recording lasts, by frames with the free antenna in the picture.

What they read in addition to the free antenna's weight is the zero, unless something pushes along the line of sight:
that comes and goes with the strokes, and the zero does not.
"""

from __future__ import annotations

import numpy as np

from estimator.solver.linearised import linearised
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays

from .settings import RefineSettings
from .views import Pictures


def walk_of_zero(pictures: Pictures, friction_rad: float, rung: str) -> str:
    """How far the zero walks from the first to the last frame of `pictures.straight`, in words; "" where that is within
    what readings and rig leave open."""
    arrays = RigArrays.from_rig(pictures.rig, friction_rad)
    read = np.isfinite(pictures.straight.readings_Nm[:, 0]) & np.isfinite(pictures.straight_s)
    time_s = pictures.straight_s[read]
    if len(time_s) < RefineSettings.zero_frames or not np.ptp(time_s) > 0.0:
        return ""
    frames = pictures.straight.picked(read).frames(arrays)
    found = linearised(frames, rung, np.tile(np.array([0.5, 0.0, 0.0, 0.0]), (len(time_s), 1)))
    off, by_rig = found.residual[:, 0], found.readings[:, 0, UNKNOWNS:]
    when = (time_s - time_s.mean()) / np.ptp(time_s)
    # every two frames' slope, the median: frames that are pushed along the line of sight are few, or scatter
    first, second = np.triu_indices(len(when), 1)
    apart = when[second] - when[first]
    far = np.abs(apart) > 0.1
    slope = float(np.median((off[second] - off[first])[far] / apart[far]))
    rest = off - slope * when
    scatter = max(1.0, 1.4826 * float(np.median(np.abs(rest - np.median(rest)))))
    of_rig = float(np.linalg.norm(when @ by_rig) / (when @ when))
    std = np.hypot(scatter * np.sqrt(np.pi / 2.0 / (when @ when)), of_rig)
    if abs(slope) < RefineSettings.zero_walks * std:
        return ""
    return (
        f"the moment sensor's zero walks by {slope:+.0f} deviations of its noise while the recording lasts, or "
        "something pushes along the line of sight: forces would be off by as much; look at `vbaa estimate --track-zero`"
    )
