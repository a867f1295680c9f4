"""Two trees of this repository on one machine: this one, and that of an older commit in an environment of its own."""

from __future__ import annotations

import io
import json
import os
import resource
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError, SolveError

ROOT = Path(__file__).resolve().parents[2]
_WORKER = Path(__file__).with_name("worker.py")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


VBAA = "import sys; from vbaa_calib.cli.main import main; sys.exit(main())"
"""What Python runs as the command `vbaa`."""


@dataclass(frozen=True)
class Ran:
    """What a command printed, and the processor time of it and its children, s."""

    said: str
    cpu_s: float


@dataclass(frozen=True)
class Tree:
    """A tree's name, the interpreter that runs it, and its folder."""

    name: str
    python: str
    folder: Path

    def started(self, *words: str, **how: Any) -> subprocess.Popen[str]:
        """Its interpreter, with numerical libraries on one thread: threads are what a job asks for."""
        environment = os.environ | dict.fromkeys(_THREADS, "1") | {"PYTHONPATH": str(self.folder)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # who has installed it has its modules compiled
        return subprocess.Popen([self.python, "-P", *words], env=environment, text=True, **how)

    def run(self, *words: str, cwd: Path | None = None) -> Ran:
        """A command to its end. Raises SolveError where it fails."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        process = self.started(*words, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        said, failure = process.communicate()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if process.returncode:
            raise SolveError(f"{self.name}: {' '.join(words)}: exit {process.returncode}: {failure.strip()[-300:]}")
        return Ran(said, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


HERE = Tree("this tree", sys.executable, ROOT)


def older(commit: str) -> Tree:
    """A commit's tree, taken out of the repository and installed once, in the user's cache.

    What it needs and this environment has is used from here, so that both trees run on the same NumPy, SciPy and
    OpenCV; the rest is installed beside it, and its compiled core built for this processor by what `make test`
    installs. Raises InputError where git, the commit, a package or a compiler is not to be had.
    """
    name = commit[:40]
    try:
        full = _output("git", "-C", str(ROOT), "rev-parse", "--verify", f"{commit}^{{commit}}").decode().strip()
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vbaa-calib" / "bench" / full
        tree, environment = Tree(name, str(cache / "environment/bin/python"), cache / "tree"), cache / "environment"
        packages = os.path.realpath(sysconfig.get_path("purelib"))
        made, made_for = cache / "made_for", f"{sys.version}\n{packages}"
        if made.is_file() and made.read_text() == made_for:
            return tree
        say(f"{name} is taken out of the repository and installed in {cache}, once")
        shutil.rmtree(cache, ignore_errors=True)
        archive = _output("git", "-C", str(ROOT), "archive", "--format=tar", full)
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(tree.folder, filter="data")
        venv.create(environment, symlinks=True)
        base = {"base": str(environment), "platbase": str(environment)}
        Path(sysconfig.get_path("purelib", vars=base), "as_here.pth").write_text(f"{packages}\n")
        needed = tomllib.loads((tree.folder / "pyproject.toml").read_text())["project"]["dependencies"]
        _output(tree.python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *needed)
        native, tools = tree.folder / "vbaa_calib/native", Path(sys.executable).parent
        if (native / "CMakeLists.txt").exists():
            found = [f"-DPython_EXECUTABLE={sys.executable}", f"-DCMAKE_MAKE_PROGRAM={tools / 'ninja'}"]
            configure = ["-S", str(native), "-B", str(native), "-G", "Ninja", "-DLEVELS=own"]
            _output(str(tools / "cmake"), *configure, *found)
            _output(str(tools / "cmake"), "--build", str(native))
        made.write_text(made_for)
    except (OSError, subprocess.CalledProcessError) as error:
        said = (getattr(error, "stderr", None) or b"").decode().strip()[-200:]
        what = f"the commit {name} cannot be run here: {said or error}"
        raise InputError(what, remedy="compare in a clone with its history, with git and pip") from None
    return tree


def _output(*words: str) -> bytes:
    return subprocess.run(words, capture_output=True, check=True).stdout


class Worker:
    """`worker.py` in a tree, which keeps what it has prepared."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self._process = tree.started(str(_WORKER), stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._process.communicate()

    def ask(self, **job: Any) -> dict[str, Any]:
        """A job prepared and counted, or without one the last one timed.

        Raises SolveError where the worker broke down.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(job), file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise SolveError(f"{self.tree.name}: the job {job} broke down, as said above")
        found: dict[str, Any] = json.loads(answer)
        return found
