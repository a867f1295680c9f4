"""From a session's static frames to a rig: observations, priors, bundle adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vbaa_calib.antenna.shape import bend
from vbaa_calib.antenna.taper import Profile
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle
from vbaa_calib.calibrate.antenna.inputs import EXACT, Observation, Prior
from vbaa_calib.calibrate.antenna.learnt_paint import learn
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, OFFSET
from vbaa_calib.calibrate.antenna.residual_checks import moment_noise
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.calibrate.pose.board_pose import require_size
from vbaa_calib.calibrate.pose.fusion import PoseEstimate, fused
from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import spread_evenly
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.images import read_picture
from vbaa_calib.core.polyline import arc_lengths, normals
from vbaa_calib.detect.whisker.acceptance import decided, stretches, why_lost
from vbaa_calib.detect.whisker.corridor import corridor, free_curve
from vbaa_calib.detect.whisker.finder import AntennaFinder, finder
from vbaa_calib.detect.whisker.paint import Paint, look_of, usual_looks
from vbaa_calib.detect.whisker.settings import SearchSettings
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Antenna, AntennaImage, MomentSensor, Rig, WrenchSensor
from vbaa_calib.session import (
    Drift,
    Load,
    LoadReadings,
    NominalAntenna,
    NominalWrenchSensor,
    Session,
    Still,
    gravity_antenna,
    read_loads,
    read_noload,
)


@dataclass(frozen=True, eq=False)
class ExpectedAntenna:
    """Expectation of the antenna in a picture: pose, shape, paint and search range."""

    antenna: NominalAntenna
    camera: Camera
    T_antenna_camera: Pose
    parameters: np.ndarray  # (9,) of the antenna, as far as they are known
    paint: Paint | None = None  # what sets it off from its background; None: learnt from the pictures
    # (3,) how far the free antenna lies off these parameters' in this rig's pictures: a polynomial in the way from
    # the clamp, both in lengths of the antenna's picture; None where not known
    course: np.ndarray | None = None
    # standard deviations of the priors within which it is searched for, one after the other; None: all around. Clutter
    # farther away is not even tried
    reaches: tuple[float | None, ...] = (1.3, 3.0, None)

    def observe(self, still: Still, image: np.ndarray, gravity_m_s2: np.ndarray) -> Observation:
        """Detected points of the antenna in one picture, as `read_picture` returns them. gravity_m_s2 : (3,) in the
        antenna frame. A loaded antenna that is not found in the expected paint is searched again in the paint which
        its own picture suggests.

        Raises InputError as `observe` does.
        """
        paint = self.learned([still], [image], [gravity_m_s2]) if self.paint is None else self.paint
        for deviations in self.reaches:
            looking = self._finder(still, gravity_m_s2, deviations)
            line = decided(paint.find(looking, image), looking.corridor.axis_px)
            accepted = line.found and (isinstance(still, Load) or line.seen >= AntennaSettings.least_seen_free)
            if accepted:
                break
        else:
            # a bent antenna lies before other things than a free one
            if isinstance(still, Load) and self.paint is not None:
                with suppress(InputError):
                    return replace(self, paint=None).observe(still, image, gravity_m_s2)
            lost, change = why_lost(stretches(paint.plane(image), line, looking.corridor, paint.bright))
            why = "; ".join(one for one in (line.reason, lost) if one)
            if not change:
                little = line.seen < AntennaSettings.least_seen_free
                change = "light the antenna" if little else "check the jig; take away what looks like the antenna"
            raise InputError(
                f"no antenna found in it ({100 * line.seen:.0f} % of its length seen: {why})",
                where=still.image,
                remedy=f"{change}; shoot it again, or take its row out of the CSV",
            )
        tip_std_px = line.end_std_px if line.end == "tip" else np.nan
        shared = paint.polarity is None or bool(
            np.median(line.effective_px / line.sigma_px) > AntennaSettings.shared_errors
        )
        return Observation(
            still,
            line.points_px,
            line.effective_px,
            gravity_m_s2,
            paint,
            line.amplitude,
            line.end_px,
            tip_std_px,
            shared,
            look_of(image, line),
            line.row_px,
        )

    def course_of(self, seen: Observation) -> np.ndarray:
        """(3,) polynomial `course` of one free antenna's detected points."""
        return np.polyfit(*self._lateral(seen), AntennaSettings.course_order)

    def on_course(self, seen: Observation) -> Observation:
        """A free antenna's detected points without the stretches that leave the course common to this rig's
        pictures."""
        assert self.course is not None
        along, lateral = self._lateral(seen)
        near = np.abs(lateral - np.polyval(self.course, along)) < AntennaSettings.leaves_course
        if near.all() or near.mean() < AntennaSettings.least_seen_free:
            return seen
        ends = seen if near[-1] else replace(seen, tip_std_px=np.nan)
        return ends.only(near)

    def _lateral(self, seen: Observation) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of a free antenna's points (N,) along and across the expected antenna, relative to its length
        in the picture."""
        free = free_curve(self.parameters, self.antenna.length_m, seen.gravity_m_s2, self.antenna.taper)
        where = corridor(
            self.camera, self.T_antenna_camera.inverse(), free, self.antenna.diameter_m, taper=self.antenna.taper
        )
        along, lateral = where.coordinates(seen.points_px)
        length = arc_lengths(where.axis_px)[-1]
        return along / length, lateral / length

    def learned(
        self, stills: Sequence[Still], images: Sequence[np.ndarray], gravity_m_s2: Sequence[np.ndarray]
    ) -> Paint:
        """The expectation with the paint learnt from these pictures; with the default paint where none is found."""
        for deviations in self.reaches:
            looking = [self._finder(still, pull, deviations) for still, pull in zip(stills, gravity_m_s2, strict=True)]
            paint = learn(looking, images)
            if paint is not None:
                return paint
        return Paint()

    def _finder(self, still: Still, gravity_m_s2: np.ndarray, deviations: float | None) -> AntennaFinder:
        """Detector of the antenna within `deviations` standard deviations of its expected place; None: in the whole
        picture."""
        length, reach = self.antenna.length_m, SearchSettings.reach
        shape = free_curve(self.parameters, length, gravity_m_s2, self.antenna.taper)
        if deviations is not None:
            lateral = AntennaSettings.lateral_prior if self.course is None else AntennaSettings.lateral_course
            if isinstance(still, Load):
                free, force = shape.points_m[0, -1], np.array([[still.force_y_N, still.force_z_N]])
                shape = bend(
                    self.parameters[None],
                    length,
                    gravity_m_s2[None],
                    np.array([still.distance_m]),
                    force,
                    dead=True,
                    taper=self.antenna.taper,
                )
                # the stiffness may be anything within a factor of two
                lateral += float(np.linalg.norm(shape.points_m[0, -1] - free)) / length / 3.0
            reach = min(deviations * lateral, SearchSettings.reach)
        path = corridor(
            self.camera, self.T_antenna_camera.inverse(), shape, self.antenna.diameter_m, reach, self.antenna.taper
        )
        if len(path.axis_px) > 1:
            along = arc_lengths(path.axis_px)
            assert path.free is not None
            strays = AntennaSettings.clamp_strays[deviations is None] * path.free.clamp_px_per_m
            # seen aslant the antenna is shorter, and turned by more; end on it is no line
            along_px_per_m = max(along[-1], 1.0) / length
            clamp_px = strays * AntennaSettings.clamp_offset_std_m
            clamp_rad = strays * AntennaSettings.clamp_angle_std_rad / along_px_per_m
            path = replace(path, clamp_px=max(path.clamp_px, clamp_px), clamp_rad=max(path.clamp_rad, clamp_rad))
            if self.course is not None:
                moved = np.polyval(self.course, along / along[-1]) * along[-1]
                path = replace(path, axis_px=path.axis_px + moved[:, None] * normals(path.axis_px))
        looking = finder(path, self.camera)
        if looking is None:
            raise InputError(
                "the camera's pose leaves the antenna out of the picture",
                where=still.image,
                remedy="check the jig (or sweep, or over) in session.yaml",
            )
        return looking


def observe(
    session: Session, kinematics: Kinematics, stills: Sequence[Still], expected: ExpectedAntenna, what: str
) -> tuple[list[Observation], ExpectedAntenna]:
    """Detected points of the antenna in every static frame, and the expectation updated by them: its paint, learnt
    from some of the pictures, and the course of the free antenna. A picture in which no antenna is found, or one on
    another course than most, is searched again along theirs.

    Raises InputError naming a picture of another size than the lens was calibrated for, or without an antenna.
    """
    gravity = gravity_antenna(kinematics, session.gravity_world_m_s2, stills)

    def read(still: Still) -> np.ndarray:
        assert still.image is not None
        image = read_picture(still.image)
        require_size(image.shape[1::-1], expected.camera, still.image)
        return image

    def detected_with(learnt: ExpectedAntenna) -> list[Observation | None]:
        found: list[Observation | None] = []
        for still, pull in zip(progress(stills, what), gravity, strict=True):
            image = read(still)
            try:
                found.append(learnt.observe(still, image, pull))
            except InputError:
                found.append(None)
        return found

    def learned(which: Sequence[int]) -> ExpectedAntenna:
        chosen = [stills[index] for index in which]
        pulls = [gravity[index] for index in which]
        return replace(expected, paint=expected.learned(chosen, [read(still) for still in chosen], pulls))

    if expected.paint is None:
        some = spread_evenly(len(stills), AntennaSettings.learnt_from).tolist()
        learnt = learned(some)
        seen = detected_with(learnt)
        lost = [index for index, one in enumerate(seen) if one is None][: AntennaSettings.learnt_from]
        if lost:
            # what some pictures do not show may need another paint
            again = learned([*some, *(index for index in lost if index not in some)])
            learnt, seen = (learnt, seen) if again.paint == learnt.paint else (again, detected_with(again))
        expected = learnt
    else:
        seen = detected_with(expected)
    courses = {i: expected.course_of(one) for i, one in enumerate(seen) if one and not isinstance(one.still, Load)}
    usual = np.median(list(courses.values()), axis=0) if courses else expected.course
    learnt = replace(expected, course=usual)
    for index, (still, pull) in enumerate(zip(stills, gravity, strict=True)):
        off_course = (
            index in courses
            and np.abs(np.polyval(courses[index] - usual, np.linspace(0.0, 1.0, 21))).max() > AntennaSettings.off_course
        )
        if seen[index] is None or off_course:
            seen[index] = learnt.observe(still, read(still), pull)
        one = seen[index]
        if index in courses and len(courses) >= AntennaSettings.learnt_from and one is not None:
            seen[index] = learnt.on_course(one)
    return [one for one in seen if one is not None], learnt


def observe_stills(session: Session, kinematics: Kinematics, before: Prior) -> list[Observation]:
    """Observations of the antenna in a session's no-load frames, then under its known loads."""
    noload, loads = read_noload(session), read_loads(session)
    expected = ExpectedAntenna(session.antenna, before.camera, before.start, nominal_parameters(session.antenna))
    free, expected = observe(session, kinematics, noload, expected, "free antenna")
    return [*free, *observe(session, kinematics, loads, expected, "known loads")[0]]


def bow_std_per_m(length_m: float) -> float:
    """Prior standard deviation of the free antenna's curvature, 1/m: a wire's bow is a hundredth of its length, less
    if the wire is longer than 250 mm."""
    return 0.3 * max(1.0, 0.25 / length_m)


def nominal_parameters(antenna: NominalAntenna) -> np.ndarray:
    """(9,) nominal antenna parameters, the initial value: straight, clamped rigidly along x, nominal stiffness and
    mass."""
    return np.array([0.0] * 6 + [np.log(antenna.stiffness_Nm2), np.log(antenna.mass_per_length_kg_m), 0.0])


def prior(
    antenna: NominalAntenna,
    camera: Camera,
    poses: Sequence[PoseEstimate],
    own_frame: bool = False,
    readings: LoadReadings = EXACT,
    drift: Drift | None = None,
) -> Prior:
    """Priors of bundle adjustment, before the static frames. own_frame : whether plane C was determined by the
    antenna alone, so that its clamp is at the origin and along the x axis by definition."""
    in_plane = AntennaSettings.own_frame if own_frame else 1.0
    clamp = [
        AntennaSettings.clamp_offset_std_m * in_plane,
        AntennaSettings.clamp_offset_std_m,
        AntennaSettings.clamp_angle_std_rad,
        AntennaSettings.clamp_angle_std_rad * in_plane,
    ]
    bow = bow_std_per_m(antenna.length_m)
    rest = [
        bow,
        bow,
        AntennaSettings.log_stiffness_std,
        AntennaSettings.log_mass_std,
        AntennaSettings.clamp_give_std_m,
        AntennaSettings.gain_std,
        AntennaSettings.offset_std_Nm,
    ]
    return Prior(
        poses=tuple(poses),
        start=fused(poses),
        camera=camera,
        mean=np.concatenate([nominal_parameters(antenna), [1.0, 0.0]]),
        std=np.array([*clamp, *rest]),
        readings=readings,
        tip_std_m=antenna.tip_std_m,
        drift=Drift() if drift is None else drift,
        diameter_m=antenna.diameter_m,
        taper=antenna.taper,
        log_tip_std=antenna.log_tip_std,
    )


def read_by(sensor: NominalWrenchSensor | None, before: Prior) -> Prior:
    """The prior with a wrench sensor of several axes; None: the moment about y alone."""
    if sensor is None:
        return before
    mean, names = before.mean.copy(), [name for name in sensor.signs if name != "my"]
    # x·f_z − z·f_x is minus the right-handed moment about y
    mean[GAIN - 6] = -sensor.signs.get("my", -1.0)
    gain, std = (np.array([of(name) for name in names], float) for of in (sensor.signs.get, sensor.std))
    # a force acts at a lever of a hundredth of a metre
    offset_std = np.array(
        [(100.0 if name.startswith("f") else 1.0) * AntennaSettings.offset_std_Nm for name in names], float
    )
    turn = np.full(3, max(sensor.rotation_std_rad, 1e-6))
    none = np.zeros((0, 0))
    known = WrenchSensor(tuple(names), gain, np.zeros(len(names)), std, sensor.T_antenna_sensor, none)
    own = np.concatenate([turn, np.full(len(names), AntennaSettings.gain_std), offset_std])
    return replace(before, mean=mean, sensor=known, sensor_std=own)


def solve_antenna(session: Session, observations: Sequence[Observation], before: Prior) -> BundleAdjustment:
    """Bundle adjustment of a session's static frames. Readings of a moment sensor that scatter clearly more than
    session.yaml states are weighted by their own scatter. Where the pictures contradict the stated material or
    diameter, EI and weight are solved from them alone. Raises SolveError."""
    std = before.std.copy()
    std[[6, 7]] = AntennaSettings.any_material
    free = replace(before, std=std)
    try:
        joint = _solved(session, observations, before)
    except SolveError as error:
        with suppress(SolveError):
            return _solved(session, observations, free)
        raise error
    if _other_material(joint):
        with suppress(SolveError):
            return _solved(session, observations, free)
    return joint


def _solved(session: Session, observations: Sequence[Observation], before: Prior) -> BundleAdjustment:
    joint = adjust_bundle(observations, before, session.antenna.length_m, session.moment_std_Nm)
    noise_Nm, (least_Nm, _) = moment_noise(joint)
    if least_Nm > session.moment_std_Nm:
        joint = adjust_bundle(observations, before, session.antenna.length_m, noise_Nm)
    return joint


def _other_material(joint: BundleAdjustment) -> bool:
    """Whether EI or the weight contradicts the stated material and diameter."""
    prior = joint.problem.prior
    off = np.abs(joint.parameters[[12, 13]] - prior.mean[[6, 7]])
    return bool((off > AntennaSettings.other_material * np.array([AntennaSettings.nominal_std, prior.std[7]])).any())


def make_rig(
    session: Session, kinematics: Kinematics, joint: BundleAdjustment, observations: Sequence[Observation]
) -> Rig:
    """The rig from the result of a bundle adjustment."""
    sensor, covariance = MomentSensor(*joint.sensor_gain_offset, joint.problem.moment_std_Nm), joint.covariance
    several = joint.sensor
    if not session.with_sensor:
        # its parameters, which nothing shows, are none of the rig's
        sensor, covariance = MomentSensor.none(), covariance.copy()
        covariance[GAIN : OFFSET + 1] = covariance[:, GAIN : OFFSET + 1] = 0.0
        if several is not None:
            common = several.covariance.copy()
            common[:, GAIN : OFFSET + 1] = 0.0
            several = replace(several, covariance=common)
    if session.second_moment_sensor is not None:
        several = WrenchSensor.about_z(session.second_moment_sensor)
    paint = observations[0].paint
    heights = [one.height for one in observations if not isinstance(one.still, Load) and one.height > 0]
    # where it changes along the antenna it changes with the light as well
    height = float(np.median(heights)) if heights and paint.bright is not None else None
    sigma_px = float(np.median(np.concatenate([observation.sigma_px for observation in observations])))
    return Rig(
        camera=joint.camera,
        T_antenna_camera=joint.T_antenna_camera,
        antenna=Antenna(
            session.antenna.length_m,
            session.antenna.diameter_m,
            joint.parameters[ANTENNA],
            *_thinned_profiles(session.antenna, joint.log_tip),
        ),
        moment_sensor=sensor,
        kinematics=kinematics,
        gravity_world_m_s2=session.gravity_world_m_s2,
        image=AntennaImage(
            noise_px=sigma_px * joint.noise_scale,
            noise_scale=joint.noise_scale,
            bright=paint.bright,
            height=height,
            looks=usual_looks([one.look for one in observations]),
            both_edges=paint.both_edges,
        ),
        covariance=covariance,
        wrench_sensor=several,
        drift=session.possible_drift,
        tip=joint.tip,
    )


def _thinned_profiles(antenna: Any, log_tip: float) -> tuple[Profile | None, Profile | None]:
    """The profiles of session.yaml's antenna with the tip diameter changed as `Taper.thinned` does."""

    def changed(rows: Profile | None, power: float) -> Profile | None:
        by_m = power * log_tip / antenna.length_m
        return None if rows is None else tuple((s, value * float(np.exp(by_m * s))) for s, value in rows)

    return changed(antenna.profile, 1.0), changed(antenna.stiffness_profile, 4.0)
