"""Accepts a picture when the scene is held still, so that nobody has to press a key with the board in both hands."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .motion import Look, look_at, motion_px


@dataclass(frozen=True)
class StillSettings:
    """When a scene counts as still; as it stands, for a board in the hand.

    Attributes
    ----------
    hold_s, hold_frames : how long, and in how many frames, it must be.
    step_px : motion from one frame to the next that is still none, up to 1280 px picture length; in proportion above.
    speed_px_s : the same, by the time between them, whichever is more: 30 px/s blur a picture of 1/60 s by 0.5 px.
    drift_px : the same, against the first frame of the hold: a hand is never quite still.
    clear_px : the same, against the frame that was taken: what has to move before another one is.
    gap_s : a pause between two frames after which nobody knows what happened.
    sharp_share : of the sharpness of the hold's best frame, that the frame which is taken must have.
    """

    hold_s: float = 0.7
    hold_frames: int = 4
    step_px: float = 0.5
    speed_px_s: float = 30.0
    drift_px: float = 6.0
    clear_px: float = 12.0
    gap_s: float = 1.0
    sharp_share: float = 0.9


ON_A_STAND = StillSettings(speed_px_s=0.0, drift_px=1.5, clear_px=6.0)
"""For an antenna that a load was hung on: all else stands, and it may still vibrate."""


@dataclass(frozen=True)
class Held:
    """What a frame has led to.

    Attributes
    ----------
    share : of the hold that is done, 0..1.
    take : this frame is to be taken.
    motion_px : since the frame before, where it moved most; NaN where that cannot be told.
    words : for the screen.
    """

    share: float
    take: bool
    motion_px: float
    words: str


@dataclass(frozen=True, eq=False)
class _Hold:
    first: Look
    frames: int
    best: float


class StillGate:
    """Says of each frame whether the scene has been still for long enough to take it.

    The frame that is taken is the one just fed; it waits for one that is nearly as sharp as the hold's best, since a
    lens may still be focusing. After that the scene must move clearly, and differ from what was taken, before another
    frame is. Depends on nothing but what it is fed, times included.
    """

    def __init__(self, settings: StillSettings | None = None) -> None:
        self._settings = settings or StillSettings()
        self._last: Look | None = None
        self._hold: _Hold | None = None
        self._taken: Look | None = None
        self._moved = True

    def rearm(self) -> None:
        """Forget what was taken: the same scene may be taken again, as after a picture that was refused."""
        self._taken, self._moved, self._hold = None, True, None

    def feed(
        self,
        image: np.ndarray,
        time_s: float,
        corners_px: np.ndarray | None = None,
        ids: np.ndarray | None = None,
    ) -> Held:
        """Judge the next frame.

        Parameters
        ----------
        image : (H, W) uint8.
        time_s : of the frame, on any clock that runs on.
        corners_px : (N, 2) corners of a board seen in it. Where this frame and the one it is held against share 4 or
            more, motion is theirs, and the rest of the picture is not looked at.
        ids : (N,) the corners' ids; without them corners are matched only where their number is the same.
        """
        look = look_at(image, time_s, corners_px, ids)
        last, self._last = self._last, look
        if last is None:
            return self._restart(look, math.nan, "hold still")
        if look.size != last.size:
            self.rearm()
            return self._restart(look, math.nan, "the picture's size has changed: hold still")
        if not 0 < look.time_s - last.time_s <= self._settings.gap_s:
            return self._restart(look, math.nan, "frames are missing: hold still")
        return self._judge(look, last)

    def _judge(self, look: Look, last: Look) -> Held:
        scale = max(1.0, max(look.size) / 1280)
        step_px = motion_px(look, last)
        if math.isnan(step_px):
            return self._restart(look, step_px, "nothing is seen that could be held still: more light, or focus")
        if self._taken is not None and not self._moved:
            self._moved = motion_px(look, self._taken) > self._settings.clear_px * scale
        allowed_px = max(self._settings.step_px, self._settings.speed_px_s * (look.time_s - last.time_s))
        if step_px > min(allowed_px, self._settings.drift_px) * scale:
            return self._restart(look, step_px, "moving: hold still")
        if not self._moved:
            self._hold = None
            return Held(0.0, False, step_px, "taken: now move on")
        if self._hold is None or motion_px(look, self._hold.first) > self._settings.drift_px * scale:
            return self._restart(look, step_px, "hold still")
        return self._go_on(look, self._hold, step_px, scale)

    def _go_on(self, look: Look, hold: _Hold, step_px: float, scale: float) -> Held:
        settings = self._settings
        hold = self._hold = _Hold(hold.first, hold.frames + 1, max(hold.best, look.sharpness))
        held_s = look.time_s - hold.first.time_s
        # a frame's time stamp is rounded, to milliseconds in videos
        share = min((held_s + 1e-3) / settings.hold_s, hold.frames / settings.hold_frames)
        if share < 1:
            return Held(share, False, step_px, "hold still")
        if self._taken is not None and motion_px(look, self._taken) <= 2 * settings.step_px * scale:
            return Held(0.0, False, step_px, "nothing has changed since the last picture: move on")
        if look.sharpness < settings.sharp_share * hold.best:
            if held_s > 2 * settings.hold_s:
                return self._restart(look, step_px, "the focus has changed: hold still")
            return Held(1.0, False, step_px, "hold still: waiting for a sharp frame")
        self._taken, self._moved, self._hold = look, False, None
        return Held(1.0, True, step_px, "taken")

    def _restart(self, look: Look, step_px: float, words: str) -> Held:
        self._hold = _Hold(look, 1, look.sharpness)
        return Held(0.0, False, step_px, words)
