"""Thresholds and priors of hypotheses about a session, and the ranges of their values."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class _SessionSettings:
    """Thresholds and priors of hypotheses about a session: natural logarithms in log odds and nats, standard deviations
    of true values about reported ones."""

    # how the pictures are compared with a rig
    points: int = 8  # points that stand for a picture: values of the smooth curve through its points
    sensor_off: float = 1e6  # factor on the moment sensor's noise that switches it off
    common: float = 0.25  # error that neighbouring points share, over a point's σ: scatter does not show it
    picture_freedom: float = 8.0  # degrees of freedom of Student's errors that all points of a picture have in common
    usual_cost: float = 3.2  # nats of a picture that fits
    far_off: float = 10.0  # scatter of most pictures from which a solve begins with least squares
    moment_relative: float = 2e-3  # least relative error of a predicted moment
    left_out: float = 30.0  # nats that an unexplained picture costs
    rounds: int = 5  # rounds of weighing the pictures in a forecast
    # mistakes in a session
    mistake: float = -3.0  # log odds of one mistake in the session's own numbers
    measured: float = -1.5  # log odds of an error in a length measured by hand: the antenna's, or one load's distance
    rare: float = -5.0  # log odds of a rare mistake: a whisker of two materials, a bent frame
    length: float = 0.03  # relative standard deviation of a wrong length
    board: float = 0.02  # the same of the board's squares
    distance: float = 0.03  # standard deviation of one load's wrong place, in lengths of the antenna
    shift_m: float = 5e-3  # the same of all loads' places
    force: float = 0.7  # standard deviation of the logarithm of one load's wrong force
    turn_rad: float = 0.15  # the same of the direction of loads, and of gravity
    slip_m: float = 2e-3  # the same of the shift of a clamp that slipped
    slip_rad: float = 0.02  # the same of the turn of a clamp
    camera_rad: float = 0.03  # the same of the turn of a camera that has moved since plane C was found, per axis
    camera_m: float = 5e-3  # the same of its shift
    focal: float = 0.02  # relative standard deviation of a focal length that has changed since
    crop: float = 0.15  # the same of the enlargement of cropped pictures
    bow: float = 0.05  # standard deviation of a bent antenna's change of slope over its length
    give_m: float = 5e-3  # standard deviation of a soft clamp's give
    uneven: float = 0.2  # standard deviation of the logarithm of EI's ratio between y and z
    profile: float = 0.5  # the same of the change of compliance along the antenna
    cone: float = 0.7  # the same of the logarithm of the tip's diameter over the clamp's
    thinnest: float = 2.5  # largest value of that logarithm: 1:12
    touch: float = 0.05  # standard deviation of the deflection by an unnoticed touch, over the length
    moduli_Pa: tuple[float, float] = (1e9, 450e9)  # range of Young's moduli of antennas
    misfit: float = 8.0  # nats above those of noise from which gross mistakes are tried
    vague: float = (
        100.0  # the same from which something is wrong that no hypothesis describes; clean ones have up to 51
    )
    tried: int = 12  # hypotheses that are solved in full
    tries: int = 12  # steps of such a solve after which it goes on only if it may come near the best cost so far
    behind: float = 30.0  # nats above the best cost up to which that counts as near
    hopeless: float = 4.0  # nats by which a forecast may fall short of the decision's least log odds
    by_moments: float = 25.0  # the same of mistakes that the moments show
    gross: float = 2.0  # scatter from which any row may be wrong
    fits: float = 3.0  # scatter of the pictures about the best rig, over their own, from which nothing explains them
    # the moment sensor
    gain_std: float = 0.01  # relative standard deviation of the gain of a sensor that was calibrated, and read in N·m
    unit_std: float = 0.05  # the same of one that was read in another unit
    own_gain_std: float = 0.2  # the same of one with a gain of its own
    any_gain_std: float = 2.0  # the same of one that was never calibrated
    offset_std_Nm: float = 0.02
    offset_std_N: float = 2.0
    sensor_fault: float = -2.0
    noisy: float = -3.0  # log odds that a sensor scatters more than its stated noise
    seen_std: float = 30.0  # range of the moments, in its noise, from which it can be judged
    fewest: int = 4  # readings from which more than a dead sensor is recognised
    usual_gains: tuple[float, float] = (0.5, 2.0)  # range of gains that a calibration may leave


SETTINGS = _SessionSettings()
