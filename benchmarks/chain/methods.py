"""This library's ways from pictures in memory to contacts, and what every way gives back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator import ContactEstimator
from estimator.contact.recording import FirstDetection, detect, detect_again, detections, measured
from estimator.table.contacts import Contact, Measured
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.detect.whisker.centreline import NOTHING, Centreline
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

from .scenes import FRICTION_STD_RAD, JOINTS_RAD, Photograph

MODELS = (*RUNGS, "auto")
PAPER_RUNG = RUNGS[0]
OURS, ONE_LOOK = "this library", "this library, one look"
PAPER, LINE = "the paper's two points", "straight line"
LOOP, CLASSIC = "SciPy on our centreline", "undistorted picture"


@dataclass(frozen=True, eq=False)
class Answers:
    """Of K pictures; NaN where a method gives no number, or states no deviation.

    Attributes
    ----------
    distance_m, std_m : (K,) of the contact, and the deviation that the method states.
    force_N : (K, 2) f_y and f_z.
    """

    distance_m: np.ndarray
    std_m: np.ndarray
    force_N: np.ndarray


@dataclass(frozen=True, eq=False)
class Method:
    """A way from pictures to contacts, made ready for one rig: what can be worked out once is worked out.

    Attributes
    ----------
    solve : pictures to answers; one picture is a frame that comes alone, several are a recording.
    told : the truth decides which points it takes, as no user can.
    """

    name: str
    family: str
    solve: Callable[[Sequence[Photograph]], Answers]
    told: bool = False


def ours(rig: Rig) -> list[Method]:
    """Every rung after two looks at the picture, and `auto` after one."""
    ready = {model: ContactEstimator(rig, model=model, friction=FRICTION_STD_RAD) for model in MODELS}
    methods = [Method(model, OURS, partial(_contacts, ready[model], True)) for model in MODELS]
    return [*methods, Method("auto, one look", ONE_LOOK, partial(_contacts, ready["auto"], False))]


def frame_of(photograph: Photograph) -> Frame:
    """What is read beside the picture."""
    pan, tilt = JOINTS_RAD
    return Frame(None, pan, tilt, photograph.moment_Nm, frame=0, time_s=float("nan"))


def seen(estimator: ContactEstimator, photographs: Sequence[Photograph], twice: bool = True) -> Iterator[Measured]:
    """What the fit is given of pictures, by the steps that a recording's pictures go through."""
    glances = (_glance(estimator, one) for one in photographs)
    if twice:
        return (each.measured for each in detections(estimator, glances))
    return (measured(estimator.rig, each.frame, each.line if each.line.found else NOTHING) for each in glances)


def centreline(estimator: ContactEstimator, photograph: Photograph) -> Centreline:
    """As it is seen at the second look."""
    (seen_again,) = detect_again(estimator, [_glance(estimator, photograph)])
    return seen_again.line if seen_again.line.found else NOTHING


def _glance(estimator: ContactEstimator, photograph: Photograph) -> FirstDetection:
    frame = frame_of(photograph)
    return FirstDetection(frame, photograph.image, detect(estimator.rig, frame, photograph.image))


def _contacts(estimator: ContactEstimator, twice: bool, photographs: Sequence[Photograph]) -> Answers:
    offered = seen(estimator, photographs, twice)
    if len(photographs) == 1:
        return answers([estimator.measure(one) for one in offered])
    return answers(list(estimator.run(offered)))


def answers(contacts: Sequence[Contact]) -> Answers:
    """The estimator's contacts as answers."""
    return Answers(
        np.array([contact.distance_m for contact in contacts]),
        np.array([contact.distance_std_m for contact in contacts]),
        np.array([contact.force_N[1:] for contact in contacts]),
    )
