"""The ladder of models: how far off each rung is, and says it is, as the antenna is bent further."""

import numpy as np
from drawing import BLUE, DARK, GREEN, ORANGE, RED, canvas, figures_folder, save

from benchmarks.estimator.scenes import rod_shapes, scenes
from benchmarks.estimator.setup import STIFFNESS_NM2, Setup
from vbaa import ContactEstimator
from vbaa_calib.antenna.elastica import normal_load

# A real antenna, with weight, bow and a clamp that is off, touched at 140 mm at a roll of 30°, frictionless. The
# picture is made by the static rod and has no noise, so that what is left is the model's own error. The rig is exact.
rig = Setup(real=True, tilt_rad=0.5).rig()
slopes = np.radians([1.0, 2.0, 4.0, 7.0, 12.0, 18.0, 25.0, 30.0, 35.0])
distance_m = np.full(len(slopes), 0.14)
loads = np.linspace(0.0, 4.0, 400)  # F·l²/EI
load = np.interp(slopes, normal_load(np.ones(1), loads).theta_rad[:, 0], loads)
size_N = load * STIFFNESS_NM2 / distance_m**2
frames = scenes(
    rig, distance_m, size_N[:, None] * [np.cos(np.pi / 6), np.sin(np.pi / 6)], made_by=rod_shapes, sigma_px=0.1
)
given = frames.points_px, frames.moment_Nm, frames.pan_rad, frames.tilt_rad

print("distance off by, in its own deviations; in brackets the largest bias of l, f_y and f_z that the rung predicts")
print(f"{'slope at the contact':<20}", *(f"{degrees:12.0f}°" for degrees in np.degrees(slopes)))
made, predicted = {}, {}
for rung in ("paper", "linear", "elastica", "rod"):
    contacts = ContactEstimator(rig, rung, friction=0.0).estimate_batch(*given)
    made[rung] = (contacts.distance_m - distance_m) / contacts.distance_std_m
    predicted[rung] = np.array([contact.bias.get(rung, 0.0) for contact in contacts])  # the rod is the yardstick
    off = [f"{value:.2f}" if found == "ok" else found for value, found in zip(made[rung], contacts.status, strict=True)]
    cells = (f"{made_std} ({bias:.1f})" for made_std, bias in zip(off, predicted[rung], strict=True))
    print(f"{rung:<20}", *(f"{cell:>13}" for cell in cells))
auto = ContactEstimator(rig, friction=0.0).estimate_batch(*given)
print(f"{'auto takes':<20}", *(f"{contact.model:>13}" for contact in auto))

if folder := figures_folder():
    figure, (left, right) = canvas(2)
    for (rung, off), color in zip(made.items(), (RED, ORANGE, BLUE, GREEN), strict=True):
        left.semilogy(np.degrees(slopes), np.maximum(abs(off), 1e-3), "o-", color=color, markersize=3, label=rung)
        right.semilogy(np.degrees(slopes), np.maximum(predicted[rung], 1e-3), color=color, label=rung)
    for panel in (left, right):
        panel.axhline(1.0 / 3.0, color=DARK, linestyle=":", linewidth=1.0)
        panel.set(xlabel="slope at the contact, °", ylim=(8e-4, 1e3))
    left.set(ylabel="standard deviations", title="error made in the distance")
    right.set(title="bias predicted; dotted: what auto allows")
    left.legend()
    save(figure, folder, __file__)
