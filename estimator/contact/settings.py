"""Thresholds of a frame's contact, and settings of frame-by-frame estimation."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.native import core


@dataclass(frozen=True)
class ContactSettings:
    """Thresholds of contacts."""

    # status of a frame
    fewest_points: int = core.solver.FEWEST_POINTS  # of a centreline
    contact_evidence: float = 14.0  # least of a contact: noise exceeds it four times in a million, as χ² of 3 does 28
    low_signal: float = 0.05  # standard deviation of a distance or deflection, over the length, that is withheld
    low_signal_relative: float = 0.1  # the same of a distance over itself: beyond, first order does not describe it
    edge_on_rad: float = 0.05  # angle of view within which the deformation plane is edge-on, if uncertain as well
    edge_on_blind_rad: float = 0.15  # the same without a reading
    alternative_cost: float = 4.5  # difference of costs up to which two contacts explain a frame alike: 3 deviations
    second_contact: float = 25.0  # decrease of the cost from which a second force counts: noise has less in 1e5 frames
    second_shift: float = 1.0  # standard deviations by which the distance must move for a second force to count
    highest_bias: float = 10.0  # deviations of a model's bias that it is rejected for: up to there it is in the results
    steepest: float = 3.5  # friction angle, in its prior standard deviations, that is rejected
    steepest_blind: float = 2.5  # the same without a reading
    outlying_std: float = 30.0  # distance of a point from its neighbours, in its deviations: no noise gets there
    jump: float = 2.0  # of points' distances along a line, in their deviations, from which a stretch may lie off
    outlying_end: float = 2.5  # deviations of the visible end from the rest, from which it is not used
    friction_share: float = 0.75  # of the distance's variance by unknown friction that is mentioned: half its deviation
    rig_p_value: float = 2e-5  # of the rig's steps below which the frame asks for another rig
    disagreement: float = 4.0  # residual of a reading, in standard deviations, that is mentioned
    contradiction: float = 6.0  # residual of a reading, in standard deviations, that fails the frame
    largest_shift: float = 1 / 3  # of the distance by inertia, in its deviations

    # frames in time
    frames_per_step: int = 8  # that pending work takes over, or gives contacts of
    most_steps: int = 4  # of pending work with a frame
    patience: int = 16  # batches of a recording that wait for its first free frames, most
    motion_frames: int = 64  # on either side of a frame that count for its motion, most
    motion_false_alarm: float = 1e-5  # probability that a frame at rest counts as moving, over all pieces and axes
    carried: float = 3.0  # deviations by which a rolling shutter shifts a point that fail the frame
    blurred_px: float = 4.0  # movement in the exposure that is mentioned: at twice that a line's end is lost in it

    # the antenna in a picture
    least_end_px: float = 0.02  # deviation of its end
    same_gravity_m_s2: float = 0.5  # difference up to which a finder is used again: a pixel of sag, more or less
    sure_detection: float = 0.99  # fraction seen of a line up to its tip, from which it is not measured once more
    second_detection: float = 0.8  # fraction that a second detection must see of the first
    farther_widths: float = 6.0  # widths by which a second detection of changing polarity may end nearer than the first
    clamp_px: float = 1.5  # distance by which a calibrated antenna may be off its clamp
    clamp_rad: float = 0.015  # angle by which it may be turned there
    drifted: float = 3.0  # standard deviations of the camera's drift that are allowed in addition
    shape_px: float = 0.5  # mean distance from a possible shape, most
    shape_widths: float = 0.11  # the same in widths of the antenna
    least_noise: float = 0.5  # of points, over that of the rig's own pictures
    least_noise_changing: float = 1.0  # the same where the polarity may change: one picture does not show common errors
    at_once_px: int = 16_000_000  # pixels of pictures that are kept for a second detection
    pictures_ahead: int = 3  # pictures that are read while one is searched
    turned_looks: int = 4  # first pictures without an antenna that are searched mirrored and turned, too:
    turned: tuple[tuple[str, int, int], ...] = (  # how, and the steps through rows and columns that undo it
        ("the pictures are mirrored left to right", 1, -1),
        ("the pictures are mirrored top to bottom", -1, 1),
        ("the pictures are turned by 180°", -1, -1),
    )

    # what lies behind it
    sampled_pictures: int = 48  # of a bag or video that show what is static behind it
    most_pictures: int = 24  # for one background
    most_px: int = 40_000_000  # and their pixels in all
    alike_px: float = 2.0  # movement of the picture up to which joint angles are one position
    most_positions: int = 6  # of the joints that have a background
    hardly_moves: float = 0.5  # share of what lies behind it that it always covers, from which nothing is learnt

    # the contacts that common errors are predicted for
    chunk: int = 256  # frames
    error_step: float = 0.1  # deviations by which contacts are moved: small relative to what bends
    force_steps: int = 4  # of Newton for the push that makes a force
    most_points: int = 400  # of a drawn centreline

    # pictures of frames
    whole: float = 0.99  # part of the antenna that is seen, from which nothing is explained
    force_share: float = 0.15  # length of the force's arrow over the antenna's
    close_up: float = 0.3  # side of the close-up over the picture's shorter side
    close_up_px: tuple[float, float] = (8.0, 80.0)  # of the contact's surroundings that it shows
    close_up_light: float = 1.2  # factor on its grey levels
    thumbnail_px: int = 320  # width
