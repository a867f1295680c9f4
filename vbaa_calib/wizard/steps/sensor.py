"""The moment sensor, by the pictures of the steps before: nothing more has to be shot."""

from __future__ import annotations

import numpy as np

from vbaa_calib.calibrate.antenna.problem import GAIN, OFFSET
from vbaa_calib.wizard.state.progress import Number, Progress
from vbaa_calib.wizard.state.session_state import Known

from .step import Step


def look(known: Known) -> Progress:
    """Gain, zero and scatter of the sensor."""
    joint = known.joint()
    gain, offset = joint.sensor_gain_offset
    std = np.sqrt(np.diag(joint.covariance))[[GAIN, OFFSET]]
    scatter = float(np.sqrt(np.mean(joint.moment_residuals_Nm**2)))
    diagnoses = [one for one in known.still_diagnoses() if "sensor" in one.name or "moment" in one.name]
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


STEP = Step(
    "sensor",
    "Moment sensor",
    "Nothing to shoot: the sensor is held against the pictures of the free and the loaded antenna.",
    "It tells how far along the antenna something touches; turned round or loose, it tells the wrong place.",
    look,
)
