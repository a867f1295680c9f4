"""Lets exported antennas come to rest: `python peer_script.py SIMULATOR FILE`, a line of JSON in and out for a load.

It is started with the interpreter that has the simulator, so it imports NumPy and the simulator alone.

In: pan and tilt, rad; force_N [3] at the tip, world frame in MuJoCo, antenna frame in PyElastica.
Out, after "answer: ": tip_m [3] in the same frame, moment_Nm (null where the simulator has no sensor), seconds.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
import time
from typing import Any

import numpy as np

_SETTLED_RAD_S, _MOST_STEPS, _MORE_DAMPING = 1e-6, 20_000, 60.0


def _in_mujoco(path: str, load: dict[str, Any]) -> tuple[np.ndarray, float]:
    mujoco = importlib.import_module("mujoco")  # which checkers do not have

    model = mujoco.MjModel.from_xml_path(path)
    model.dof_damping[model.jnt_stiffness > 0] *= _MORE_DAMPING  # to its rest sooner
    data, tip = mujoco.MjData(model), model.site("tip").id
    body, force = model.site_bodyid[tip], np.array(load["force_N"])
    for name in ("pan", "tilt"):
        data.joint(name).qpos = load[name]
        data.actuator(name).ctrl = load[name]
    for step in range(_MOST_STEPS):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        data.xfrc_applied[body] = [*force, *np.cross(data.site_xpos[tip] - data.xipos[body], force)]
        mujoco.mj_step(model, data)
        if step > 200 and np.abs(data.qvel).max() < _SETTLED_RAD_S:
            break
    mujoco.mj_forward(model, data)
    return data.site_xpos[tip].copy(), float(data.sensor("moment").data[1])


def _in_pyelastica(path: str, load: dict[str, Any]) -> tuple[np.ndarray, float | None]:
    spec = importlib.util.spec_from_file_location("exported", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.at_rest(load["force_N"])[-1], None


def main(simulator: str, path: str) -> None:
    """Answer every line of stdin."""
    rest = _in_mujoco if simulator == "mujoco" else _in_pyelastica
    for line in sys.stdin:
        begun = time.process_time()
        tip, moment = rest(path, json.loads(line))
        answer = {"tip_m": tip.tolist(), "moment_Nm": moment, "seconds": time.process_time() - begun}
        print(f"answer: {json.dumps(answer)}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
