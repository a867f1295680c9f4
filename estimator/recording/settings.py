"""Settings of refinement, and thresholds from which a recording is refused."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RefineSettings:
    """Thresholds of `vbaa refine`."""

    # solving
    enough: float = 0.02  # longest step, in standard deviations, at which the solver ends
    nearly_all: float = 0.98  # share of the contacts by which steps are judged
    longest: float = 0.2  # longest step of a distance, over itself
    most_frames: int = 1000  # most frames with contacts, and most free ones, that common errors are solved from
    weighings: int = 4  # most rounds of weighing the frames
    last_change: float = 0.1  # largest change of a weight at which the rounds end
    doubted: float = 1e-2  # p-value of a frame that counts less
    foreign: float = 1e-6  # p-value of a frame, or its stroke, that does not belong to the rest
    excluded: float = 1e-9  # p-value of a frame that is left out from the beginning
    most_excluded: float = 0.4  # share of such frames beyond which none is left out
    trend_information: float = 1e-2  # prior of a change within the recording: ten times what a calibration leaves
    finer_errors: int = 2  # further Legendre terms of the error that all lines share: cubic and quartic
    chunk: int = 512  # frames that are linearised together
    object_round_m: float = 1e-5  # distance of pin and antenna from a round and straight shape

    # strokes, and what is refused
    gap_frames: int = 5  # frames without contact that end a stroke
    gap_s: float = 0.5  # time without contact that ends a stroke
    another_rig: float = 1e-4  # p-value of common errors as large as the best fit's from which the rig is another
    allowed_excess: float = 1.3  # ratio of the rig's errors to their standard deviations up to which its prior stays
    largest_excess: float = 5.0  # the same, up to which a known object may recalibrate it
    foreign_share: float = 0.3  # share of frames that contradict the others from which no consistent majority is left
    joints_apart_rad: float = 1e-5  # largest difference between the contacts' and the recording's joint angles

    # whether the sensor's zero walks
    zero_frames: int = 6  # fewest free frames
    zero_walks: float = 4.5  # slope of the zero, in standard deviations, from which it walks

    # Coulomb's law
    least_friction_rad: float = 0.01  # uncertainty of a friction angle: friction differs from place to place
    lateral_known_rad: float = 0.15  # uncertainty of a force's direction, up to which it bounds the angle along it
    slip_along: float = 0.9  # share of a slip along the antenna from which friction is on the cone's rim
    slip_turn: float = 0.2  # standard deviation of that slip's direction up to which it counts, rad
    rim: float = 0.2  # share of the half angle within which friction is then on the rim: slips are averages
    law_contradicted: float = 3.5  # standard deviations by which a frame contradicts the law
    law_share: float = 0.1  # share of such frames from which the recording contradicts the law
    informative: float = 0.5  # part of the prior's variance that a frame must remove to count
