"""The paper's own way: two points of the bent antenna give contact distance and force."""

import numpy as np

from estimator.two_point import Part, two_point_contact
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
