"""Kills wizards from outside at random moments until they were killed often enough, and compares how they end.

Called as `python -m tests.wizard.kill_driver PLAN.json`; writes what it found beside the plan.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest import mock

from vbaa_calib.cli.main import main
from vbaa_calib.wizard import flow
from vbaa_calib.wizard.steps import verdict

from .crash_driver import broken_promises, promised
from .small_session import tree, unseen_conclude, unseen_steps


def life(root: Path, argv: Sequence[str], killed_after_s: float) -> tuple[int, float, str]:
    """One wizard in a process of its own: its exit code (−9: killed), how long it lived, s, and what it said."""
    said, start_s = Path(f"{root}.said"), time.monotonic()
    child = os.fork()
    if not child:
        code = 99
        try:
            os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
            code = main(["wizard", str(root), *argv, "--batch"])
        finally:
            os._exit(code)
    while time.monotonic() - start_s < killed_after_s:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), time.monotonic() - start_s, said.read_text()
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return code, time.monotonic() - start_s, said.read_text()


def killed(root: Path, argv: Sequence[str], kills: int, seed: int) -> dict[str, Any]:
    """Flows of which each life ends at a moment drawn evenly from a whole flow's time, until `kills` were killed."""
    rng, done = random.Random(seed), 0
    code, whole_s, said = life(root, argv, 600.0)
    assert code == 0, said
    whole, flows, broken, differing, promises = tree(root), 0, list[str](), list[str](), 0
    shutil.rmtree(root)
    while done < kills:
        code, _, said = life(root, argv, rng.uniform(0.0, whole_s))
        done += code == -signal.SIGKILL
        assert code in (0, -signal.SIGKILL), said
        promises += len(promised(said))
        broken += broken_promises(root, said)
        if code == 0 or done == kills:
            code, _, said = life(root, argv, 600.0)
            assert code == 0, said
            last = tree(root)
            differing += [name for name in {*whole, *last} if whole.get(name) != last.get(name)]
            flows += 1
            shutil.rmtree(root)
            print(f"{done} kills, {flows} flows, {promises} pictures promised, {len(broken)} lost", flush=True)
    found = {"kills": done, "flows": flows, "whole_s": whole_s, "promises": promises}
    return found | {"broken": broken, "differing": differing}


if __name__ == "__main__":
    plan_path = Path(sys.argv[1])
    plan = json.loads(plan_path.read_text())
    if not plan["seeing"]:
        flow.STEP_BY_NAME.update(unseen_steps())
        mock.patch.object(verdict, "conclude", unseen_conclude).start()
    result = killed(Path(plan["root"]), plan["argv"], plan["kills"], plan["seed"])
    plan_path.with_suffix(".found.json").write_text(json.dumps(result))
