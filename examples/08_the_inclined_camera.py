"""A camera that looks along plane C as well: depth looks like length. The exact solution beside the paper's (29)."""

import numpy as np
from drawing import BLUE, DARK, GREEN, GREY, ORANGE, RED, canvas, figures_folder, save

from estimator.paper.inclined import eq29_baseline, inclined_two_point_contact, project
from estimator.paper.two_point import two_point_contact
from vbaa_calib.antenna.linear import deflection

# The paper's camera B: parallel rays, tilted by φ towards the clamp. The antenna is touched at 140 mm by a force that
# would deflect it there by 12 mm, in a deformation plane 𝒟 at the roll ξ from plane C. Two curved points are seen.
stiffness_Nm2, length_m, distance_m, tilt_rad = 3.9e-3, 0.24, 0.14, np.radians(30.0)
size_N = 3.0 * stiffness_Nm2 * 0.012 / distance_m**3
x_m = np.array([0.07, 0.13])


def seen(x, roll_rad):
    """(x_p, y) on plane C of the points at x, and the moment reading, for a force of that roll."""
    force_y, force_z = size_N * np.cos(roll_rad), size_N * np.sin(roll_rad)
    y, z = (deflection(x, distance_m, force, stiffness_Nm2) for force in (force_y, force_z))
    return project(np.stack([x, y, z], axis=-1), tilt_rad), distance_m * force_z


ways = {"camera's tilt ignored": [], "Eq. (29)": [], "exact": []}
rolls = np.radians(np.arange(-75, 76, 15))
for roll in rolls:
    points, moment_Nm = seen(x_m, roll)
    two = points[:, 0], points[:, 1]
    known = moment_Nm, stiffness_Nm2, tilt_rad, length_m
    ways["camera's tilt ignored"].append(two_point_contact(*two, stiffness_Nm2).contact_m)
    ways["Eq. (29)"].append(eq29_baseline(*two, *known))
    ways["exact"].append(inclined_two_point_contact(*two, *known).contact_m)
off_mm = {name: 1e3 * (np.array(found) - distance_m) for name, found in ways.items()}
print("error of l in mm for rolls of", *(f"{degrees:.0f}°" for degrees in np.degrees(rolls)))
for name, errors in off_mm.items():
    print(f"  {name:<21}", *(f"{error + 0.0:7.2f}" for error in errors.round(6)))

if folder := figures_folder():
    figure, (hinge, side, errors) = canvas(3, 3.1)
    roll, ray = np.radians(50.0), np.array([0.3, 1.0])
    point = 11.0 * np.array([np.cos(roll), np.sin(roll)])
    hinge.plot([-4, 16], [0, 0], color=GREY, label="plane C")
    hinge.plot([0, 16 * np.cos(roll)], [0, 16 * np.sin(roll)], color=ORANGE, label=r"$\mathcal{D}$, at the roll ξ")
    on_c = point - ray * point[1] / ray[1]
    hinge.plot(*np.stack([on_c - 0.5 * ray, point + 6.0 * ray]).T, color=BLUE, linestyle=":", label="ray to the camera")
    hinge.plot(*point, "o", color=DARK)
    hinge.plot(*on_c, "o", color=DARK, fillstyle="none")
    hinge.set(xlabel="y, mm", ylabel="z, mm", title="along the antenna", ylim=(-3, 24))
    roll = np.radians(60.0)
    x = np.linspace(0.0, length_m, 100)
    z = deflection(x, distance_m, size_N * np.sin(roll), stiffness_Nm2)
    side.plot(1e3 * x, 1e3 * z, color=DARK, label="antenna")
    z_m = deflection(x_m, distance_m, size_N * np.sin(roll), stiffness_Nm2)
    for at, height, shown in zip(x_m, z_m, seen(x_m, roll)[0][:, 0], strict=True):
        side.plot(1e3 * np.array([shown, at]), [0, 1e3 * height], ":", color=BLUE)
        side.plot(1e3 * at, 1e3 * height, "o", color=DARK)
        side.plot(1e3 * shown, 0.0, "o", color=DARK, fillstyle="none")
    side.axhline(0.0, color=GREY)
    side.set(xlabel="x, mm", ylabel="z, mm", title="from the side: x_p = x + z·tan φ", ylim=(-2, 30))
    for (name, values), color in zip(off_mm.items(), (RED, ORANGE, GREEN), strict=True):
        errors.plot(np.degrees(rolls), values, "o-", color=color, markersize=3, label=name)
    errors.set(xlabel="roll ξ, °", ylabel="error of l, mm", title="two points without noise", ylim=(-12, 28))
    for panel in (hinge, side, errors):
        panel.legend(loc="upper left", fontsize=7.0)
    save(figure, folder, __file__)
