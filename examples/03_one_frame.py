"""One frame from extracted pixels to a contact with its uncertainty, on a rig that is known."""

import cv2
import numpy as np
from drawing import BLUE, DARK, ORANGE, canvas, figures_folder, save

from vbaa import Camera, ContactEstimator, Rig
from vbaa_calib.antenna.rod import Rod, sample_shape, solve_rod
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor

stiffness_Nm2, mass_kg_m, length_m = 3.9e-3, 4.0e-3, 0.24
gravity = np.array([0.0, 0.0, -9.80665])
tilted = Pose.from_rotvec(np.array([np.pi - 0.5, 0.0, 0.0]), np.array([0.12, 0.15, 0.27]))
rig = Rig(
    camera=Camera("opencv", (960, 720), np.array([[1000.0, 0, 480], [0, 1000.0, 360], [0, 0, 1]]), np.zeros(0)),
    T_antenna_camera=tilted,
    antenna=Antenna(length_m, 0.0008, np.array([0, 0, 0, 0, 0, 0, np.log(stiffness_Nm2), np.log(mass_kg_m), 0.0])),
    moment_sensor=MomentSensor(gain=1.0, offset_Nm=0.0, std_Nm=2e-5),
    kinematics=Kinematics(),
    gravity_world_m_s2=gravity,
    image=AntennaImage(noise_px=0.1, noise_scale=1.0, bright=True),
    covariance=np.diag(np.full(len(RIG_PARAMETERS), 1e-10)),
)

# What the camera would see and the sensor feel: a static rod, pushed at 150 mm by 40 mN, square to it (no friction).
rod = Rod(length_m, stiffness_Nm2, stiffness_Nm2 / 1.3, mass_kg_m, Pose.identity(), np.zeros(2))
contact_m, force_N = np.array([0.15]), np.array([[0.0, 0.035, -0.02]])
for _ in range(5):
    shape = solve_rod(rod, gravity[None], contact_m, force_N)
    tangent = sample_shape(shape, contact_m[:, None])[1][0, 0]
    force_N[0, 0] = -(force_N[0, 1:] @ tangent[1:]) / tangent[0]
points, _ = sample_shape(shape, np.linspace(0.0, length_m, 200)[None])
seen = tilted.inverse() @ points[0]
pixels = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), rig.camera.matrix, None)[0].reshape(-1, 2)
pixels += np.random.default_rng(1).normal(0.0, 0.1, pixels.shape)
moment_Nm = -float(shape.clamp_moment_Nm[0, 1])

contact = ContactEstimator(rig).estimate(pixels, moment=moment_Nm, pan=0.0, tilt=0.0)
print(f"{contact.status}: l = {1e3 * contact.distance_m:.2f} ± {1e3 * contact.distance_std_m:.2f} mm (true 150)")
print("force", (1e3 * contact.force_N).round(2), "±", (1e3 * contact.force_std_N).round(2), "mN")
print("true ", (1e3 * force_N[0]).round(2))
print("contact point in the world", (1e3 * contact.point_world_m).round(2), "mm;", contact.reason)

if folder := figures_folder():
    figure, (left, right) = canvas(2)
    left.plot(*pixels.T, ".", color=BLUE, markersize=3, label="seen points")
    touch_px = rig.camera.project(tilted.inverse() @ contact.point_antenna_m[None])[0][0]
    left.plot(*touch_px, "o", color=ORANGE, markersize=8, fillstyle="none", label="contact found")
    left.set(xlim=(0, 960), ylim=(720, 0), xlabel="u, px", ylabel="v, px", title="the picture", aspect="equal")
    for axis, name, color in ((1, "y", BLUE), (2, "z", ORANGE)):
        right.plot(*1e3 * points[0][:, [0, axis]].T, color=color, label=f"{name} of the antenna, true")
        mean, std = 1e3 * contact.point_antenna_m, 1e3 * np.sqrt(np.diag(contact.covariance_world_m2))
        right.errorbar(mean[0], mean[axis], 10 * std[axis], 10 * std[0], "o", color=color, capsize=3)
    right.plot([], [], "o", color=DARK, label="contact found, bars of 10 deviations")
    right.set(xlabel="x, mm", ylabel="y and z, mm", title="in the antenna frame")
    left.legend(loc="upper left")
    right.legend()
    save(figure, folder, __file__)
