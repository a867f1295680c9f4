"""Pictures and readings in, as they come; contacts out, at once, and once more when later frames are known."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import cv2
import numpy as np

from estimator.contact.drift import summary
from estimator.contact.estimate import ContactEstimator, ContactStream
from estimator.contact.recording import (
    Detection,
    FrameContact,
    Ground,
    after,
    detect_again,
    first_look,
    frame_contact,
    gravity,
    measured_points,
)
from estimator.table.contacts import ContactRow
from vbaa_calib.core.arrays import gate
from vbaa_calib.detect.whisker.antenna import free_curve, pixels, width_px
from vbaa_calib.session import Frame
from vbaa_calib.streams import Reading, Synchronizer, Taken
from vbaa_calib.streams.synchronize import Synchronized

_FINAL_AT_ONCE = 4
"""Frames whose final contacts are worked out with one picture: few enough that it is hardly late."""


@dataclass(frozen=True, eq=False)
class LiveContact:
    """A frame's contact.

    Attributes
    ----------
    row : as in contacts.csv. item : with what was seen.
    final : from all frames, as `vbaa estimate` gives it; else at once, from this frame and those before it.
    latency_s : from the picture's arrival to this. age_s : of the reading that was interpolated furthest.
    image : (H, W[, 3]) the picture; None with a final contact.
    """

    row: ContactRow
    item: FrameContact
    final: bool
    latency_s: float
    age_s: float = np.nan
    image: np.ndarray | None = None


class LiveEstimator:
    """Contacts from a stream, for one calibrated rig.

    Every picture is answered twice: at once, and with its final contact, some `STREAM` frames later: by then the rig's
    drift is learnt from the free frames around it, and motion is judged by the frames on either side. The final
    contacts are those that `ContactEstimator.run` gives of the same frames, bit for bit.

    Parameters
    ----------
    estimator : for the rig, with model and friction.
    synchronizer : brings readings to the pictures' instants; counts what is left out.
    ground : what lies behind the antenna, where that is known.
    final : False: only what is known at once.
    """

    @gate
    def __init__(
        self,
        estimator: ContactEstimator,
        synchronizer: Synchronizer,
        ground: Ground | None = None,
        *,
        final: bool = True,
    ) -> None:
        self.estimator, self.synchronizer = estimator, synchronizer
        self.final, self._ground = final, ground
        self._later = ContactStream(estimator, at_once=_FINAL_AT_ONCE) if final else None
        self._now = ContactStream(estimator, live=True, beside=self._later)
        self._before = np.empty((0, 2))
        self._frames: deque[tuple[Synchronized, Detection]] = deque()
        self._watched = 0

    def warm(self) -> None:
        """Load and prepare what the first picture would wait for."""
        rig = self.estimator.rig
        frame = Frame(None, 0.0, 0.0, rig.moment_sensor.offset_Nm, frame=0, time_s=0.0)
        free = free_curve(rig.antenna.parameters, rig.antenna.length_m, gravity(rig, frame)).points_m[0]
        T_camera_antenna = rig.T_antenna_camera.inverse()
        line = pixels(rig.camera, T_camera_antenna, free)
        thick = max(1, round(width_px(rig.camera, T_camera_antenna, free, rig.antenna.diameter_m)))
        picture = np.random.default_rng(0).normal(110.0, 2.0, rig.camera.image_size[::-1]).astype(np.uint8)
        cv2.polylines(picture, [np.rint(line).astype(np.int32)], False, 180, thick, cv2.LINE_AA)
        picture = 255 - picture if rig.image.bright is False else picture
        (seen,) = detect_again(self.estimator, [first_look(self.estimator, frame, picture)])
        ready = measured_points(rig, frame, {0: np.column_stack([line, np.full(len(line), np.nan)])})
        trial = ContactEstimator(rig, self.estimator.model, friction=self.estimator.friction_rad, jobs=1)
        trial.rough([ready])
        for contact in trial.run([ready] * 3, live=True):
            ContactRow.of(frame, frame_contact(frame, seen, contact).contact)

    def push(self, message: Taken | Reading | None) -> Iterator[LiveContact]:
        """The contacts that are there with a picture or a reading; None: some time has passed, see `tick`."""
        if message is not None:
            for each in self.synchronizer.push(message):
                yield from self._estimate(each)

    @gate
    def tick(self, now_s: float) -> Iterator[LiveContact]:
        """The contacts of pictures that have waited for readings long enough, by the source's clock."""
        for each in self.synchronizer.ready(now_s):
            yield from self._estimate(each)

    def finish(self) -> Iterator[LiveContact]:
        """All that still waits; nothing comes after it."""
        for each in self.synchronizer.finish():
            yield from self._estimate(each)
        if self._later is not None:
            yield from map(self._finally, self._later.finish())

    def changed(self) -> dict[str, Any] | None:
        """How the rig has changed (`drift.summary`), if free frames have shown more of it since last asked."""
        drift = self._now.drift
        if drift.frames == self._watched:
            return None
        self._watched = drift.frames
        return summary(drift)

    def _estimate(self, each: Synchronized) -> Iterator[LiveContact]:
        first = first_look(self.estimator, each.frame, each.taken.image, self._ground)
        first, self._before = after(first, self._before)
        (seen,) = detect_again(self.estimator, [first])
        (contact,) = self._now.push(seen.measured)
        item = frame_contact(each.frame, seen, contact)
        latency_s = perf_counter() - each.taken.received_s
        row = ContactRow.of(each.frame, item.contact)
        yield LiveContact(row, item, False, latency_s, each.age_s, each.taken.image)
        if self._later is not None:
            # without its picture, which would fill the memory
            kept = Synchronized(
                each.frame, Taken(each.taken.time_s, _NO_PICTURE, 0.0, each.taken.received_s), each.age_s
            )
            self._frames.append((kept, seen))
            yield from map(self._finally, self._later.push(seen.measured))

    def _finally(self, contact: Any) -> LiveContact:
        each, seen = self._frames.popleft()
        item = frame_contact(each.frame, seen, contact)
        latency_s = perf_counter() - each.taken.received_s
        return LiveContact(ContactRow.of(each.frame, item.contact), item, True, latency_s, each.age_s)


_NO_PICTURE = np.empty((0, 0), np.uint8)
