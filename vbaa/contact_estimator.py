"""Contacts of one rig from whatever there is: a picture, pixels, a session, or frames while they come."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from estimator.contact import estimate
from estimator.contact.inputs import Batch, FrameOptions
from estimator.table.contacts import Contact, ContactTable
from vbaa_calib.core.arrays import as_float
from vbaa_calib.core.errors import InputError, shown

if TYPE_CHECKING:
    from estimator import RecordingVerdict
    from estimator.contact.recording import _FirstDetection


class ContactEstimator(estimate.ContactEstimator):
    __doc__ = estimate.ContactEstimator.__doc__
    verdict: RecordingVerdict | None = None
    """On the last session: what is wrong with it, and which rows that concerns."""

    def estimate(
        self,
        centreline_px: np.ndarray | Mapping[str, np.ndarray] | None = None,
        *,
        image: np.ndarray | str | Path | None = None,
        moment: float | None,
        pan: float,
        tilt: float,
        sigma_px: np.ndarray | float | Mapping[str, np.ndarray | float] | None = None,
        moment_z: float | None = None,
        **options: Unpack[FrameOptions],
    ) -> Contact:
        """One frame: its picture, pixels of the antenna, or points on plane C.

        Parameters
        ----------
        image : a file, or (H, W) grey or (H, W, 3) blue, green, red of 8 bits, as OpenCV reads it, of the rig's camera.
        centreline_px : (N, 2) pixels on the antenna's centreline, in any order; rows with NaN are ignored.
        moment : the sensor's reading, N·m; None or NaN for vision alone.
        pan, tilt : joint angles, rad.
        sigma_px : standard deviation across the antenna, one or (N,), of centreline_px; by default what the rig's own
            pictures showed.
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
        from estimator.contact.recording import detect_again, frame_contact  # loads the detector

        first = self._seen(0, image, moment=moment, pan=pan, tilt=tilt, moment_z=moment_z, readings=read)
        (seen,) = detect_again(self, [first])
        return frame_contact(first.frame, seen, self.measure(seen.measured)).contact

    def estimate_session(self, path: str | Path, *, no_moment: bool = False) -> ContactTable:
        """Every frame of a recording, as `vbaa estimate` writes it: of a session, a bag or a video.

        What the frames together show to be wrong is in `verdict`, and its rows are `contradicted`. no_moment : by the
        pictures alone. Raises InputError for what is wrong in its files.
        """
        from estimator.contact.source import estimate_source, open_source
        from estimator.diagnose import RecordingWatch
        from estimator.diagnose.consequences import changed_row, with_unused
        from estimator.table.contacts import ContactRow
        from estimator.table.overview import Overview
        from vbaa_calib.session import drift_of

        source = open_source(Path(path), self.rig, no_moment)
        rig = replace(self.rig, drift=drift_of(None, source.drift, self.rig.drift))
        own = estimate.ContactEstimator(rig, self.model, friction=self.friction_rad, jobs=self.jobs)
        watch, overview, rows = RecordingWatch(rig), Overview(rig.columns), list[ContactRow]()
        for item in estimate_source(own, source):
            watch.push(item.measured, item.contact)
            overview.add_readings(item.frame, item.measured, item.contact)
            rows.append(ContactRow.of(item.frame, item.contact))
        self.drift = own.drift
        self.verdict = verdict = with_unused(watch.verdict(), overview.unused, overview.frames)
        for number, row in enumerate(rows):
            status, reason = changed_row(verdict, number, row.status, row.reason)
            rows[number] = replace(row, status=status, reason=reason)
        if not rows:
            raise InputError("has no frame", where=path, remedy="record at least one")
        return ContactTable.from_rows(rows)

    def live(self, frames: Iterable[Mapping[str, Any]]) -> Iterator[Contact]:
        """Each frame's contact as it comes, by this frame and those before it: motion and the rig's drift count.

        frames : mappings with image, moment, pan, tilt and, where they are known, moment_z, readings and time_s, as
            `estimate` takes them. For readings at other instants than the pictures': `estimator.live`.
        """
        from estimator.contact.recording import after, detect_again, frame_contact

        stream, before = estimate.ContactStream(self, live=True), np.empty((0, 2))
        for number, each in enumerate(frames):
            if not isinstance(each, Mapping) or not {"image", "moment", "pan", "tilt"} <= set(each):
                remedy = "give a mapping with image, moment, pan and tilt for each"
                raise InputError(f"frame {number} is {shown(each)}", remedy=remedy)
            first, before = after(self._seen(number, **each), before)
            (seen,) = detect_again(self, [first])
            for contact in stream.push(seen.measured):
                yield frame_contact(first.frame, seen, contact).contact

    def _seen(
        self,
        number: int,
        image: Any,
        *,
        moment: Any,
        pan: Any,
        tilt: Any,
        moment_z: Any = None,
        readings: Any = None,
        time_s: Any = np.nan,
    ) -> _FirstDetection:
        """A first look at a picture and what was read with it. Raises InputError."""
        from estimator.contact.recording import first_look, read_own
        from vbaa_calib.session import READINGS, Frame

        read: Any = {"moments": [moment], "moments_z": [moment_z]}
        read |= {name: [value] for name, value in (readings or {}).items()}
        checked = Batch.checked(self.rig, np.full((1, 1, 2), np.nan), read, {"pans": [pan], "tilts": [tilt]}, None, {})
        of_y, *others = checked.readings_Nm[0].tolist()
        more = dict(zip(list(READINGS.values())[1:], others, strict=True))
        time_s = as_float(time_s, "time_s", "give seconds")
        frame = Frame(None, float(pan), float(tilt), of_y, frame=number, time_s=time_s, **more)
        if isinstance(image, str | os.PathLike):
            return first_look(self, frame, read_own(self.rig, Path(image)))
        width, height = self.rig.camera.image_size
        shape = image.shape if isinstance(image, np.ndarray) and image.dtype == np.uint8 else ()
        if shape not in ((height, width), (height, width, 3)):
            kind = f"of {image.dtype}" if isinstance(image, np.ndarray) else shown(image)
            what = f"image has shape {shape}" if shape else f"image is {kind}"
            remedy = (
                f"give a file, or an array of 8 bits, ({height}, {width}) or ({height}, {width}, 3), as OpenCV reads"
            )
            raise InputError(what, remedy=remedy)
        return first_look(self, frame, image)
