"""Contacts from pictures and readings in real time: at once, and again once later frames are known."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from time import perf_counter
from typing import Any

import cv2
import numpy as np

from estimator.contact.drift import summary
from estimator.contact.estimate import STREAM, ContactEstimator, ContactStream
from estimator.contact.recording import (
    Detection,
    FrameContact,
    Ground,
    after,
    detect_again,
    first_detection,
    frame_contact,
    gravity,
    prepared,
)
from estimator.diagnose import RigWatch
from estimator.diagnose.consequences import RunningVerdict, changed_row
from estimator.table.contacts import ContactRow
from vbaa_calib.antenna.shape import bend
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.detect.whisker.corridor import pixels, width_px
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing
from vbaa_calib.streams.synchronize import Synchronized


@dataclass(frozen=True, eq=False)
class LiveContact:
    """A frame's contact, with its latency and alarms.

    Attributes
    ----------
    row : as in contacts.csv, contradicted where the verdict on the recording so far says so. item : the frame with its
        detection, and its contact before that verdict.
    final : from all frames, as `vbaa estimate` gives it; else at once, from this frame and those before it.
    latency_s : from the picture's arrival to this. age_s : longest time between the picture and one of its readings.
    image : (H, W[, 3]) the picture; None with a final contact. images : of several cameras by name.
    alarms : what the watch has found with this frame; empty with a final contact.
    """

    row: ContactRow
    item: FrameContact
    final: bool
    latency_s: float
    age_s: float = np.nan
    image: np.ndarray | None = None
    alarms: tuple[Diagnosis, ...] = ()
    images: Mapping[str, np.ndarray] = field(default_factory=dict)


class LiveEstimator:
    """Estimates contacts from a stream, for one calibrated rig.

    Every picture is answered twice: at once, and with its final contact, some `STREAM` frames later: by then the rig's
    drift is learnt from the free frames around it, and motion is judged by the frames on either side. The final
    contacts are those that `ContactEstimator.run` gives of the same frames, bit for bit; in their rows, those that the
    verdict on the recording concerns are contradicted.

    Parameters
    ----------
    estimator : for the rig, with model and friction.
    synchronizer : brings readings to the pictures' instants; counts what is left out.
    ground : what lies behind the antenna, where that is known.
    final : False: only what is known at once.
    watch : of the rig, while it is in use; its alarms come with the contacts.
    """

    @validate_arguments
    def __init__(
        self,
        estimator: ContactEstimator,
        synchronizer: Synchronizer,
        ground: Ground | None = None,
        *,
        final: bool = True,
        watch: RigWatch | None = None,
    ) -> None:
        self.estimator, self.synchronizer, self.watch = estimator, synchronizer, watch
        self.final, self._ground = final, ground
        self._later = ContactStream(estimator, little_by_little=True) if final else None
        self._now = ContactStream(estimator, live=True, companion=self._later)
        self._cameras = estimator.cameras if estimator.rig.others else {estimator.rig.camera_name: estimator}
        self._before = dict.fromkeys(self._cameras, np.empty((0, 2)))
        self._frames: deque[tuple[Synchronized, Detection]] = deque()
        self._finals = 0
        self.verdict = RunningVerdict(estimator.rig, waits=not synchronizer.live)

    def warm(self) -> None:
        """Load and prepare everything for which the first pictures would have to wait, by estimating drawn ones;
        what depends on the direction of gravity is prepared for many directions."""
        rig, own = self.estimator.rig, self.estimator
        # a search is prepared for the usual tilts
        for one, tilt_rad in product(rig.cameras.values(), np.linspace(-1.2, 1.2, 97)):
            prepared(one, Frame(None, 0.0, float(tilt_rad), 0.0, frame=0, time_s=0.0))
        trial = LiveEstimator(
            ContactEstimator(rig, own.model, friction=own.friction_rad, jobs=1),
            Synchronizer(Timing(), image_size=rig.image_sizes),
            final=self.final,
        )
        each = []
        for drawings in zip(*map(_drawn, rig.cameras.values()), strict=True):
            first, *rest = (
                Taken(0.0, image, 0.0, camera=name) for name, (_, image) in zip(rig.cameras, drawings, strict=True)
            )
            each.append(Synchronized(drawings[0][0], first, 0.0, tuple(rest)))
        seen = [trial._first_detection(one) for one in each]
        for number in range(STREAM + len(each)):
            drawn, found = each[number % len(each)], seen[number % len(each)]
            time_s = number / 60.0
            drawn = replace(drawn, frame=replace(drawn.frame, frame=number, time_s=time_s))
            found = replace(found, measured=replace(found.measured, time_s=time_s))
            for _ in trial._answered(drawn, found):
                pass
        for _ in trial.finish():
            pass

    def push(self, message: Taken | Reading | None) -> Iterator[LiveContact]:
        """The contacts that are ready with a picture or a reading; None: nothing has come, so that there is time for
        final ones."""
        if message is not None:
            for each in self.synchronizer.push(message):
                yield from self._estimate(each)
        elif self._later is not None:
            yield from map(self._finally, self._later.idle())

    @validate_arguments
    def tick(self, now_s: float) -> Iterator[LiveContact]:
        """The contacts of pictures that have waited long enough for readings, by the source's clock."""
        for each in self.synchronizer.ready(now_s):
            yield from self._estimate(each)

    def finish(self) -> Iterator[LiveContact]:
        """The contacts of all pending frames, at the end of the stream."""
        for each in self.synchronizer.finish():
            yield from self._estimate(each)
        self.verdict.finish()
        if self.watch is not None:
            self.watch.close()
        if self._later is not None:
            yield from map(self._finally, self._later.finish())

    def changed(self) -> dict[str, Any]:
        """The rig's changes from its free frames (`drift.summary`)."""
        return summary((self._later or self._now).drift)

    def _estimate(self, each: Synchronized) -> Iterator[LiveContact]:
        return self._answered(each, self._first_detection(each))

    def _first_detection(self, each: Synchronized) -> Detection:
        """The first detection in each camera's picture of a frame."""
        rig, several = self.estimator.rig, list[Detection]()
        for name, one in self._cameras.items():
            image = each.images.get(name) if rig.others else each.taken.image
            first = first_detection(one, each.frame, image, self._ground)
            first, self._before[name] = after(first, self._before[name])
            several += detect_again(one, [first])
        return Detection.together(rig, several) if rig.others else several[0]

    def _answered(self, each: Synchronized, seen: Detection) -> Iterator[LiveContact]:
        """A picture's immediate contact, and the final ones that are ready with it."""
        (contact,) = self._now.push(seen.measured)
        item = frame_contact(each.frame, seen, contact)
        latency_s = perf_counter() - each.taken.received_s
        self.verdict.push(seen.measured, item.contact)
        row = self._row(item, self.verdict.count - 1)
        alarms = () if self.watch is None else tuple(self.watch.push(seen.measured, item.contact))
        images = each.images if self.estimator.rig.others else {}
        yield LiveContact(row, item, False, latency_s, each.age_s, each.taken.image, alarms, images)
        if self._later is not None:
            # without its picture, which would fill the memory
            empty = replace(each.taken, image=np.empty((0, 0), np.uint8), arrived_s=0.0)
            kept = replace(each, taken=empty, others=())
            self._frames.append((kept, seen))
            yield from map(self._finally, self._later.push(seen.measured, each.taken.waiting > 0))

    def _finally(self, contact: Any) -> LiveContact:
        """The final contact of the frame that has waited longest."""
        each, seen = self._frames.popleft()
        item = frame_contact(each.frame, seen, contact)
        row, self._finals = self._row(item, self._finals), self._finals + 1
        latency_s = perf_counter() - each.taken.received_s
        return LiveContact(row, item, True, latency_s, each.age_s)

    def _row(self, item: FrameContact, number: int) -> ContactRow:
        contact = item.contact
        status, reason = changed_row(self.verdict.now, number, contact.status, contact.reason)
        return replace(ContactRow.of(item.frame, contact), status=status, reason=reason)


def _drawn(rig: Rig) -> Iterator[tuple[Frame, np.ndarray]]:
    """Drawn frames of a rig, free and bent to either side, each with its picture in grey and in colour."""
    antenna, T_camera_antenna = rig.antenna, rig.T_antenna_camera.inverse()
    static = Frame(None, 0.0, 0.0, rig.moment_sensor.offset_Nm, frame=0, time_s=0.0)
    line_level = 150.0 if rig.image.looks is None else float(np.mean(rig.image.looks, axis=0)[:3].mean())
    height = -(rig.image.height or 70.0) if rig.image.bright is False else rig.image.height or 70.0
    noise = np.random.default_rng(0).normal(line_level - height, 2.0, rig.camera.image_size[::-1])
    force_N = antenna.stiffness_Nm2 / antenna.length_m**2 / antenna.taper.yielding(np.ones(1))[0]
    for load_N in (0.0, 0.3 * force_N, -0.3 * force_N):
        contact_m, force = np.array([0.6 * antenna.length_m]), np.array([[0.0, load_N]])
        pull = gravity(rig, static)[None]
        curve = bend(antenna.parameters[None], antenna.length_m, pull, contact_m, force, taper=antenna.taper)
        line = pixels(rig.camera, T_camera_antenna, curve.points_m[0])
        middle_m = antenna.diameter_m * antenna.taper.middle
        thick = max(1, round(width_px(rig.camera, T_camera_antenna, curve.points_m[0], middle_m)))
        ink = np.zeros(noise.shape, np.uint8)
        cv2.polylines(ink, [np.rint(16.0 * line).astype(np.int32)], False, 255, thick, cv2.LINE_AA, 4)
        drawn = noise + height / 255.0 * cv2.GaussianBlur(ink, (0, 0), 0.7)
        picture = np.clip(drawn, 0.0, 255.0).astype(np.uint8)
        moment_Nm = float(rig.moment_sensor.gain * curve.moment_Nm[0] + rig.moment_sensor.offset_Nm)
        for image in (picture, cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)):
            yield replace(static, moment_Nm=moment_Nm), image
