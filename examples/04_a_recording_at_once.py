"""A recording in one call: what comes out by columns, where nothing is said, and what friction is worth."""

import cv2
import numpy as np
from drawing import BLUE, DARK, ORANGE, canvas, figures_folder, save

from vbaa import Camera, ContactEstimator, Rig
from vbaa_calib.antenna.rungs import curves
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor

stiffness_Nm2, mass_kg_m, length_m, count = 3.9e-3, 4.0e-3, 0.24, 300
parameters = np.array([0, 0, 0, 0, 0, 0, np.log(stiffness_Nm2), np.log(mass_kg_m), 0.0])
from_above = Pose.from_rotvec(np.array([np.pi - 0.5, 0.0, 0.0]), np.array([0.12, 0.15, 0.27]))
rig = Rig(
    camera=Camera("opencv", (960, 720), np.array([[1000.0, 0, 480], [0, 1000.0, 360], [0, 0, 1]]), np.zeros(0)),
    T_antenna_camera=from_above,
    antenna=Antenna(length_m, 0.0008, parameters),
    moment_sensor=MomentSensor(gain=1.0, offset_Nm=0.0, std_Nm=2e-5),
    kinematics=Kinematics(),
    gravity_world_m_s2=np.array([0.0, 0.0, -9.80665]),
    image=AntennaImage(noise_px=0.1, noise_scale=1.0, bright=True),
    covariance=np.diag(np.full(len(RIG_PARAMETERS), 1e-10)),
)

# A contact that slides outwards over a rough object and is pressed harder on the way; in the first frames nothing is
# touched yet. The force leans by friction against the sliding, towards the clamp.
rng, way = np.random.default_rng(1), np.linspace(0.0, 1.0, count)
distance_m, lean_rad = 0.1 + 0.1 * way, np.full(count, 0.25)
size_N = np.where(way < 0.1, 0.0, 0.2 * (way - 0.1)) * (0.12 / distance_m) ** 2
force_N = size_N[:, None] * np.array([0.9, -0.4])
gravity = np.tile(rig.gravity_world_m_s2, (count, 1))
seen = curves("rod", np.tile(parameters, (count, 1)), length_m, gravity, distance_m, force_N, lean_rad)
in_camera = from_above.inverse() @ seen.points_m.reshape(-1, 3)
pixels = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), rig.camera.matrix, None)[0].reshape(count, -1, 2)
pixels = pixels + rng.normal(0.0, 0.1, pixels.shape)
moments_Nm = seen.moment_Nm + rng.normal(0.0, 2e-5, count)
still = np.zeros(count)

answers = {}
for friction_rad in (0.0, 0.2):
    contacts = answers[friction_rad] = ContactEstimator(rig, friction=friction_rad).estimate_batch(
        pixels, moments_Nm, still, still
    )
    found = contacts.status == "ok"
    off = (contacts.distance_m - distance_m)[found]
    names, counts = np.unique(contacts.status, return_counts=True)
    print(f"friction {friction_rad:.1f} rad:", ", ".join(f"{n} {name}" for name, n in zip(names, counts, strict=True)))
    print(
        f"  distance off by {1e3 * np.sqrt(np.mean(off**2)):.2f} mm rms, "
        f"{np.sqrt(np.mean((off / contacts.distance_std_m[found]) ** 2)):.1f} of its standard deviations"
    )

last = contacts[-1]
print(f"last frame: leans by {last.friction_angle_rad:.2f} ± {last.friction_angle_std_rad:.2f} rad (true 0.25)")
print(f"  {last.reason}; first frame: {contacts[0].status}, {contacts[0].reason}")

if folder := figures_folder():
    figure, (left, right) = canvas(2)
    for (friction_rad, contacts), color in zip(answers.items(), (ORANGE, BLUE), strict=True):
        off_mm, std_mm = 1e3 * (contacts.distance_m - distance_m), 1e3 * contacts.distance_std_m
        label = f"friction {friction_rad:.1f} rad"
        left.fill_between(np.arange(count), off_mm - 2 * std_mm, off_mm + 2 * std_mm, color=color, alpha=0.3, lw=0)
        left.plot(off_mm, ".", color=color, markersize=3, label=label)
    left.axhline(0.0, color=DARK, linewidth=0.8)
    left.set(xlabel="frame", ylabel="error of l, mm", ylim=(-4, 4), title="distance, and two deviations")
    angle, std = contacts.friction_angle_rad, contacts.friction_angle_std_rad
    right.fill_between(np.arange(count), angle - 2 * std, angle + 2 * std, color=BLUE, alpha=0.3, lw=0)
    right.plot(angle, ".", color=BLUE, markersize=3, label="found")
    right.axhline(lean_rad[0], color=DARK, label="true")
    right.set(xlabel="frame", ylabel="friction angle, rad", title="seen once the antenna is bent enough")
    left.legend()
    right.legend()
    save(figure, folder, __file__)
