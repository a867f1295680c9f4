"""Watches the free antenna in a stream: a camera that moved, a clamp that turned, a sensor's zero that walks.

Against its place when the recording began a free antenna lies aside by a line: as much at the clamp as the camera has
moved, and more towards the tip if the clamp has turned. What a touch bends is no line.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estimator.table.contacts import Measured
from vbaa_calib.core.polyline import beside, resample
from vbaa_calib.detect.whisker.antenna import free_curve, pixels
from vbaa_calib.rig import Rig
from vbaa_calib.session import DRIFTS

EVERY, WINDOW = 4, 8
"""Every so many frames one is looked at, and so many of those that show the free antenna decide together."""
WITHIN_FRAMES = EVERY * (WINDOW + 1)
"""Free frames within which a change is named."""
UNSEEN_FRAMES = 64
_BEYOND, _AGREE = 4.0, 6
_LEAST_POINTS, _LEAST_SHARE = 20, 0.5
_LINE_PX, _STEP_PX = 0.03, 0.5
"""What a line's points have in common beside their own noise."""
_BENT = 3.0
_STEADY = np.array([0.1, 0.1, 0.25, 0.0])
"""A change's spread within a window, in parts of it, at most; a zero walks."""


@dataclass(frozen=True)
class Change:
    """What has changed, in which frame that was seen, and by how much, in words."""

    what: str
    frame: int
    words: str


class DriftWatch:
    """Frames of a recording in, in order; out comes what has changed, once each.

    What may change within an hour of recording (`Drift.hourly`, of `lab` where the rig has none) is not named below
    four of its deviations.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig if rig.drift.of_rig else replace(rig, drift=DRIFTS["lab"])
        self._window: deque[np.ndarray] = deque(maxlen=WINDOW)
        self._first: np.ndarray | None = None
        self._allowed = np.zeros(0)
        self._count = self._unseen = 0
        self.changes: list[Change] = []

    def push(self, frame: int, measured: Measured) -> list[Change]:
        """What this frame shows to have changed."""
        self._unseen = 0 if len(measured.points_px) else self._unseen + 1
        if self._unseen == UNSEEN_FRAMES and self._first is not None:
            words = f"no antenna has been seen for {UNSEEN_FRAMES} frames: look at camera, light and antenna"
            return self._named({"antenna": words}, frame)
        self._count += 1
        if self._count % EVERY or not len(measured.points_px):
            return []
        seen = self._aside(measured)
        if seen is None:
            return []
        self._window.append(seen)
        if len(self._window) < WINDOW:
            return []
        several = np.array(self._window)
        if self._first is None:
            self._first = np.ma.median(np.ma.masked_invalid(several), axis=0).filled(np.nan)  # no moment, no warning
            self._window.clear()
            return []
        changes = several - self._first
        base, tip, zero, _ = middle = np.median(changes, axis=0)
        with np.errstate(invalid="ignore"):
            agree = (np.sign(middle) * changes > self._allowed).sum(axis=0) >= _AGREE
            # what a touch does changes as it is pressed and let go
            steady = np.median(np.abs(changes - middle), axis=0) < _STEADY * np.abs(middle)
        base_moved, tip_moved, zero_moved, _ = agree & steady
        found = {}
        if base_moved or (tip_moved and abs(base) > _BEYOND * _LINE_PX):
            place = f"the antenna's clamp lies {base:+.2f} px aside in the picture, its tip {base + tip:+.2f} px"
            found["camera"] = f"the camera has moved: {place}"
        elif tip_moved:
            found["clamp"] = (
                f"the clamp has turned, or something touches the antenna beside it: tip {tip:+.2f} px aside"
            )
        if zero_moved:
            std = zero / self._rig.moment_sensor.std_Nm
            found["zero"] = (
                f"the moment's zero has walked by {std:+.0f} std, or something pushes along the line of sight"
            )
        return self._named(found, frame)

    def _named(self, found: dict[str, str], frame: int) -> list[Change]:
        known = {change.what for change in self.changes}
        new = [Change(what, frame, words) for what, words in found.items() if what not in known]
        self.changes += new
        return new

    def _aside(self, measured: Measured) -> np.ndarray | None:
        """(4,) how far a free antenna lies aside at the clamp, by how much more at the tip, how much more is read than
        then, N·m, and its bend, px; None where the antenna is bent, or seen in part."""
        rig = self._rig
        rotation, _ = rig.kinematics.world_antenna(np.array([measured.pan_rad]), np.array([measured.tilt_rad]))
        pull = rotation[0].T @ rig.gravity_world_m_s2
        axis, moment_Nm = _free(rig, pull)
        if len(axis) < 2 or len(measured.points_px) < _LEAST_POINTS:
            return None
        if not len(self._allowed):
            self._allowed = _allowed(rig, pull, axis, moment_Nm)
        found = _line(axis, measured.points_px, measured.sigma_px)
        if found is None or abs(found[2]) > self._allowed[3] + _BENT * _LINE_PX:
            return None
        return np.array([found[0], found[1], measured.moment_Nm - moment_Nm, found[2]])


def _free(rig: Rig, pull_m_s2: np.ndarray) -> tuple[np.ndarray, float]:
    """The free antenna (K, 2), px, finely spaced, and what the sensor reads of it."""
    free = free_curve(rig.antenna.parameters, rig.antenna.length_m, pull_m_s2)
    line = pixels(rig.camera, rig.T_antenna_camera.inverse(), free.points_m[0])
    sensor = rig.moment_sensor
    axis = resample(np.ascontiguousarray(line), _STEP_PX)[0] if len(line) > 1 else line
    return axis, float(sensor.gain * free.moment_Nm[0] + sensor.offset_Nm)


def _line(axis: np.ndarray, points_px: np.ndarray, sigma_px: np.ndarray) -> np.ndarray | None:
    """(3,) how far points lie beside an axis: at its start, how much more at its end, and by a bend; px."""
    nearest, aside = beside(axis, np.ascontiguousarray(points_px))
    share = nearest / (len(axis) - 1)
    if np.ptp(share) < _LEAST_SHARE:
        return None
    bend = share**2 * (3.0 - share) / 2.0 - (1.2 * share - 0.2)  # less about the line that is nearest to it
    design = np.stack([np.ones_like(share), share, bend], axis=1) / sigma_px[:, None]
    return np.asarray(np.linalg.lstsq(design, aside / sigma_px, rcond=None)[0])


def _allowed(rig: Rig, pull_m_s2: np.ndarray, axis: np.ndarray, moment_Nm: float) -> np.ndarray:
    """(4,) what `DriftWatch._aside` gives may change by, within an hour."""
    drifting = replace(rig, covariance=np.zeros_like(rig.covariance)).drifted(rig.drift.hourly or 1.0)
    std = np.sqrt(np.diag(drifting.covariance))
    rows: list[np.ndarray] = []
    changed: Callable[[np.ndarray], Rig] = drifting.moved
    for index in np.flatnonzero(std):
        step = np.zeros(len(std))
        step[index] = std[index]
        line, moment = _free(changed(step), pull_m_s2)
        found = _line(axis, line, np.ones(len(line)))
        rows.append(np.zeros(4) if found is None else np.array([found[0], found[1], moment - moment_Nm, found[2]]))
    noise = np.array([_LINE_PX, _LINE_PX, rig.moment_sensor.std_Nm, _LINE_PX])
    return _BEYOND * np.sqrt((np.array(rows).reshape(-1, 4) ** 2).sum(axis=0) + noise**2)
