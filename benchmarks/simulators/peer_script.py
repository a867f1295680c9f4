"""Lets exported antennas come to rest: `python peer_script.py SIMULATOR FILE`, a line of JSON in and out for a load.

It is started with the interpreter that has the simulator, so it imports NumPy and the simulator alone.

In: pan and tilt, rad; force_N [3] at the tip, world frame in MuJoCo, antenna frame in PyElastica.
Out, after "answer: ": tip_m [3] in the same frame, moment_Nm (null where the simulator has no sensor), seconds.
`contacts` in place of PyElastica: in at_m and force_N [2] there, along y and z of the straight rod, normal to the bent
one; out its nodes.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
import time
from types import ModuleType
from typing import Any

import numpy as np

_SETTLED_RAD_S, _MOST_STEPS, _MORE_DAMPING = 1e-6, 20_000, 60.0
_REST = 1e-6  # speed of a rod at rest, in lengths by the first mode's rad/s


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


def _exported(path: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location("exported", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _in_pyelastica(path: str, load: dict[str, Any]) -> tuple[np.ndarray, float | None]:
    return _exported(path).at_rest(load["force_N"])[-1], None


def _contacts(path: str) -> None:
    """One rod that goes on to each next load from where it is."""
    module: Any = _exported(path)
    ea, a = importlib.import_module("elastica"), module.ANTENNA
    rod, simulator, load = module.antenna(), module.Simulator(), {"at_m": a.length_m, "force_N": [0.0, 0.0]}
    element = a.length_m / (rod.n_elems - 0.5)

    def apply_forces(_: Any, system: Any, time: float = 0.0) -> None:
        """A force between two nodes, normal to the rod there."""
        place = min(load["at_m"] / element + 0.5, rod.n_elems - 1e-9)
        node, along = int(place), system.tangents[:, int(place)]
        straight = np.array([0.0, *load["force_N"]])
        force = straight - (straight @ along) * along
        force *= np.linalg.norm(straight) / max(float(np.linalg.norm(force)), 1e-30)
        for k, share in ((node, node + 1 - place), (node + 1, place - node)):
            system.external_forces[:, k] += share * force

    contact = type("Contact", (ea.NoForces,), {"apply_forces": apply_forces})
    step_s = 0.1 * element**2 * np.sqrt(a.mass_per_length_kg_m / a.bending_stiffness_Nm2)
    mode = 3.516 * np.sqrt(a.bending_stiffness_Nm2 / a.mass_per_length_kg_m) / a.length_m**2
    simulator.append(rod)
    simulator.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array(a.gravity_m_s2))
    simulator.add_forcing_to(rod).using(contact)
    simulator.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=1.5 * mode, time_step=step_s)
    simulator.finalize()
    stepper, time_s = ea.PositionVerlet(), 0.0
    for line in sys.stdin:
        load.update(json.loads(line))
        slow = 0
        for _ in range(int(25 / mode / step_s)):
            time_s = stepper.step(simulator, time_s, step_s)
            # at rest for a tenth of a swing
            still = np.abs(rod.velocity_collection).max() < _REST * a.length_m * mode
            slow = slow + 1 if still else 0
            if slow * step_s * mode > 0.6:
                break
        print(f"answer: {json.dumps(rod.position_collection.T.tolist())}", flush=True)


def main(simulator: str, path: str) -> None:
    """Answer every line of stdin."""
    if simulator == "contacts":
        return _contacts(path)
    rest = _in_mujoco if simulator == "mujoco" else _in_pyelastica
    for line in sys.stdin:
        begun = time.process_time()
        tip, moment = rest(path, json.loads(line))
        answer = {"tip_m": tip.tolist(), "moment_Nm": moment, "seconds": time.process_time() - begun}
        print(f"answer: {json.dumps(answer)}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
