"""A session calibrated from Python: the lens, every way to plane C, everything together, and what each is worth."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from drawing import BLUE, DARK, GREEN, ORANGE, canvas, figures_folder, save

from vbaa import calibrate, load_session
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.write import write_session

# With your own pictures this is a folder that exists. Here one is simulated: the scene that `vbaa simulate
# upright_knife` writes, with fewer pictures, joints whose axes are a little off, and two more ways to plane C.
MORE = """
kinematics: {axis_offset_m: 0.002, axis_skew_deg: 0.3, tilt_zero_deg: 0.25}
sweep: true
over: {height_m: 0.012, center_m: [0.13, 0.0], turn_deg: 8.0, pictures: 1}
"""
with tempfile.TemporaryDirectory() as folder:
    scene_yaml = Path(folder, "scene.yaml")
    scene_yaml.write_text(bundled_scene("upright_knife").read_text(encoding="utf-8") + MORE, encoding="utf-8")
    scene = load_scene(scene_yaml)
    stroke = replace(scene.recording.sweeps[0], frames=1, free_frames=0)
    few = replace(scene.intrinsics, pictures=12)
    scene = replace(scene, intrinsics=few, noload=scene.noload[:4], loads=scene.loads[::2], jig_pictures=2)
    scene = replace(scene, recording=replace(scene.recording, sweeps=(stroke,)))
    write_session(scene, Path(folder, "session"), recording_pictures=False)
    found = calibrate(load_session(Path(folder, "session")), "opencv4")

fx, fx_std = found.rig.camera.matrix[0, 0], np.sqrt(found.rig.camera.covariance[0, 0])
print(f"lens: fx = {fx:.2f} ± {fx_std:.2f} px (true {scene.lens.matrix[0, 0]:.2f})")

lens_covariance = found.lens.camera.covariance
poses = {}
for way in found.plane.estimates:
    by_lens = way.lens_sensitivity @ lens_covariance @ way.lens_sensitivity.T
    poses[way.way] = way.T_antenna_camera, way.covariance + by_lens
poses["together"] = found.rig.T_antenna_camera, found.rig.covariance[:6, :6]
off_mm, std_mm = {}, {}
for name, (pose, covariance) in poses.items():
    off_mm[name] = 1e3 * scene.T_antenna_camera.tangent_from(pose)[3:]
    std_mm[name] = 1e3 * np.sqrt(np.diag(covariance)[3:])
    words = ", ".join(f"{a} {o:+.2f} ± {s:.2f}" for a, o, s in zip("xyz", off_mm[name], std_mm[name], strict=True))
    print(f"camera by {name:<10} off by {words} mm")
for difference in found.plane.differences:
    print(difference)

stiffness = found.rig.antenna.stiffness_Nm2
std = stiffness * found.rig.std("log_stiffness_Nm2")
true = scene.antenna.stiffness_Nm2 * scene.true.stiffness_factor
print(f"EI = {1e3 * stiffness:.4f} ± {1e3 * std:.4f} mN·m² (true {1e3 * true:.4f})")

if folder := figures_folder():
    figure, panel = canvas(1, 3.0)
    for shift, axis, color in zip((-0.2, 0.0, 0.2), range(3), (BLUE, GREEN, ORANGE), strict=True):
        rows = np.arange(len(poses)) + shift
        errors, bars = ([v[axis] for v in values.values()] for values in (off_mm, std_mm))
        panel.errorbar(errors, rows, xerr=2 * np.array(bars), fmt="o", color=color, capsize=3, label="xyz"[axis])
    panel.axvline(0.0, color=DARK, linewidth=0.8)
    panel.set_yticks(range(len(poses)), list(poses))
    panel.invert_yaxis()
    panel.set_xscale("symlog", linthresh=0.2)
    panel.set(xlabel="camera's place off by, mm, and two deviations", title="what each way to plane C is worth")
    panel.legend(title="antenna frame", loc="lower left")
    save(figure, folder, __file__)
