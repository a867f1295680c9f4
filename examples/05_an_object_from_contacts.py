"""An object from contacts: the antenna strokes a ball there and back; the result is its shape, normals and friction."""

import numpy as np
from drawing import BLUE, DARK, GREY, ORANGE, canvas, figures_folder, save

from benchmarks.estimator.setup import Setup
from benchmarks.object.scenes import contacts, record
from vbaa import estimate_object
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Sweep

# A ball below a rig whose calibration is as good as usual. The tilt presses, the pan strokes: across the antenna, since
# friction along it is hardly seen, and both ways, since an error of the normals then cancels.
rig = Setup(real=True, exact=False, tilt_rad=0.5).rig()
ball = TouchObject("sphere", np.array([0.16, 0.0, -0.05]), np.zeros(3), 0.04, 0.04, friction=0.3)
there, back = (
    Sweep(
        press="tilt",
        toward=-1,
        sweep_rad=(-way, way),
        frames=25,
        push_rad=(0.05, 0.08),
        swells=1.5,
        free_frames=6,
        clearance_rad=0.05,
    )
    for way in (0.12, -0.12)
)
recording = record(rig, ball, [there, back], np.random.default_rng(1))

# With real pictures the table is read_contacts("contacts.csv") of `vbaa estimate`, and the rig is Rig.load("rig.json").
estimate = estimate_object(contacts(recording), rig)

friction, surface = estimate.friction, estimate.surface
print(f"friction {friction.mu:.3f} ± {friction.std:.3f} (true 0.3), {friction.reason}")
off = np.linalg.norm(surface.touched_m - ball.center_world_m, axis=1) - ball.radius_m
print(
    f"surface off by {1e3 * np.sqrt(np.mean(off**2)):.2f} mm rms; std {1e3 * np.median(surface.touched_std_m):.2f} mm"
)
true = recording.truth.normal_world[surface.touched_row]  # where it was touched, not where it seems to have been
lean = np.degrees(np.arccos(np.clip((true * estimate.normals.normal).sum(axis=1), -1.0, 1.0)))
print(f"normals off by {np.median(lean):.1f}°; std {np.degrees(np.median(estimate.normals.std_rad)):.1f}°")
print(f"stiffness: {estimate.compliance.reason}")
for event in estimate.track.events[:4]:
    print(" ", event.words)

if folder := figures_folder():
    figure, (left, right) = canvas(2)
    touched, center = 1e3 * surface.touched_m, 1e3 * ball.center_world_m
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    left.plot(center[1] + 40 * np.cos(turn), center[2] + 40 * np.sin(turn), color=GREY, label="the ball")
    left.plot(touched[:, 1], touched[:, 2], ".", color=BLUE, label="touched")
    left.quiver(
        *touched[::4, 1:].T, *estimate.normals.normal[::4, 1:].T, color=ORANGE, width=0.006, scale=12, label="normals"
    )
    left.set(
        xlabel="Y, mm", ylabel="Z, mm", xlim=(-30, 30), ylim=(-22, 4), title="seen along the antenna", aspect="equal"
    )
    height = np.linalg.norm(surface.touched_m - ball.center_world_m, axis=1) - ball.radius_m
    std = surface.touched_std_m
    right.errorbar(touched[:, 1], 1e3 * height, 2e3 * std, fmt=".", color=BLUE, ecolor=GREY, label="two deviations")
    right.axhline(0.0, color=DARK, linewidth=0.8)
    right.set(xlabel="Y, mm", ylabel="above the true surface, mm", title="the surface")
    left.legend()
    right.legend()
    save(figure, folder, __file__)
