"""Thresholds of a frame's contact, and settings of frame-by-frame estimation."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.native import core


@dataclass(frozen=True, init=False, repr=False, eq=False)  # read from the class
class ContactSettings:
    """Thresholds of contacts."""

    # status of a frame
    fewest_points: int = core.solver.FEWEST_POINTS  # fewest points of a centreline
    contact_evidence: float = 14.0  # least of a contact: noise exceeds it 4 times in a million, as χ² of 3 does 28
    low_signal: float = 0.05  # largest standard deviation of a distance or deflection that is given, over the length
    low_signal_relative: float = 0.1  # the same of a distance over itself: beyond, first order does not describe it
    edge_on_rad: float = 0.05  # angle of view within which the deformation plane is edge-on, if uncertain as well
    edge_on_blind_rad: float = 0.15  # the same without a reading
    alternative_cost: float = 4.5  # largest difference of costs of two contacts that explain a frame alike: 3 σ
    second_contact: float = 25.0  # decrease of the cost from which a second force counts: noise has less in 1e5 frames
    second_shift: float = 1.0  # standard deviations by which the distance must move for a second force to count
    highest_bias: float = 10.0  # bias of a result, in its standard deviations, from which the model is too simple
    steepest: float = 3.5  # friction angle from which a contact is rejected, in standard deviations of its prior
    steepest_blind: float = 2.5  # the same without a reading
    outlying_std: float = 30.0  # standard deviations from its neighbours from which a point is an outlier
    jump: float = 2.0  # standard deviations between neighbouring points from which a stretch of the line may be wrong
    outlying_end: float = 2.5  # standard deviations of the visible end from the rest from which it is not used
    friction_share: float = 0.75  # part of the distance's variance by unknown friction that is mentioned: half the std
    rig_p_value: float = 2e-5  # p-value of the rig's steps below which the frame asks for another rig
    disagreement: float = 4.0  # residual of a reading, in standard deviations, that is mentioned
    contradiction: float = 6.0  # residual of a reading, in standard deviations, that fails the frame
    largest_shift: float = 1 / 3  # largest shift of the distance by inertia, in its standard deviations

    # frames in time
    frames_per_step: int = 8  # frames that one step of pending work takes over, or gives contacts of
    most_steps: int = 4  # most steps of pending work with each frame
    patience: int = 16  # most batches of a recording that wait for its first free frames
    motion_frames: int = 64  # most frames on either side of a frame by which its motion is measured
    motion_false_alarm: float = 1e-5  # probability that a frame at rest counts as moving, over all pieces and axes
    carried: float = 3.0  # shift of a point by the rolling shutter, in standard deviations, from which the frame fails
    blurred_px: float = 4.0  # movement in the exposure that is mentioned: at twice that a line's end is lost in it

    # the antenna in a picture
    least_end_px: float = 0.02  # least standard deviation of the antenna's end
    same_gravity_m_s2: float = 0.5  # difference of gravity up to which a finder is used again: about a pixel of sag
    sure_detection: float = 0.99  # fraction seen of a line up to its tip, from which it is not measured once more
    second_detection: float = 0.8  # fraction that a second detection must see of the first
    farther_widths: float = 6.0  # widths by which a second detection of changing polarity may end nearer than the first
    clamp_px: float = 1.5  # distance by which a calibrated antenna may be off its clamp
    clamp_rad: float = 0.015  # angle by which it may be turned there
    drifted: float = 3.0  # standard deviations of the camera's drift that are allowed in addition
    shape_px: float = 0.5  # largest mean distance from a possible shape
    shape_widths: float = 0.11  # the same in widths of the antenna
    least_noise: float = 0.5  # least noise of points, over that of the rig's own pictures
    least_noise_changing: float = 1.0  # the same where the polarity may change: one picture does not show common errors
    at_once_px: int = 16_000_000  # pixels of pictures that are kept for a second detection
    pictures_ahead: int = 3  # pictures that are read while one is searched
    turned_looks: int = 4  # first pictures without an antenna that are searched mirrored and turned, too:
    turned: tuple[tuple[str, int, int], ...] = (  # how, and the steps through rows and columns that undo it
        ("the pictures are mirrored left to right", 1, -1),
        ("the pictures are mirrored top to bottom", -1, 1),
        ("the pictures are turned by 180°", -1, -1),
    )

    # the background
    sampled_pictures: int = 48  # pictures of a bag or video from which its static background is learnt
    most_pictures: int = 24  # most pictures for one background
    most_px: int = 40_000_000  # most pixels of these pictures in all
    alike_px: float = 2.0  # movement of the picture up to which joint angles are one position
    most_positions: int = 6  # most positions of the joints with a background of their own
    hardly_moves: float = 0.5  # part of the background that the antenna always covers from which none is learnt

    # contacts for which the effect of common errors is predicted
    chunk: int = 256  # frames at a time
    error_step: float = 0.1  # standard deviations by which contacts are moved: shapes change linearly by so little
    force_steps: int = 4  # Newton steps for the push that makes a force
    most_points: int = 400  # most points of a drawn centreline

    # pictures of frames
    whole: float = 0.99  # part of the antenna seen from which the picture has no explanation of unseen parts
    force_share: float = 0.15  # length of the force's arrow over the antenna's
    close_up: float = 0.3  # side of the close-up over the picture's shorter side
    close_up_px: tuple[float, float] = (8.0, 80.0)  # least and largest size of the surroundings in the close-up
    close_up_light: float = 1.2  # factor on its grey levels
    thumbnail_px: int = 320  # width
