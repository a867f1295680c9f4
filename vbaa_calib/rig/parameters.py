"""What the rows of the joint covariance are."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS

POSE_PARAMETERS = (
    "camera_about_x_rad",
    "camera_about_y_rad",
    "camera_about_z_rad",
    "camera_x_m",
    "camera_y_m",
    "camera_z_m",
)
SENSOR_PARAMETERS = ("moment_gain", "moment_offset_Nm")
RIG_PARAMETERS = POSE_PARAMETERS + ANTENNA_PARAMETERS + SENSOR_PARAMETERS
"""Order of the joint covariance, before the lens. The pose's six are the tangent of `T_antenna_camera.retract`."""
RIG_STEPS = np.array([1e-5] * 6 + [1e-5] * 2 + [1e-4] * 2 + [1e-3] * 4 + [1e-4])
"""Finite-difference steps of pose and antenna: small against the curvature of the model, large against its rounding."""
