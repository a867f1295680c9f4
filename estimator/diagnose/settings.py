"""Thresholds of the diagnosis of recordings."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, init=False, repr=False, eq=False)  # read from the class
class RecordingSettings:
    """Weights of a recording's frames as witnesses, and thresholds of comparison and report.

    Costs are halves of squares: a difference is the logarithm of a ratio of odds.
    """

    # weighing frames
    contact: float = 8.0  # cost of a contact's place and force, which a free antenna does not have (Occam factor)
    most: float = 30.0  # cost of one frame: an outlier counts no more
    friction_rad: float = 0.2  # standard deviation of the friction angle
    iterations: int = 8  # moves of the rig, or of an offset, towards a change
    rounds: int = 3  # moves of an offset towards what the free frames show
    seeds: int = 2  # single frames from whose change the search for what all share begins, where many are lost
    reweightings: int = 12  # of frames, in looking for the change that most of them share
    lost: float = 0.05  # part of the frames that nothing explains from which what most of them share is sought
    suspicious: float = (
        8.0  # log odds, to first order, from which a change of the rig, or of its pictures, is suspected
    )
    sound_cost: float = 4.0  # cost per frame that a right explanation leaves
    farthest: float = 30.0  # change of a rig, in the standard deviations of its row, up to which it is sought
    gain: float = 0.5  # least decrease of the cost by a further move

    # the table of hypotheses
    screened: int = (
        8  # frames, the least bent ones, by which hypotheses about joints and pictures are compared at first
    )
    thinned: int = 3  # hypotheses about moments are compared by every third frame at first
    fewest_moments: int = 5  # fewer moments tell nothing about their sensor
    followed: int = 3  # best hypotheses about moments, and best changes of the rig, that are compared by all frames
    promising: float = 3.0  # log odds by first order from which a change of the rig is fitted
    varies_rad: float = 0.02  # range of a joint below which it says nothing
    varies_std: float = 6.0  # range of the moment, in standard deviations of its noise, below which it says nothing
    unlikely: float = 4.0  # prior log odds against each hypothesis
    hinted: float = 1.0  # log odds by few frames, or by the pictures alone, from which a row is compared by all frames
    vague: float = 15.0  # the same for moments that say nothing: any hypothesis in which they say something goes first
    tilts_rad: tuple[tuple[float, ...], ...] = (  # where a joint may be that is not read: coarse, then finer steps
        *((-1.2, -0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.2), (-0.1, 0.1), (-0.03, 0.03)),
    )
    joint_step_rad: float = 0.0175  # scale of the prior (Cauchy) of an encoder's zero
    joint_most_rad: float = 0.5  # error of an encoder's zero up to which it is sought
    joint_far_rad: float = 0.05  # error of the tilt that must be reported: a twentieth of the reach
    turn_step_rad: float = 0.35  # scale of the prior (Cauchy) of a sensor's turn about the antenna
    gravity_step_rad: float = 0.05  # scale of the prior (Cauchy) of a tilt of gravity, about each axis
    gravity_least_rad: float = 0.05  # smaller tilts of gravity are not distinguished from what a rig's drift leaves
    gravity_most_rad: float = 0.4  # largest tilt of gravity that is sought
    turn_least_rad: float = 0.1  # smaller turns hardly show
    turn_most_rad: float = 1.4  # largest turn that is sought: 90° is another axis
    error_std: float = 100.0  # prior standard deviation of an error of the moment, in those of its noise
    alike: float = 0.5  # correlation with the pictures' moments from which readings follow the antenna
    lag_step: float = 0.3  # scale of the prior (Cauchy) of a clock's error, rows
    lag_most: int = 16  # largest error of a clock that is sought, rows: a camera's delay at 100 Hz
    bends_std: float = 8.0  # second difference of moments, over their noise, up to which they can be interpolated
    knows: float = 0.3  # largest standard deviation of a picture's moment that counts, over the readings' range
    visible: float = 0.3  # least change by other joint angles, over the points' or the moment's standard deviation
    fewest_after: int = 5  # least number of frames after a change during the recording
    hopeless: float = 0.5  # part of unexplained frames from which the pictures may have another scale
    usual: float = 2.5  # cost per frame where all is as reported
    splits: int = 8  # places in a recording at which a rig may change

    # which frames are kept, and thresholds of faults in the series of readings
    first: int = 10  # frames at the beginning, which often show the free antenna
    spread: int = 22  # further frames, spread over the recording
    scatter: int = 10  # of the spread frames, number by which the points' scatter is measured
    fewest: int = 8  # fewer frames tell nothing from noise
    fewest_points: int = 5  # least number of points of a frame that is a witness
    coarse_std: float = 5.0  # steps of the moments, in standard deviations of their noise, from which they are doubted
    coarse_wrong_std: float = 12.0  # the same from which they are wrong: a rounded one is up to half a step off
    lattice: float = 0.02  # moments of few digits lie this close to multiples of their step, over the step
    fewest_values: int = 4  # fewer different moments do not tell their step
    kept: float = 0.2  # part of the rows with the moment of the row before from which it is read less often
    typical: float = 0.9  # quantile of the changes of the moment that says how much such a row is off
    at_limit: int = 3  # moments equal to the largest or smallest of all from which on the sensor is at its limit
    at_limit_share: float = 0.04  # least share of such moments among all
    fine_std: float = 0.2  # steps of moments, in standard deviations of their noise, from which equal ones are chance
    fewest_standing: int = 5  # equal moments within the range from which the sensor stops at times
    distinct: float = 0.8  # part of the other moments that differ from each other where they have enough digits
    beyond_std: float = 4.0  # standard deviations by which pictures ask for more than a moment at the end of its range
    repeated: int = 2  # rows that repeat the picture of the row before from which on the camera had stopped
    joints_rad: float = 0.05  # range of the joints from which on their encoders are tested
    apart_s: float = 8.0  # time between frames from which it is more likely in another unit
    other_shape: float = 2.0  # distance of the points from fitted shapes, over their scatter, that is not noise
    shared: float = 0.2  # part of the scatter's excess, common to all lines, from which the antenna's shape explains it
    spike_share: float = 3.0  # least distance of a spike from its neighbours' mean, over that between the neighbours
    spike_std: float = 10.0  # least distance of a spike from its neighbours' mean, over the noise
    spikes: int = 2  # spikes from which on they are the sensor's, not the contact's
    unexplained: float = 0.2  # part of unexplained frames from which they are reported
    contradicting: float = 0.5  # part of unexplained frames from which the explained ones are not believed either

    # pictures in the wrong rows
    compared: int = 64  # rows with pictures that are compared with each other at once
    places: int = 8  # places along the antenna at which its pictures are compared
    fewest_places: int = 3  # least number of places that both pictures show
    jumps: float = 0.7  # least distance of a jumping picture from its neighbours' mean, over theirs from each other
    jump_sigma: float = 3.0  # the same distance over the standard deviation of its points
    most_jumps: int = 32  # most jumps of a recording for which the right rows are sought
    series: float = 0.2  # part of jumping pictures up to which the rows are a series in time

    # moments and pictures as two series in time (1,000 clean series: log odds up to 4.3, leaps up to 16 std)
    window: int = 6  # rows over which a moment is linear in its picture
    most_windows: int = 400  # windows that are compared
    fewest_windows: int = 6  # fewer windows decide nothing
    unlike: float = 0.2  # part of the moments' range that their picture leaves unexplained, from which they are unlike
    filters_rows: tuple[float, ...] = (0.6, 1.0, 1.5, 2.2, 3.5, 6.0)  # time constants of low-pass filters, rows
    least_lags: int = 8  # rows of the recording for each row of delay that is tried
    seen_share: float = 0.9  # part of the rows in which a place along the antenna must be visible
    smooth_share: float = 0.15  # most scatter of smooth moments from row to row, over their standard deviation
    noisy_share: float = 0.35  # the same of moments that leap; clean ones have 0.08, fast ones 0.3
    leaping: float = 0.25  # part of rows with leaping pictures and smooth readings that is wrong; 0.05 in clean ones
    noisy_std: float = 15.0  # leaps of moments over their noise, where pictures hardly change, that are wrong

    # when a recording is judged while it runs, and how many witnesses it may lack
    judged: int = 64  # frames after which a recording is judged for the first time; then at twice as many each time
    unused_share: float = 0.1  # part of the frames in which a witness may contradict the rest before that is a finding
    fewest_used: int = 20  # least number of frames over which that part is taken
