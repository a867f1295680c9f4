"""Priors and thresholds of the rig's bundle adjustment, and of a bench test of EI."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AntennaSettings:
    """Thresholds and priors of a calibration of the antenna."""

    # priors of bundle adjustment: what a careful builder can be trusted with
    clamp_offset_std_m: float = 1.5e-3  # of the clamp's place, per axis
    clamp_angle_std_rad: float = 0.035  # of its direction
    clamp_give_std_m: float = 5e-4  # of how far it gives way
    log_stiffness_std: float = 0.5  # of the logarithm of EI, which is all but free
    log_mass_std: float = 0.03  # of that of the mass per length: weighed on a kitchen scale; sag is weight over EI
    nominal_std: float = 0.05  # of the logarithm of EI about E·πd⁴/64 of the stated material and diameter
    other_material: float = 4.0  # standard deviations of EI or weight from which it is another material's or diameter's
    any_material: tuple[float, float] = (1.5, 1.0)  # prior std of the logarithms of EI and weight for such a material
    tried_stiffnesses: int = 13  # within three deviations, of which the descent starts from the best
    gain_std: float = 0.5  # of the moment sensor's gain, which is all but free
    offset_std_Nm: float = 0.02  # of its offset
    own_frame: float = 1e-3  # part of the clamp's prior in plane C that stays where the antenna defines its frame

    # descent
    roughly: float = 0.1  # decrease of the cost that a step promises, below which a pass ends: half a deviation
    standstill: float = 1e-11  # the same of an exact pass: a few millionths of a deviation
    enough: float = 1e-5  # the same that counts as converged after all iterations
    passes: int = 12  # with the points' scatter about the one before, most
    hopeless: float = 30.0  # ratio of the points' scatter to the stated one, from which an unconverged pass is hopeless
    hopeless_passes: int = 2  # in a row, after which the solve is given up
    exact_from: float = 0.1  # change of the points' scatter below which passes are exact
    last_change: float = 1e-5  # change of it with which they end
    load_step_m: float = 1e-4  # finite difference of a load's place, towards the clamp
    log_force_step: float = 1e-3  # finite difference of the logarithm of its force
    taper_step: float = 0.01  # finite difference of the taper's error, in its deviations
    lens_shares: tuple[float, ...] = (1.0, 0.3, 0.1, 0.01)  # of its prior deviations, in turn, where more make it fold
    sees_less: float = 1e-3  # part of the picture that a moved lens may see less of

    # which pictures contradict the others
    # rms of a picture's points over that of the median picture, and over 1 deviation, from which it is left out
    outlying_frame: float = 3.0
    outlying_reading: float = 5.0  # deviations that its own readings would have to move for it to fit
    contradicts: float = 1e-6  # p-value of a picture that contradicts the others
    fewest_of_a_kind: int = 2  # with or without a load: with two, an outlier cannot be identified
    most_contradict: float = 0.2  # share that may be left out, before it is the model that does not hold
    outlying_tip: float = 4.0  # deviations of one end from the others from which it is not used
    tips_contradict: float = 4.0  # deviations of all ends from the length from which none is used

    # stretches of a line that something else disturbs: a thread over it, a knot, a reflection
    run: int = 10  # points: longer than the picture's noise is correlated, shorter than the shape
    scatter_runs: tuple[int, ...] = (10, 40)  # points, whose means show what neighbours share: blocks of JPEG
    disturbed_degree: int = 3  # of the polynomial that residuals of the antenna follow, whatever is wrong with the rig
    disturbed_clear: float = 5.0  # std of a run's mean off that polynomial from which a stretch is disturbed
    disturbed_around: float = 2.0  # std down to which the neighbours belong to that stretch
    disturbed_most: float = 0.4  # share of a line; where more is off, nothing local is

    # finding the antenna in a session's pictures
    least_seen_free: float = 0.6  # fraction of the free antenna, which nothing hides
    lateral_prior: float = 0.067  # lateral deviation of the antenna over the distance from the clamp, by these priors
    lateral_course: float = 0.02  # the same where other pictures of the rig determine the free antenna's course
    course_order: int = 2  # of the polynomial of that course, relative to the expected one
    off_course: float = 0.04  # distance from the others' course, in lengths, from which a line is searched for again
    leaves_course: float = 0.008  # distance from which points belong to something else
    clamp_strays: tuple[float, float] = (3.0, 10.0)  # deviations of its prior that the clamp may be off; all around
    shared_errors: float = 4.0  # effective over own deviation from which points share most of their errors
    learnt_from: int = 3  # pictures from which the antenna's contrast is learnt
    well_seen: float = 0.9  # share of the antenna that one polarity must show, to be taken
    clearly_more: float = 0.1  # further share that a changing polarity must show, to be taken in its place
    ends: float = 4.0  # widths from either end in which clamp and background are in a broad antenna's profiles
    two_edges_px: float = 2.5  # width from which on the blur of an ordinary lens leaves an antenna two edges
    off_middle: float = 0.018  # of the width that a line lies off the middle between its edges, to be measured by these

    # bench test: the table of deflections
    fewest_rows: int = 4  # two unknowns, EI and the gauge's offset, and something left over for the scatter
    most_rows: int = 1000
    longest_rod_m: float = 10.0
    # bench test: outlying readings
    fewest_readings: int = 8  # fewer have no neighbours to be compared with
    outlying: float = 5.0  # deviations of a reading
    anchors: int = 40  # readings through which lines are drawn, most
    # bench test: correlated errors
    correlation_lengths: int = 8  # that are tried
    plain_shares: tuple[float, ...] = (0.0, 0.2)  # of the variance without correlation, that are tried
    plain_only: float = 0.6  # prior of no correlation, by sampling: less overstates plain, more understates correlated
    # bench test: clamp and model
    clamp_share_std: float = 0.02  # of its turn over the slope at the load: a solid block gives half a thickness, 1/50
    steep_rad: float = 0.15  # slope at the load from which the small-angle formula is not used
    bias_share: float = 0.1  # error of that formula over EI's standard deviation from which it is not used
    least_bias: float = 1e-5  # the same over EI, least: no bench test resolves less
