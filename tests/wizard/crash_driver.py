"""Runs a wizard that ends itself before its n-th lasting operation, for many n, each in a process of its own.

Called as `python -m tests.wizard.crash_driver PLAN.json`; writes what came of it beside the plan. A process of its own,
since the runs are forks and the tests' own process has threads.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vbaa_calib.cli.main import main
from vbaa_calib.files import sha256, write_json, write_text
from vbaa_calib.wizard import flow
from vbaa_calib.wizard.progress import Judged, Progress
from vbaa_calib.wizard.steps import verdict

from .small_session import tree

LASTING = ("os.rename", "os.mkdir", "os.remove", "os.chmod", "os.truncate")
KILLED = 9


def without_seeing() -> None:
    """Every picture is good but those named bad, every step has enough, the verdict is a file: what is left is fast."""

    def judge(known: Any, offered: Any, readings: Any) -> Judged:
        return Judged("is bad" if offered.name.startswith("bad") else "")

    def look(known: Any) -> Progress:
        return Progress(usable=True)

    def conclude(root: Path) -> dict[str, Any]:
        write_json(root / verdict.RIG, {"pictures": sorted(name for name in tree(root) if name.endswith(".png"))})
        write_text(root / verdict.REPORT, "report")
        return {"words": "done", "verdict": "trust", "session_findings": [], "findings": [], "numbers": {}}

    for name in ("lens", "plane", "noload", "loads"):
        flow.ALL[name] = replace(flow.ALL[name], judge=judge, look=look)
    flow.ALL["sensor"] = replace(flow.ALL["sensor"], look=look)
    setattr(verdict, "conclude", conclude)


def dying(root: Path, last: int) -> Callable[[], int]:
    """Ends this process before the operation number `last`; returns what counts the operations so far."""
    count, fsync = 0, os.fsync

    def step() -> None:
        nonlocal count
        count += 1
        if count == last:
            os._exit(KILLED)

    def hook(event: str, args: tuple[Any, ...]) -> None:
        writes = event == "open" and isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if (writes or event in LASTING) and str(args[0]).startswith(str(root)):
            step()

    def synced(handle: int) -> None:
        step()
        fsync(handle)

    sys.addaudithook(hook)
    setattr(os, "fsync", synced)
    return lambda: count


def forked(work: Callable[[], int], said: Path) -> int:
    """What `work` returns, done in a fork whose words go to a file; KILLED where it ended itself."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    code = 99
    try:
        handle = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(handle, 2)
        code = work()
    finally:
        os._exit(code)


def wizard(root: Path, argv: list[str], last: int = 0, count_to: Path | None = None) -> Callable[[], int]:
    """A wizard's run, which ends before its operation number `last` where that is not 0."""

    def work() -> int:
        counted = dying(root, last)
        code = main(["wizard", str(root), *argv, "--batch"])
        if count_to is not None:
            count_to.write_text(str(counted()))
        return code

    return work


def promised(said: str) -> list[str]:
    """Files, relative to the session, that a run said it took."""
    lines = (line.split() for line in said.splitlines() if line.strip().startswith("took "))
    return [words[words.index("as") + 1].rstrip(",") for words in lines]


def broken_promises(root: Path, said: str) -> list[str]:
    """Pictures that were said to be taken and are not in wizard.json, or not whole on the disk."""
    wanted = promised(said)
    if not wanted:
        return []
    steps = json.loads((root / "wizard.json").read_text())["steps"].values()
    named = {one["file"]: one["sha256"] for record in steps for one in record["taken"]}
    return [file for file in wanted if file not in named or sha256(root / file) != named[file]]


def deaths(plan: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """One entry per place of death: promises that were broken, and how the run that went on differs from `whole`."""
    start, root, said = Path(plan["start"]), Path(plan["root"]), Path(plan["root"] + ".said")

    def anew() -> None:
        shutil.rmtree(root, ignore_errors=True)
        if start.exists():
            shutil.copytree(start, root)

    anew()
    counted = said.with_suffix(".count")
    code = forked(wizard(root, plan["argv"], 0, counted), said)
    yield {"operations": int(counted.read_text()), "code": code, "said": said.read_text(), "tree": tree(root)}
    for last in range(1, int(counted.read_text()) + 1, plan.get("stride", 1)):
        anew()
        code = forked(wizard(root, plan["argv"], last), said)
        broken = broken_promises(root, said.read_text())
        again = forked(wizard(root, plan["again"]), said)
        yield {"last": last, "code": code, "broken": broken, "again": again, "said": said.read_text(), "tree": tree(root)}


if __name__ == "__main__":
    without_seeing()
    plan_path = Path(sys.argv[1])
    found = list(deaths(json.loads(plan_path.read_text())))
    plan_path.with_suffix(".found.json").write_text(json.dumps(found))
