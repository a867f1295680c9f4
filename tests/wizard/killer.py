"""Kills wizards from outside at random moments, and compares what they come to with one that lives.

Called as `python -m tests.wizard.killer PLAN.json`; writes what it found beside the plan. A process of its own, since
each wizard is a fork and the tests' own process has threads.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

from vbaa_calib.cli.main import main
from vbaa_calib.core.files import sha256
from vbaa_calib.wizard import flow

from .small_session import tree, unseen_conclude, unseen_steps


def life(root: Path, argv: Sequence[str], killed_after_s: float = 600.0) -> tuple[int, float, str]:
    """One wizard: its exit code (−9: killed), how long it lived, s, and what it said."""
    said, start_s = Path(f"{root}.said"), time.monotonic()
    # one that is killed before it opens the file must not be taken to have said what the one before did
    said.write_text("")
    child = os.fork()
    if not child:
        code = 99
        try:
            os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
            code = main(["wizard", str(root), *argv, "--batch"])
        finally:
            os._exit(code)
    done = status = 0
    while not done and time.monotonic() - start_s < killed_after_s:
        done, status = os.waitpid(child, os.WNOHANG)
        time.sleep(0.001)
    if not done:
        os.kill(child, signal.SIGKILL)
        status = os.waitpid(child, 0)[1]
    return os.waitstatus_to_exitcode(status), time.monotonic() - start_s, said.read_text()


def whole_life(root: Path, argv: Sequence[str]) -> float:
    """How long a wizard lives that comes to its end, s."""
    code, lived_s, said = life(root, argv)
    assert code == 0, said
    return lived_s


def lost(root: Path, said: str) -> tuple[int, list[str]]:
    """How many pictures were said to be taken; those that wizard.json does not name, or that are not whole."""
    lines = (line.split() for line in said.splitlines() if line.strip().startswith("took "))
    files = [words[words.index("as") + 1].rstrip(",") for words in lines]
    steps = json.loads((root / "wizard.json").read_text())["steps"].values() if files else ()
    named = {one["file"]: one["sha256"] for record in steps for one in record["taken"]}
    return len(files), [file for file in files if file not in named or sha256(root / file) != named[file]]


def by_hand(root: Path) -> None:
    """Make a wizard's session one that was made by hand: no wizard.json, a table with a column of its own."""
    (root / "wizard.json").unlink()
    header, *rows = (root / "noload" / "noload.csv").read_text().split()
    (root / "noload" / "noload.csv").write_text("\n".join([f"remark,{header}", *(f"x,{row}" for row in rows)]))


def killed(root: Path, plan: Mapping[str, Any]) -> dict[str, Any]:
    """Wizards that are killed at a moment drawn evenly from a whole life's time, until `kills` were."""
    rng, start = random.Random(plan["seed"]), Path(f"{root}-start")
    if "before" in plan:
        whole_life(root, plan["before"])
    if plan.get("by_hand"):
        by_hand(root)
    root.mkdir(exist_ok=True)
    shutil.copytree(root, start)
    whole_s, whole = whole_life(root, plan["argv"]), tree(root)
    kills, promises, broken, differing = 0, 0, list[str](), list[str]()
    while kills < plan["kills"]:
        shutil.rmtree(root)
        shutil.copytree(start, root)
        argv, code = plan["argv"], -signal.SIGKILL
        while code and kills < plan["kills"]:
            code, _, said = life(root, argv, rng.uniform(0.0, whole_s))
            assert code in (0, -signal.SIGKILL), said
            kills, argv = kills + (code != 0), plan.get("again", argv)
            count, gone = lost(root, said)
            promises, broken = promises + count, broken + gone
        whole_life(root, argv)
        last = tree(root)
        differing += [name for name in {*whole, *last} if whole.get(name) != last.get(name)]
    return {"kills": kills, "promises": promises, "broken": broken, "differing": differing, "tree": whole}


if __name__ == "__main__":
    plan_path = Path(sys.argv[1])
    plans = json.loads(plan_path.read_text())
    # syncing is for power cuts, which nothing here can show, and takes most of the time
    mock.patch.object(os, "fsync").start()
    if not plans.pop("seeing"):
        flow.STEP_BY_NAME.update(unseen_steps())
        mock.patch.object(flow, "conclude", unseen_conclude).start()
    found = {name: killed(plan_path.parent / name, plan) for name, plan in plans.items()}
    plan_path.with_suffix(".found.json").write_text(json.dumps(found))
