"""Contacts of one rig from any input: a picture, pixels, a session, or frames as they come."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from estimator.contact.estimate import ContactEstimator, ContactStream
from estimator.contact.inputs import Batch, FrameOptions
from estimator.table.contacts import Contact, ContactTable
from vbaa_calib.core.arrays import as_float
from vbaa_calib.core.errors import InputError, quoted

if TYPE_CHECKING:
    from estimator import RecordingVerdict
    from estimator.contact.recording import _FirstDetection
    from vbaa_calib.session import Frame


class SessionContactEstimator(ContactEstimator):
    __doc__ = ContactEstimator.__doc__
    verdict: RecordingVerdict | None = None
    """On the last session: what is wrong with it, and which rows that concerns."""

    def estimate(
        self,
        centreline_px: np.ndarray | Mapping[str, np.ndarray] | None = None,
        *,
        image: np.ndarray | str | Path | Mapping[str, np.ndarray | str | Path] | None = None,
        moment: float | None,
        pan: float,
        tilt: float,
        sigma_px: np.ndarray | float | Mapping[str, np.ndarray | float] | None = None,
        moment_z: float | None = None,
        **options: Unpack[FrameOptions],
    ) -> Contact:
        """The contact of one frame: from its picture, pixels of the antenna, or points on plane C.

        Parameters
        ----------
        image : a file, or (H, W) grey or (H, W, 3) blue, green, red of 8 bits, as OpenCV reads it, of the rig's camera;
            of several cameras those that there are, by name.
        centreline_px : (N, 2) pixels on the antenna's centreline, in any order; rows with NaN are ignored.
        moment : the sensor's reading, N·m; None or NaN for vision alone.
        pan, tilt : joint angles, rad.
        sigma_px : standard deviation across the antenna, one or (N,), of centreline_px; by default the points' own
            scatter, and no less than the rig's pictures showed.
        moment_z : reading of a second sensor about z, if the rig has one.
        readings : further ones of a wrench sensor, by the columns of `session.READINGS`.
        jacobian : whether the contact gets its derivatives by pixels, moments, joints and rig; not of an image.
        plane_xy_m, covariance_m2 : (N, 2) m on plane C as `rig.camera_on_plane()` gives them, and (N, 2, 2) m².

        Raises
        ------
        InputError : not one of them; wrong shapes, what is no number, angles beyond a turn, moments and pixels that
            cannot be, a picture that cannot be read or has another size than the rig's.
        """
        if image is None and centreline_px is None and not options.keys() - {"jacobian", "readings"}:
            raise InputError("nothing was seen", remedy="give one of image, centreline_px and plane_xy_m")
        if image is None:
            readings: Any = {"moment": moment, "pan": pan, "tilt": tilt, "moment_z": moment_z}
            return super().estimate(centreline_px, **readings, sigma_px=sigma_px, **options)
        read = options.pop("readings", None)
        if centreline_px is not None or sigma_px is not None or options:
            remedy = "give one of image, centreline_px and plane_xy_m, and sigma_px and jacobian with the latter two"
            raise InputError("image stands for the pixels", remedy=remedy)
        from estimator.contact.recording import Detection, detect_again, frame_contact  # loads the detector

        firsts = self._first_detections(
            0, {"image": image, "moment": moment, "pan": pan, "tilt": tilt, "moment_z": moment_z, "readings": read}
        )
        parts = [detect_again(one, [first])[0] for one, first in firsts]
        seen = Detection.together(self.rig, parts) if self.rig.others else parts[0]
        return frame_contact(firsts[0][1].frame, seen, self.measure(seen.measured)).contact

    def estimate_session(self, path: str | Path, *, no_moment: bool = False) -> ContactTable:
        """The contacts of every frame of a recording, as `vbaa estimate` writes them: of a session, a bag or a
        video.

        What the frames together show to be wrong is in `verdict`, and its rows are `contradicted`. no_moment : by the
        pictures alone. Raises InputError for what is wrong in its files.
        """
        from estimator.contact.source import open_source
        from estimator.diagnose import RecordingWatch
        from estimator.diagnose.consequences import changed_row, with_unused
        from estimator.table.overview import Overview
        from vbaa_calib.session import drift_of

        source = open_source(Path(path), self.rig, no_moment)
        rig = replace(self.rig, drift=drift_of(None, source.drift, self.rig.drift))
        own = ContactEstimator(rig, self.model, friction=self.friction_rad, jobs=self.jobs)
        watch, overview = RecordingWatch(rig), Overview(rig.columns)
        tables = list(source.tables(own, overview, watch))
        self.drift = own.drift
        self.verdict = verdict = with_unused(watch.verdict(), overview.unused, overview.frames)
        if not tables:
            raise InputError("has no frame", where=path, remedy="record at least one")
        table = ContactTable.joined(tables)
        pairs = zip(table.status.tolist(), table.reason.tolist(), strict=True)
        status, reason = zip(*(changed_row(verdict, number, *pair) for number, pair in enumerate(pairs)), strict=True)
        return replace(table, status=np.array(status), reason=np.array(reason))

    def live(self, frames: Iterable[Mapping[str, Any]]) -> Iterator[Contact]:
        """Yields each frame's contact as it comes, from this frame and those before it, with motion test and drift.

        frames : mappings with image, moment, pan, tilt and, where they are known, moment_z, readings and time_s, as
            `estimate` takes them. For readings at other instants than the pictures': `estimator.live`.
        """
        from estimator.contact.recording import Detection, after, detect_again, frame_contact

        stream, before = ContactStream(self, live=True), [np.empty((0, 2))] * len(self.rig.cameras)
        for number, each in enumerate(frames):
            if not isinstance(each, Mapping) or not {"image", "moment", "pan", "tilt"} <= set(each):
                remedy = "give a mapping with image, moment, pan and tilt for each"
                raise InputError(f"frame {number} is {quoted(each)}", remedy=remedy)
            parts, looks = [], self._first_detections(number, each)
            for index, (one, look) in enumerate(looks):
                first, before[index] = after(look, before[index])
                parts.append(detect_again(one, [first])[0])
            seen = Detection.together(self.rig, parts) if self.rig.others else parts[0]
            for contact in stream.push(seen.measured):
                yield frame_contact(looks[0][1].frame, seen, contact).contact

    def _first_detections(
        self, number: int, read: Mapping[str, Any]
    ) -> list[tuple[SessionContactEstimator, _FirstDetection]]:
        """First detections in each camera's picture, with the estimator of each. Raises InputError."""
        from estimator.contact.recording import first_detection

        if not self.rig.others:
            return [(self, self._seen(number, **read))]
        images, names = read["image"], self.rig.cameras
        if not isinstance(images, Mapping) or not images or images.keys() - names.keys():
            remedy = f"give {{name: picture}} of some of its cameras: {', '.join(names)}"
            raise InputError(f"the rig has several cameras, image is {quoted(images)}", remedy=remedy)
        found = []
        for name, one in self.cameras.items():
            more = {key: value for key, value in read.items() if key != "image"}
            if name in images:
                found.append((one, one._seen(number, images[name], **more)))
            else:
                found.append((one, first_detection(one, one._frame(number, **more), None)))
        return found

    def _seen(self, number: int, image: Any, **read: Any) -> _FirstDetection:
        """The first detection in a picture with its readings. Raises InputError."""
        from estimator.contact.recording import first_detection, read_own

        frame = self._frame(number, **read)
        if isinstance(image, str | os.PathLike):
            return first_detection(self, frame, read_own(self.rig, Path(image)))
        width, height = self.rig.camera.image_size
        shape = image.shape if isinstance(image, np.ndarray) and image.dtype == np.uint8 else ()
        if shape not in ((height, width), (height, width, 3)):
            kind = f"of {image.dtype}" if isinstance(image, np.ndarray) else quoted(image)
            what = f"image has shape {shape}" if shape else f"image is {kind}"
            remedy = (
                f"give a file, or an array of 8 bits, ({height}, {width}) or ({height}, {width}, 3), as OpenCV reads"
            )
            raise InputError(what, remedy=remedy)
        return first_detection(self, frame, image)

    def _frame(
        self,
        number: int,
        *,
        moment: Any,
        pan: Any,
        tilt: Any,
        moment_z: Any = None,
        readings: Any = None,
        time_s: Any = np.nan,
    ) -> Frame:
        """The readings of a picture as a frame. Raises InputError."""
        from vbaa_calib.session import READINGS, Frame

        read: Any = {"moments": [moment], "moments_z": [moment_z]}
        read |= {name: [value] for name, value in (readings or {}).items()}
        checked = Batch.checked(self.rig, np.full((1, 1, 2), np.nan), read, {"pans": [pan], "tilts": [tilt]}, None, {})
        of_y, *others = checked.readings_Nm[0].tolist()
        more = dict(zip(list(READINGS.values())[1:], others, strict=True))
        time_s = as_float(time_s, "time_s", "give seconds")
        return Frame(None, float(pan), float(tilt), of_y, frame=number, time_s=time_s, **more)
