"""The antenna: free, under known loads, and its moment sensor."""

from __future__ import annotations

from functools import partial

import numpy as np

from vbaa_calib.calibrate.antenna.problem import GAIN, OFFSET
from vbaa_calib.calibrate.guide.next_load import load_progress
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.session import Load
from vbaa_calib.wizard.state.session_state import SessionState

from .step import ENOUGH, Number, Progress, Step, check_antenna, counted

_FREE_LEAST, _FREE_ENOUGH, _LOADS_LEAST = 2, 5, 2
_GOAL = 0.01
"""Relative standard deviation of EI."""
_POSES_DEG = ((0.0, 0.0), (0.0, 20.0), (0.0, -20.0), (20.0, 0.0), (-20.0, 0.0))


def _free_progress(state: SessionState) -> Progress:
    taken = state.taken("noload")
    tilts = [np.degrees(one.readings["tilt_rad"]) for one in taken]
    missing, diagnoses, solved = [], [], False
    if len(taken) < _FREE_ENOUGH:
        missing.append(counted(_FREE_ENOUGH - len(taken), "more picture"))
    if taken and np.ptp(tilts) < 20.0:
        missing.append("another tilt: how the antenna sags under its weight shows gravity and the moment sensor's gain")
    if len(taken) >= _FREE_LEAST:
        try:
            diagnoses = state.still_diagnoses()
            solved = True
        except VbaaError as error:
            missing.append(str(error))
    pan, tilt = _POSES_DEG[min(len(taken), len(_POSES_DEG) - 1)]
    enough = len(taken) >= _FREE_ENOUGH and not missing
    return Progress(
        seen=(f"{counted(len(taken), 'picture')} of the free antenna",),
        missing=tuple(missing),
        next=ENOUGH if enough else f"free antenna at pan {pan:g}°, tilt {tilt:g}°, at rest",
        enough=enough,
        usable=solved,
        diagnoses=tuple(diagnoses),
    )


def _loads_progress(state: SessionState) -> Progress:
    taken = state.taken("loads")
    seen = (counted(len(taken), "load"),)
    masses = [1e-3 * float(mass) for mass in state.store.journal.answers["weights_g"]]
    try:
        now = load_progress(state.joint(), state.session, masses, state.plane().kinematics, _GOAL)
    except VbaaError as error:
        then = "correct what is said above; `back` leads to it" if taken else "hang a weight on the antenna"
        return Progress(seen, (str(error),), then)
    loaded = any(isinstance(still, Load) for still in state.stills())
    enough = now.enough and len(taken) >= _LOADS_LEAST
    std = Number(
        "stiffness EI, one standard deviation",
        f"{100 * now.now.total:.2f} %" if loaded else "not known yet",
        f"{100 * _GOAL:.0f} %",
        now.reached if loaded else None,
    )
    return Progress(
        seen=seen,
        missing=(*(() if enough else (now.words,)), *now.missing),
        next=ENOUGH if enough else now.suggestion.words if now.suggestion else "",
        enough=enough,
        usable=len(taken) >= _LOADS_LEAST,
        numbers=(std,),
        diagnoses=tuple(state.still_diagnoses()) if loaded else (),
    )


def _sensor_progress(state: SessionState) -> Progress:
    joint = state.joint()
    gain, offset = joint.sensor_gain_offset
    std = np.sqrt(np.diag(joint.covariance))[[GAIN, OFFSET]]
    scatter = float(np.sqrt(np.mean(joint.moment_residuals_Nm**2)))
    diagnoses = [one for one in state.still_diagnoses() if "sensor" in one.name or "moment" in one.name]
    return Progress(
        seen=(f"{len(joint.moment_residuals_Nm)} readings, {1e3 * scatter:.3g} mN·m off the model (rms)",),
        next="" if not diagnoses else diagnoses[0].remedy,
        enough=True,
        usable=True,
        numbers=(
            Number("gain", f"{gain:.4f} ± {std[0]:.4f}"),
            Number("zero", f"{1e3 * offset:.3f} ± {1e3 * std[1]:.3f} mN·m"),
        ),
        diagnoses=tuple(diagnoses),
    )


FREE = Step(
    "noload",
    "Free antenna",
    "Let nothing touch the antenna. Turn it to a few pan and tilt angles, wait until it rests, read the moment sensor.",
    "Nothing is straight and nothing weighs nothing: bow, sag and the sensor's zero have to be known before a contact.",
    _free_progress,
    partial(check_antenna, "noload"),
)
LOADS = Step(
    "loads",
    "Known loads",
    "Hang known masses on the antenna, one at a time, at measured distances from the clamp; let it rest.",
    "How far a known force bends it is its stiffness EI, and EI turns every bend seen later into newtons.",
    _loads_progress,
    partial(check_antenna, "loads"),
)
SENSOR = Step(
    "sensor",
    "Moment sensor",
    "Nothing to shoot: the sensor is compared with the pictures of the free and the loaded antenna.",
    "It locates a contact along the antenna; turned round or loose, it puts it in the wrong place.",
    _sensor_progress,
)
