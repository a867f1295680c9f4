"""The paper's own way: two points of the bent antenna give contact distance and force."""

import numpy as np
from drawing import BLUE, DARK, GREEN, ORANGE, canvas, figures_folder, save

from estimator.paper.two_point import Part, two_point_contact
from vbaa_calib.antenna.linear import deflection

stiffness_Nm2, distance_m, force_N = 3.9e-3, 0.12, 0.03
for x_m in ((0.04, 0.09), (0.15, 0.22), (0.06, 0.20)):
    x = np.array(x_m)
    y = deflection(x, distance_m, force_N, stiffness_Nm2)
    exact = two_point_contact(x, y, stiffness_Nm2)
    noisy = two_point_contact(x, y + np.array([2e-5, 0.0]), stiffness_Nm2)
    print(
        f"points at {1e3 * x[0]:.0f} and {1e3 * x[1]:.0f} mm, case {Part(int(exact.part)).name}: "
        f"l = {1e3 * exact.contact_m:.3f} mm, f_y = {1e3 * exact.force_y_N:.3f} mN; "
        f"with 0.02 mm of noise on the first, l = {1e3 * noisy.contact_m:.1f} mm"
    )

if folder := figures_folder():
    figure, (left, right) = canvas(2)
    x = np.linspace(0.0, 0.24, 241)
    left.plot(1e3 * x, 1e3 * deflection(x, distance_m, force_N, stiffness_Nm2), color=DARK, label="antenna")
    left.axvline(1e3 * distance_m, color=DARK, linestyle=":", label="contact")
    far = np.linspace(0.03, 0.24, 211)
    for near_m, color in ((0.02, BLUE), (0.08, GREEN), (0.14, ORANGE)):
        x = np.stack([np.full_like(far, near_m), far], axis=-1)[far > near_m + 0.005]
        y = deflection(x, distance_m, force_N, stiffness_Nm2)
        worth = two_point_contact(x, y, stiffness_Nm2).condition_contact
        left.plot(
            1e3 * near_m, 1e3 * deflection(np.array(near_m), distance_m, force_N, stiffness_Nm2), "o", color=color
        )
        right.semilogy(1e3 * x[:, 1], worth, color=color, label=f"first point at {1e3 * near_m:.0f} mm")
    left.set(xlabel="x, mm", ylabel="y, mm", title="the bent antenna, and three first points")
    right.set(
        xlabel="second point at x, mm",
        ylabel="relative error of l per one of y",
        title="condition number",
        ylim=(1, None),
    )
    left.legend()
    right.legend(loc="lower left")
    save(figure, folder, __file__)
