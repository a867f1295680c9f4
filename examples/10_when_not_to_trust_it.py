"""When not to trust it: the camera looks along the deformation plane, and the deviations say so before the status."""

import numpy as np
from drawing import BLUE, DARK, RED, canvas, figures_folder, save

from benchmarks.estimator.scenes import scenes
from benchmarks.estimator.setup import ACROSS, STIFFNESS_NM2, Setup
from vbaa import ContactEstimator

# The antenna is touched at 140 mm by one force, turned about the antenna from ξ = 0 (in plane C) to 90° (square on
# it). An upright camera then has the deformation plane along its line of sight; one that leans across has it elsewhere.
distance_m, rolls = 0.14, np.radians(np.arange(0.0, 91.0, 3.0))
size_N = 3.0 * STIFFNESS_NM2 * 0.012 / distance_m**3
push_N = size_N * np.stack([np.cos(rolls), np.sin(rolls)], axis=-1)
cameras = {"upright": 0.0, "leaning 30° across": np.radians(30.0)}
answers = {}
for name, tilt_rad in cameras.items():
    rig = Setup(exact=False, tilt_rad=tilt_rad, azimuth_rad=ACROSS).rig()
    frames = scenes(rig, np.full(len(rolls), distance_m), push_N).noisy(np.random.default_rng(4))
    answers[name] = contacts = ContactEstimator(rig, friction=0.0).estimate_batch(
        frames.points_px, frames.moment_Nm, frames.pan_rad, frames.tilt_rad
    )
    print(f"camera {name}:")
    for roll in (0, 30, 57, 60, 63, 75, 87, 90):
        contact = contacts[roll // 3]
        numbers = f"l = {1e3 * contact.distance_m:.2f} ± {1e3 * contact.distance_std_m:.2f} mm"
        print(f"  roll {roll:2d}°: {numbers if contact.status == 'ok' else contact.status + ': ' + contact.reason}")

if folder := figures_folder():
    figure, panels = canvas(2, sharey=True)
    for panel, (name, contacts) in zip(panels, answers.items(), strict=True):
        degrees, told = np.degrees(rolls), contacts.status == "ok"
        off, std = 1e3 * (contacts.distance_m - distance_m), 1e3 * contacts.distance_std_m
        panel.fill_between(degrees[told], -2 * std[told], 2 * std[told], color=BLUE, alpha=0.25, lw=0)
        panel.plot(degrees[told], off[told], ".", color=BLUE, label="error, and two deviations")
        panel.plot(degrees[~told], 0.0 * degrees[~told], "x", color=RED, label="no number given")
        panel.axhline(0.0, color=DARK, linewidth=0.8)
        panel.set(xlabel="roll ξ of the force, °", title=f"camera {name}")
    panels[0].set(ylabel="distance off by, mm", ylim=(-8, 8))
    panels[0].legend(loc="upper left")
    save(figure, folder, __file__)
