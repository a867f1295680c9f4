"""The estimator: from centrelines, moments and joint angles to contacts with their uncertainty."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain, islice
from typing import Any, Self, Unpack

import numpy as np

from estimator.solver.frames import Frames
from estimator.solver.ladder import rough_fits, solve
from estimator.solver.linearised import bend
from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import FRICTION_RAD, LOCATED, Contact, Measured
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import as_float, as_floats, validate_arguments
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.core.threads import cores
from vbaa_calib.native import core
from vbaa_calib.rig import Rig
from vbaa_calib.session import DRIFTS

from .contacts import Contacts, MotionCheck, contacts_of, jacobian_of, last, motion_of
from .drift import LearntRig
from .inputs import Batch, FrameOptions, Lines, without_outliers
from .motion import Beam, Shapes
from .settings import ContactSettings
from .status import unexplained

CHUNK = 2048
"""Frames that are solved at once."""
STREAM = 64
"""Frames of a recording that are solved at once, each batch from where the one before ended."""


class ContactEstimator:
    """Estimates contacts from centrelines, for one calibrated rig.

    Parameters
    ----------
    rig : the calibrated rig.
    model : a rung of the ladder, `antenna.rungs.RUNGS`, or "auto": the highest rung's answers, and with each the lowest
        rung with a predicted bias that is small against the noise.
    friction : rad, standard deviation of the friction angle (the force's angle from the antenna's normal); 0 for
        contacts without friction.
    jobs : threads over the frames of a batch; by default the processor's cores. The results are the same for any.

    Raises
    ------
    InputError : an unknown model, a friction that is out of range, no thread.
    """

    def __init__(
        self, rig: Rig, model: str = "auto", *, friction: float = FRICTION_RAD, jobs: int | None = None
    ) -> None:
        if not isinstance(model, str) or model not in ("auto", *RUNGS):
            raise InputError(f"model is {quoted(model)}", remedy=f"one of auto, {', '.join(RUNGS)} is needed")
        if not isinstance(rig, Rig):
            raise InputError(f"rig is {quoted(rig)}", remedy="give what Rig.load returns")
        if rig.clamp is not None:
            remedy = "estimate lines of its antennas: vbaa estimate --centrelines FILE, or clamp_tracks"
            raise InputError("the rig's clamp moves, which no single frame shows", remedy=remedy)
        in_rad = "give the angle's deviation in rad, 0 to 1"
        if not 0.0 <= as_float(friction, "friction", in_rad) <= 1.0:
            raise InputError(f"friction is {friction}", remedy=in_rad)
        if jobs is not None and not (type(jobs) is int and jobs >= 1):
            raise InputError(f"jobs is {quoted(jobs)}", remedy="give a number of threads, 1 or more")
        self.rig, self.model, self.friction_rad = rig, model, float(friction)
        self.jobs = cores() if jobs is None else jobs
        self.drift = LearntRig.of(rig)
        """The rig's drift as learnt from the last recording's free frames."""
        self._rig_arrays = RigArrays.from_rig(rig, self.friction_rad)
        self._rung = RUNGS[-1] if model == "auto" else model
        self._then: tuple[LearntRig, float, ContactEstimator] | None = None
        self._learnt: ContactEstimator | None = None

    @cached_property
    def _alone(self) -> Callable[..., Contact | None] | None:
        """`Contacts.one_by_one` of this rig; None for several cameras, or for joint axes with uncertainty."""
        possible = not self.rig.others and self.rig.kinematics.axes_known
        return Contacts.one_by_one(self._rig_arrays, self.friction_rad, self.model) if possible else None

    @cached_property
    def cameras(self) -> dict[str, Self]:
        """An estimator for each single camera of the rig, by name."""
        friction, jobs = self.friction_rad, self.jobs
        return {
            name: type(self)(one, self.model, friction=friction, jobs=jobs) for name, one in self.rig.cameras.items()
        }

    def estimate(
        self,
        centreline_px: np.ndarray | Mapping[str, np.ndarray] | None = None,
        *,
        moment: float | None,
        pan: float,
        tilt: float,
        sigma_px: np.ndarray | float | Mapping[str, np.ndarray | float] | None = None,
        moment_z: float | None = None,
        **options: Unpack[FrameOptions],
    ) -> Contact:
        """The contact of one frame.

        Parameters
        ----------
        centreline_px : (N, 2) pixels on the antenna's centreline, in any order; rows with NaN are ignored. Of a rig
            with several cameras, those of each that saw the antenna, by its name.
        moment : the sensor's reading, N·m; None or NaN for vision alone.
        pan, tilt : joint angles, rad.
        sigma_px : standard deviation across the antenna, one or (N,); by default the points' own scatter, and no less
            than the rig's pictures showed. Of several cameras one for all, or by name.
        moment_z : reading of a second sensor about z, if the rig has one.
        readings : further ones of a wrench sensor, by the columns of `session.READINGS`.
        jacobian : whether the contact gets its derivatives, `Contact.jacobian`.
        plane_xy_m : in place of centreline_px, (N, 2) m on plane C as `rig.camera_on_plane()` gives them of one
            camera's pixels, NumPy or tensor: the contact is that of the pixels. What the layer cannot give
            (behind the camera, beyond its lens, grazing) counts among the points outside the picture.
        covariance_m2 : (N, 2, 2) m² of these points, or (2, 2) of all; by default the pixels' `sigma_px`.

        Raises
        ------
        InputError : wrong shapes, what is no number, angles beyond a turn, impossible moments and pixels, both or
            neither of centreline_px and plane_xy_m, a camera in plane C.
        """
        usual = sigma_px is None and not options
        if usual and self._alone is not None:
            found = self._alone(centreline_px, moment, moment_z, pan, tilt)
            if found is not None:
                return found
        return self.estimate_batch(**_as_batch(centreline_px, moment, (pan, tilt), sigma_px, moment_z, options))[0]

    def estimate_two(
        self,
        centreline_px: np.ndarray | Mapping[str, np.ndarray] | None = None,
        *,
        moment: float | None,
        pan: float,
        tilt: float,
        sigma_px: np.ndarray | float | Mapping[str, np.ndarray | float] | None = None,
        moment_z: float | None = None,
        **options: Unpack[FrameOptions],
    ) -> list[Contact]:
        """Both contacts of a frame with two, the nearer one first; else the one of `estimate`.

        The parameters are those of `estimate`, without jacobian. Two contacts are searched where no single one explains
        the frame, and reported where the frame determines both; otherwise the single contact's reason names them. The
        antenna's end and points' covariances other than `sigma_px` are not used.

        Raises InputError as `estimate`, and for an antenna that is not uniform.
        """
        batch = self._checked(**_as_batch(centreline_px, moment, (pan, tilt), sigma_px, moment_z, options))
        if self.rig.antenna.taper:
            raise InputError("the antenna is not uniform", where="rig", remedy="use estimate: one contact at a time")
        (one,) = contacts = self._contacts(batch)
        if not unexplained(contacts.numbers)[0]:
            return [one]
        return self._both(contacts, batch)

    def measure_two(self, measured: Measured) -> list[Contact]:
        """`estimate_two` for a validated frame, with the rig as updated by the last recording's free frames. The
        antenna must be uniform."""
        if self._learnt is None or self._learnt.drift is not self.drift:
            self._learnt = self._with(self.drift)
        now = self._learnt
        batch = Batch.of(now.rig, [measured])
        (one,) = contacts = now._contacts(batch)
        if contacts.numbers.points[0] < ContactSettings.fewest_points or not unexplained(contacts.numbers)[0]:
            return [one]
        return now._both(contacts, batch)

    def _both(self, contacts: Contacts, batch: Batch) -> list[Contact]:
        """Both contacts of a frame that no single one explains; the one, where the frame does not determine two."""
        from .two_contacts import both_contacts

        return both_contacts(contacts[0], contacts.numbers.unknowns[0], self._rig_arrays, batch)

    def _checked(self, **data: Any) -> Batch:
        """The validated arguments of `estimate_batch`. Raises InputError."""
        read = {"moments": data["moments"], "moments_z": data["moments_z"], **(data.get("readings") or {})}
        joints = {name: data[name] for name in ("pans", "tilts")}
        plane: Mapping[str, Any] = {name: data[name] for name in ("plane_xy_m", "covariance_m2") if name in data}
        return Batch.checked(self.rig, data["centrelines_px"], read, joints, data["sigma_px"], plane)

    def estimate_batch(
        self,
        centrelines_px: Lines | Mapping[str, Lines] | None = None,
        moments: Sequence[float | None] | np.ndarray | None = None,
        pans: Sequence[float] | np.ndarray | None = None,
        tilts: Sequence[float] | np.ndarray | None = None,
        *,
        sigma_px: np.ndarray | float | Mapping[str, np.ndarray | float] | None = None,
        moments_z: Sequence[float | None] | np.ndarray | None = None,
        **options: Unpack[FrameOptions],
    ) -> Contacts:
        """The contacts of B frames: a sequence of `Contact`, with its columns as arrays.

        Parameters
        ----------
        centrelines_px : (B, N, 2), or B arrays (N_i, 2) of their own lengths; rows with NaN are ignored. Of a rig
            with several cameras such ones by name; a camera without a point in a frame drops out of that.
        moments, moments_z : (B,) N·m, None or an entry None or NaN for vision alone. pans, tilts : (B,) rad.
        readings : (B,) of each further column of `session.READINGS`.
        sigma_px : one, (B, 1) or (B, N); by default the points' own scatter, and no less than the rig's pictures
            showed.
        jacobian : whether the contacts get their derivatives, `Contacts.jacobian`.
        plane_xy_m, covariance_m2 : in place of pixels, (B, N, 2) m and (B, N, 2, 2) m², or B of their own lengths, as
            for `estimate`; `Measured.on_plane` makes the frames of `run` of them.

        Raises
        ------
        InputError : as `estimate`, or an argument without a value for every frame.
        """
        lines = {"centrelines_px": centrelines_px, "moments": moments, "pans": pans, "tilts": tilts, **options}
        batch = self._checked(**lines, sigma_px=sigma_px, moments_z=moments_z)
        contacts = self._contacts(batch)
        if not options.get("jacobian", False):
            return contacts
        located = np.isin(contacts.status, LOCATED)
        return replace(contacts, jacobian=jacobian_of(batch, self._rig_arrays, self._rung, contacts.numbers, located))

    @validate_arguments
    def run(self, recording: Iterable[Measured], *, live: bool = False) -> Iterator[Contact]:
        """Estimates a recording frame by frame, in order and in constant memory.

        Frames are taken `STREAM` at a time, and the solver begins at the last contact before them. Frames with times
        are tested for motion with those around them (`motion`), so that a contact comes out a little later. A recording
        that begins with contacts waits for its first free frames, 1024 frames at most: they say how the rig has
        changed. With `live` each frame is answered as it comes, tested with those before it.
        """
        stream = ContactStream(self, live=live)
        return chain((each for measured in recording for each in stream.push(measured)), stream.finish())

    def run_together(self, recording: Iterable[Batch]) -> Iterator[Contacts]:
        """As `run`, for a recording's frames `STREAM` at a time, the last ones less: as many contacts at a time as
        come."""
        stream = ContactStream(self)
        return chain((each for batch in recording for each in stream.push_together(batch)), stream.finish_together())

    def after_free_frames(self, batch: Batch) -> Generator[None, None, ContactEstimator]:
        """The estimator with the rig's drift updated from the free ones of some frames (generator of work steps)."""
        time_s = batch.last_s
        if not self.drift.due(time_s):
            return self
        learnt = yield from self.drift.later(time_s).learn(batch, time_s)
        if learnt.frames > self.drift.frames:
            return self._with(learnt)
        if not learnt.frames:
            self.drift = replace(self.drift, searched=learnt.searched)
        return self

    def at(self, time_s: float) -> ContactEstimator:
        """The estimator with the rig's drift extrapolated to a time after its last free frames, or before the first."""
        if not (then_s := self.drift.reckoned_s(time_s)) > self.drift.time_s:
            return self
        if self._then is None or self._then[:2] != (self.drift, then_s):
            self._then = self.drift, then_s, self._with(self.drift.later(then_s))
        return self._then[2]

    def _with(self, learnt: LearntRig) -> ContactEstimator:
        later = ContactEstimator(learnt.now, self.model, friction=self.friction_rad, jobs=self.jobs)
        later.drift = learnt
        return later

    def measure(self, measured: Measured) -> Contact:
        """The contact of one validated frame."""
        return self.measure_batch([measured])[0]

    def measure_batch(self, several: Sequence[Measured]) -> Contacts:
        """The contacts of validated frames, estimated independently; unlike the other calls also with the antenna's
        end."""
        return self._contacts(Batch.of(self.rig, several))

    def rough(self, several: Sequence[Measured]) -> list[tuple[np.ndarray, np.ndarray] | None]:
        """A quick fit of each frame on a low rung: unknowns (4,), `rig_arrays.UNKNOWNS`, and the antenna's nodes (M,
        3), antenna frame; None for a frame with too few points."""
        frames = Batch.of(self.rig, several).frames(self._rig_arrays)
        found: list[tuple[np.ndarray, np.ndarray] | None] = [None] * len(several)
        enough = np.flatnonzero(frames.usable.sum(-1) >= ContactSettings.fewest_points)
        if len(enough):
            frames = frames if len(enough) == len(several) else frames.picked(enough)
            for index, own, points_m in zip(enough, *rough_fits(frames), strict=True):
                found[index] = own, points_m
        return found

    def shape(self, measured: Measured) -> np.ndarray | None:
        """(M, 3) nodes of the fitted antenna, antenna frame; None with too few points."""
        frames = (batch := Batch.of(self.rig, [measured])).frames(self._rig_arrays)
        if int(frames.usable.sum()) < ContactSettings.fewest_points:
            return None
        found = solve(frames, self.model, batch.start)
        return np.asarray(bend(frames, self._rung, found.unknowns[:, None]).points_m[0])

    def _contacts(self, batch: Batch, beam: Beam | None = None) -> Contacts:
        """The frames' contacts; with a beam, also what is needed to test them for motion."""
        return last(self.contacts_in_parts(batch, beam, CHUNK))

    def contacts_in_parts(
        self, batch: Batch, beam: Beam | None, most: int, known: Mapping[int, FitNumbers] | None = None
    ) -> Generator[None, None, Contacts]:
        """The frames' contacts, at most `most` frames a work step, for callers with other work in between.

        known : what this estimator has found for some of the frames, by index.
        """
        count, known = len(batch), known or {}
        left = np.array([row for row in range(count) if row not in known], np.intp) if known else np.arange(count)
        found = None if 0 < len(left) == count <= most else FitNumbers.empty(count)
        if known and found is not None:
            for begin in range(0, len(known), ContactSettings.frames_per_step):
                some = dict(islice(known.items(), begin, begin + ContactSettings.frames_per_step))
                found.put(np.array(list(some)), FitNumbers.joined(list(some.values())))
                yield
        for begin in range(0, len(left), most):
            if begin:
                yield
            # a slice copies no points
            rows = left[begin : begin + most] if known else slice(begin, begin + most)
            if found is None:
                found = self._fitted(batch, beam)
            else:
                found.put(rows, self._fitted(batch.picked(rows), beam))
        assert found is not None
        contacts = contacts_of(found, self._rig_arrays.rig, self.friction_rad, batch, self.model)
        if (weights := batch.weights(self._rig_arrays)) is None:
            return contacts
        return replace(contacts, moment_residual_Nm=contacts.moment_residual_Nm / weights[:, 0])

    def _fitted(self, batch: Batch, beam: Beam | None = None) -> FitNumbers:
        """The fits of frames with enough points; frames that do not fit are fitted again with other explanations."""
        plain = batch.covariance_shape is None and batch.errors_Nm is None
        measured = batch.pixels(self._rig_arrays) if plain else batch.frames(self._rig_arrays)
        fitted = self._solved(measured, batch.start, beam)
        if not (doubts := unexplained(fitted, core.solver.DOUBTED)).any():
            return fitted
        doubted = np.flatnonzero(doubts)
        whole, fitted, batch = fitted, fitted.picked(doubted), batch.picked(doubted)
        frames = batch.frames(self._rig_arrays)
        frames = without_outliers(batch, frames, fitted, self._rung, lambda some: self._solved(some, None, beam))
        frames = self._without_impossible_tips(frames, fitted, beam)
        if len(rows := np.flatnonzero((fitted.evidence >= ContactSettings.contact_evidence) & unexplained(fitted))):
            self._without_reading(frames, fitted, rows[fitted.sensor_available[rows].any(axis=1)])
            self._with_drift(batch, fitted, rows)
        whole.put(doubted, fitted)
        return whole

    def _solved(
        self, frames: Frames | tuple[Any, ...], start: np.ndarray | None = None, beam: Beam | None = None
    ) -> FitNumbers:
        pieces_m = None if beam is None else beam.pieces_m
        return solve(frames, self.model, start, pieces_m, self.jobs)

    def _without_impossible_tips(self, frames: Frames, fitted: FitNumbers, beam: Beam | None) -> Frames:
        """Refit, without it, frames with an impossible end of the antenna (something else ended there). Returns the
        frames as used."""
        with np.errstate(invalid="ignore"):
            impossible = np.abs(fitted.tip_std) > ContactSettings.outlying_end
        if not impossible.any():
            return frames
        rows, tip_std = np.flatnonzero(impossible), fitted.tip_std[impossible]
        frames = frames.with_available(frames.available[:, frames.rig_arrays.sensors], frames.ends * ~impossible)
        fitted.put(rows, self._solved(frames.picked(rows), None, beam))
        fitted.tip_std[rows] = tip_std
        return frames

    def _with_drift(self, batch: Batch, fitted: FitNumbers, rows: np.ndarray) -> None:
        """Refit frames that no contact explains with the rig free to change, to test whether that explains them."""
        loose = RigArrays.from_rig(replace(self.rig, drift=DRIFTS["rough"]), self.friction_rad)
        again = self._solved(batch.picked(rows).frames(loose))
        fitted.explained_drifted[rows] = ~unexplained(again)
        fitted.drift_px[rows], fitted.drift_readings[rows] = again.drift_px, again.drift_readings

    def _without_reading(self, frames: Frames, fitted: FitNumbers, rows: np.ndarray) -> None:
        """Refit frames that no contact explains from the picture alone, to test whether it contradicts the readings."""
        if len(rows):
            alone = frames.picked(rows)
            silent = alone.with_available(0.0, alone.ends)
            fitted.explained_alone[rows] = ~unexplained(self._solved(silent))


class ContactStream:
    """Takes frames one at a time and returns contacts in the same order, as `ContactEstimator.run` does, for frames
    that come in real time.

    live : each frame is answered as it comes, from those before it; else `STREAM` at a time, as a recording's.
    little_by_little : a `push` does only a short step or few, such as to solve one frame. The contacts are the same.
    companion : another stream that gets each frame right after this one, and learns for both how the rig has changed.
    """

    def __init__(
        self,
        estimator: ContactEstimator,
        *,
        live: bool = False,
        little_by_little: bool = False,
        companion: ContactStream | None = None,
    ) -> None:
        self._estimator, self._now, self._beside = estimator, estimator, companion
        self._size, self._little = 1 if live else STREAM, little_by_little
        self._patience = ContactSettings.patience if estimator.rig.drift.of_rig and not live else 0
        self._beam = Beam.of(estimator.rig)
        self._motion = MotionCheck(self._beam, live)
        self._coming: list[Measured] = []
        self._waiting: list[tuple[Batch, Sequence[Measured]]] = []  # for the first free frames
        self._earlier: deque[tuple[ContactEstimator, Measured, FitNumbers]] = (
            deque()
        )  # from who has this one companion it
        self._warm: np.ndarray | None = None
        self._work: deque[Generator[Contacts | None, None, None]] = deque()

    @property
    def drift(self) -> LearntRig:
        """The rig's drift as estimated so far."""
        return self._now.drift

    def push(self, measured: Measured, hurried: bool = False) -> Iterator[Contact]:
        """The contacts that are ready with this frame, which may or may not include its own. hurried : whether other
        frames wait already."""
        if not isinstance(measured, Measured):
            raise InputError(f"the recording holds {quoted(measured)}", remedy="give a Measured for each frame")
        self._coming.append(measured)
        if len(self._coming) == self._size:
            self._work.append(self._taken(self._coming))
            self._coming = []
        return chain.from_iterable(
            self._worked(
                min(max(len(self._work) - 2 - hurried, not hurried), ContactSettings.most_steps)
                if self._little
                else None
            )
        )

    def push_together(self, batch: Batch) -> Iterator[Contacts]:
        """As `push`, for several frames at once."""
        self._work.append(self._taken(batch))
        return self._worked(None)

    def idle(self) -> Iterator[Contact]:
        """Contacts from one step of the pending work, to be called in the time before the next frame."""
        return chain.from_iterable(self._worked(1))

    def finish(self) -> Iterator[Contact]:
        """The contacts of all pending frames, at the end of the stream."""
        return chain.from_iterable(self.finish_together())

    def finish_together(self) -> Iterator[Contacts]:
        """As `finish`, as many at a time as come."""
        if self._coming:
            self._work.append(self._taken(self._coming))
        yield from self._worked(None)
        self._work.append(self._solved())
        yield from self._worked(None)
        yield from self._motion.finish_together()

    def _worked(self, steps: int | None) -> Iterator[Contacts]:
        """The contacts that at most so many work steps give; None: all of the work."""
        while self._work and steps != 0:
            for contacts in self._work[0]:
                if contacts is not None:
                    yield contacts
                if steps is not None and (steps := steps - 1) == 0:
                    return
            self._work.popleft()

    def _taken(self, coming: Batch | Sequence[Measured]) -> Generator[Contacts | None, None, None]:
        """Work steps of a batch (generator): contacts where a step completes some, else None."""
        several = () if isinstance(coming, Batch) else coming
        batch = coming if isinstance(coming, Batch) else Batch.of(self._estimator.rig, coming)
        if self._beside is None:
            self._now = yield from self._now.after_free_frames(batch)
        else:
            self._now = self._beside._now
        self._estimator.drift = self.drift
        self._waiting.append((batch, several))
        if self.drift.frames or len(self._waiting) >= self._patience:
            self._patience = 0
            yield from self._solved()

    def _solved(self) -> Generator[Contacts | None, None, None]:
        """The work on the pending batches, with the present estimate of the rig."""
        now, ready, self._waiting = self._now, self._waiting, []
        for batch, several in ready:
            found = yield from self._search(now, batch, several)
            yield None
            most = ContactSettings.frames_per_step if self._little else CHUNK
            for contacts in self._motion.push_together(*found):
                for begin in range(0, len(contacts), most):
                    yield contacts if len(contacts) <= most else contacts.picked(slice(begin, begin + most))

    def _search(
        self, now: ContactEstimator, batch: Batch, several: Sequence[Measured]
    ) -> Generator[None, None, tuple[Contacts, np.ndarray, Shapes]]:
        """The contacts of a batch, and `motion_of` them, with the solver started at the previous contact. several :
        its frames, where they came one by one.

        Results of the companion stream are taken over where it has solved the same frame from the same start with the
        same estimator.
        """
        then = now.at(batch.last_s)
        earlier = [self._earlier.popleft() for _ in range(min(len(several), len(self._earlier)))]
        known = {
            row: numbers
            for row, (estimator, measured, numbers) in enumerate(earlier)
            if estimator is then and measured is several[row] and np.isfinite(measured.start).all()
        }
        most = 1 if self._little else CHUNK
        found = yield from then.contacts_in_parts(batch.started(self._warm), self._beam, most, known)
        if self._beside is not None:
            rows = (found.numbers,) if len(several) == 1 else map(found.numbers.row, range(len(several)))
            self._beside._earlier.extend((then, *each) for each in zip(several, rows, strict=True))
        located = np.flatnonzero(np.isfinite(found.distance_m))
        self._warm = found.numbers.unknowns[located[-1]] if len(located) else None
        return found, *motion_of(self._estimator.rig, batch, found)


def _as_batch(
    centreline_px: np.ndarray | Mapping[str, np.ndarray] | None,
    moment: float | None,
    joints: tuple[float, float],
    sigma_px: np.ndarray | float | Mapping[str, np.ndarray | float] | None,
    moment_z: float | None,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """The arguments of `estimate_batch` for one frame. Raises InputError for wrong shapes, and for what is not a
    number."""
    lines: dict[str, Any] = {"centreline_px": centreline_px, **options}
    shapes = {"centreline_px": "(N, 2) pixels", "plane_xy_m": "(N, 2) m on plane C, of one camera"}
    points = np.empty((0, 2))
    if isinstance(centreline_px, Mapping):
        remedy = f"give {shapes['centreline_px']} of each camera"
        lines["centreline_px"] = {
            name: [as_floats(each, f"centreline_px of {name}", remedy)] for name, each in centreline_px.items()
        }
        shapes.pop("centreline_px")
    if isinstance(sigma_px, Mapping):
        many = {name: as_floats(each, f"sigma_px of {name}", "give px") for name, each in sigma_px.items()}
        lines["sigma_px"] = {name: each[None] if each.ndim else each for name, each in many.items()}
    for name, shape in shapes.items():
        if (line := lines.get(name)) is not None:
            points = as_floats(line, name, f"give {shape}")
            if points.ndim != 2 or points.shape[1] != 2:
                raise InputError(f"{name} has shape {points.shape}", remedy=f"give {shape}")
            lines[name] = points[None]
    if (spread := lines.get("covariance_m2")) is not None:
        spread = as_floats(spread, "covariance_m2", "give (N, 2, 2) m²")
        lines["covariance_m2"] = spread if spread.ndim == 2 else spread[None]
    by_camera, sigma = lines.pop("sigma_px", None), None
    if sigma_px is not None and by_camera is None:
        sigma = as_floats(sigma_px, "sigma_px", "give standard deviations in px")
    if sigma is not None and sigma.shape not in ((), points.shape[:1]):
        raise InputError(f"sigma_px has shape {sigma.shape}", remedy="give one number or (N,) of them")
    sigma = sigma[None] if sigma is not None and sigma.ndim else sigma
    if read := lines.pop("readings", None):
        lines["readings"] = {name: [value] for name, value in read.items()}
    pixels = lines.pop("centreline_px")
    return {
        **{"centrelines_px": pixels, "moments": [moment], "pans": [joints[0]], "tilts": [joints[1]]},
        **{"sigma_px": sigma if by_camera is None else by_camera, "moments_z": [moment_z]},
        **lines,
    }
