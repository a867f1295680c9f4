"""What a wizard leaves behind when it is killed, at every moment of a run, and what becomes of it afterwards.

Called as `python -m tests.wizard.crash_driver PLAN.json`; writes what it found beside the plan. A process of its own,
since each run is a fork and the tests' own process has threads.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

from vbaa_calib.cli.main import main
from vbaa_calib.core.files import sha256
from vbaa_calib.wizard import flow
from vbaa_calib.wizard.steps import verdict

from .small_session import tree, unseen_conclude, unseen_steps

LASTING = ("os.rename", "os.mkdir", "os.remove", "os.chmod", "os.truncate")
TEMPORARY = re.compile(r"-[a-z0-9_]{8}(?=\.\w+$)")


def watched(root: Path, moments: Path, said: Path, which: slice) -> None:
    """From now on, before each operation in `root` that lasts, keep what a kill at that moment would leave behind.

    moments : new folder of numbered copies, each with what had been said until then. which : of those that differ.
    """
    seen: set[tuple[tuple[str, str], ...]] = set()

    def keep() -> None:
        state = tuple(sorted((TEMPORARY.sub("-", name), digest) for name, digest in tree(root, "").items()))
        if state not in seen:
            seen.add(state)
            if len(seen) - 1 not in range(which.start, len(seen), which.step):
                return
            shutil.copytree(root, moments / f"{len(seen):04d}" / "session")
            shutil.copy(said, moments / f"{len(seen):04d}" / "said")

    def hook(event: str, args: tuple[Any, ...]) -> None:
        writes = event == "open" and isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if (writes or event in LASTING) and Path(str(args[0])).is_relative_to(root) and root.exists():
            keep()

    # syncing is for power cuts, which nothing here can show, and takes most of the time
    mock.patch.object(os, "fsync", side_effect=lambda handle: keep()).start()
    sys.addaudithook(hook)


def failing(root: Path, number: int, first: int) -> None:
    """From its operation `first` on, nothing can be written into `root`: the disk is full, or read-only."""
    count = 0

    def fail(path: object) -> None:
        nonlocal count
        count += 1
        if count >= first:
            raise OSError(number, os.strerror(number), str(path))

    def hook(event: str, args: tuple[Any, ...]) -> None:
        writes = event == "open" and isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if writes and Path(str(args[0])).is_relative_to(root):
            fail(args[0])

    # a full disk may tell so late
    mock.patch.object(os, "fsync", side_effect=lambda handle: fail(root)).start()
    sys.addaudithook(hook)


def forked(work: Callable[[], int], said: Path) -> int:
    """What `work` returns, done in a fork whose words go to a file."""
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


def wizard(
    root: Path,
    argv: Sequence[str],
    moments: tuple[Path, slice] | None = None,
    fault: tuple[int, int] | None = None,
) -> tuple[int, str]:
    """A wizard's run: its exit code and what it said. moments : for `watched`. fault : errno and operation."""
    said = Path(f"{root}.said")

    def work() -> int:
        mock.patch.object(os, "fsync").start()
        if moments is not None:
            watched(root, moments[0], said, moments[1])
        if fault is not None:
            failing(root, *fault)
        return main(["wizard", str(root), *argv, "--batch"])

    return forked(work, said), said.read_text()


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


def ends(plan: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """First the run that nothing ended, then one entry per moment: broken promises, and how it ended when gone on."""
    root, moments = Path(plan["root"]), Path(plan["root"] + "-moments")
    shutil.rmtree(moments, ignore_errors=True)
    for argv in plan.get("before", ()):
        code, said = wizard(root, argv)
        assert code == 0, said
    if plan.get("by_hand"):
        forget_the_wizard(root)
    code, said = wizard(root, plan["argv"], (moments, slice(plan["first"], None, plan["stride"])))
    yield {"code": code, "said": said, "tree": tree(root)}
    for moment in sorted(moments.iterdir()):
        shutil.rmtree(root)
        shutil.copytree(moment / "session", root)
        broken = broken_promises(root, (moment / "said").read_text())
        code, said = wizard(root, plan["again"])
        yield {"moment": moment.name, "broken": broken, "code": code, "said": said, "tree": tree(root)}


def forget_the_wizard(root: Path) -> None:
    """Make a session as if by hand of a wizard's: no wizard.json, and a table with a column of its own."""
    (root / "wizard.json").unlink()
    header, *rows = (root / "noload" / "noload.csv").read_text().split()
    (root / "noload" / "noload.csv").write_text("\n".join([f"remark,{header}", *(f"x,{row}" for row in rows)]))


def faults(plan: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """As `ends`, with a disk that fails from some operation on instead of a kill."""
    root, first, code = Path(plan["root"]), plan["first"] + 1, 1
    whole, said = wizard(root, plan["argv"])
    yield {"code": whole, "said": said, "tree": tree(root)}
    while code:
        shutil.rmtree(root)
        code, failed = wizard(root, plan["argv"], fault=(plan["errno"], first))
        broken = broken_promises(root, failed)
        again, said = wizard(root, plan["argv"])
        yield {"moment": first, "fault": code, "failed": failed, "broken": broken} | {
            "code": again,
            "said": said,
            "tree": tree(root),
        }
        first += plan["stride"]


if __name__ == "__main__":
    flow.STEP_BY_NAME.update(unseen_steps())
    mock.patch.object(verdict, "conclude", unseen_conclude).start()
    plan_path = Path(sys.argv[1])
    found = [list((faults if "errno" in plan else ends)(plan)) for plan in json.loads(plan_path.read_text())]
    plan_path.with_suffix(".found.json").write_text(json.dumps(found))
