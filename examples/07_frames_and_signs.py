"""The frames and signs of docs/conventions.md, drawn, and each sign shown by a number."""

import numpy as np
from drawing import BLUE, DARK, GREEN, GREY, ORANGE, RED, canvas, figures_folder, save

from vbaa import Camera
from vbaa_calib.antenna.linear import deflection
from vbaa_calib.geometry import Kinematics, Pose

kinematics = Kinematics(T_actuator_antenna=Pose(np.eye(3), np.array([0.03, 0.0, 0.02])))
tip = np.array([0.24, 0.0, 0.0])
print("tip in the world, mm:")
for pan_deg, tilt_deg in ((0, 0), (10, 0), (0, 10)):
    at = kinematics.T_world_antenna(*np.radians([pan_deg, tilt_deg])) @ tip
    print(f"  pan {pan_deg:2d}°, tilt {tilt_deg:2d}°: X {1e3 * at[0]:6.1f}, Y {1e3 * at[1]:5.1f}, Z {1e3 * at[2]:5.1f}")

distance_m, stiffness_Nm2 = 0.14, 3.9e-3
force_N = np.array([0.0, 0.04, 0.03])
contact_m = np.array([distance_m, *deflection(np.array(distance_m), distance_m, force_N[1:], stiffness_Nm2)])
moment_Nm = contact_m[0] * force_N[2] - contact_m[2] * force_N[0]
print(f"pushed towards +y and +z it bends to y = {1e3 * contact_m[1]:.1f}, z = {1e3 * contact_m[2]:.1f} mm there,")
print(f"roll = {np.degrees(np.arctan2(force_N[2], force_N[1])):.1f}°, moment τ_y = {1e3 * moment_Nm:+.2f} mN·m,")
print(f"the right-handed moment about y = {1e3 * np.cross(contact_m, force_N)[1]:+.2f} mN·m")

camera = Camera("opencv", (1280, 720), np.array([[900.0, 0, 639.5], [0, 900.0, 359.5], [0, 0, 1]]), np.zeros(0))
pixel = camera.project(np.array([[0.0, 0.0, 1.0]]))[0][0]
print(f"a camera's axis meets a picture of 1280 × 720 in its middle, ({pixel[0]:.1f}, {pixel[1]:.1f}), not (640, 360)")


def triad(axes, pose, size_m, name):
    """Draw a frame's three axes, x red, y green, z blue."""
    start = pose.translation_m
    for direction, color, letter in zip(pose.rotation.T, (RED, GREEN, BLUE), "xyz", strict=True):
        axes.quiver(*start, *(size_m * direction), color=color, arrow_length_ratio=0.2, linewidth=1.5)
        axes.text(*(start + 1.2 * size_m * direction), letter, color=color)
    axes.text(*(start - [0.02, 0.0, 0.035]), name, color=DARK, ha="right")


if folder := figures_folder():
    figure, left = canvas(1, 5.2, subplot_kw={"projection": "3d", "computed_zorder": False})
    base = kinematics.T_world_antenna(0.0, 0.0)
    x = np.linspace(0.0, 0.24, 49)
    bent = np.stack([x, *(deflection(x, distance_m, f, stiffness_Nm2) for f in force_N[1:])], axis=-1)
    patch = np.array([[[0.0, -0.06, 0.0], [0.26, -0.06, 0.0]], [[0.0, 0.06, 0.0], [0.26, 0.06, 0.0]]])
    left.plot_surface(*np.moveaxis(base @ patch.reshape(-1, 3), -1, 0).reshape(3, 2, 2), color=GREY, alpha=0.25)
    roll = np.arctan2(force_N[2], force_N[1])
    hinge = np.array([[[x, w * np.cos(roll), w * np.sin(roll)] for w in (0.0, 0.06)] for x in (0.0, 0.26)])
    left.plot_surface(*np.moveaxis(base @ hinge.reshape(-1, 3), -1, 0).reshape(3, 2, 2), color=ORANGE, alpha=0.25)
    left.plot(*(base @ bent).T, color=DARK, linewidth=3)
    left.quiver(*(base @ contact_m), *(1.3 * force_N), color=ORANGE, linewidth=2.5, arrow_length_ratio=0.25)
    left.text(*(base @ contact_m + 1.5 * force_N), "force on the antenna", color=ORANGE)
    left.text(*(base @ np.array([0.26, -0.06, 0.0])), "plane C", color=DARK)
    left.text(*(base @ np.array([0.262, 0.05, 0.03])), r"$\mathcal{D}$, at the roll ξ", color=ORANGE)
    above = Pose.from_rotvec(np.array([np.pi - 0.3, 0.0, 0.0]), np.array([0.12, 0.06, 0.2]))
    triad(left, Pose.identity(), 0.05, "world, joints at 0")
    triad(left, base, 0.05, "")
    left.text(*(base @ np.array([0.0, 0.0, 0.075])), "antenna", color=DARK)
    triad(left, base @ above, 0.05, "camera")
    left.set(xlabel="X, m", ylabel="Y, m", zlabel="Z, m", yticks=(-0.1, 0.0, 0.1))
    left.set(xlim=(-0.02, 0.28), ylim=(-0.1, 0.1), zlim=(-0.03, 0.22))
    left.set_box_aspect((0.30, 0.20, 0.25), zoom=1.15)
    left.view_init(22, -62)
    save(figure, folder, __file__)
