"""Builds the compiled core for this machine in a checkout and installs the package on it: what `make install` runs.

    python vbaa_calib/native/build.py [EXTRAS]

Tools that the machine lacks come from PyPI into `.venv/build`: CMake, Ninja and, where there is no C++ compiler, zig's.
CXX names a compiler. The full output is in `.venv/build/log.txt`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TOOLS = Path(sys.prefix) / "build"
LOG = TOOLS / "log.txt"


def main() -> None:
    """Build and install, printing a line before and one after."""
    begin = time.perf_counter()
    TOOLS.mkdir(exist_ok=True)
    LOG.write_text("")
    wanted = ["scikit-build-core", "nanobind"]
    wanted += [name for name, least in (("cmake", (3, 25)), ("ninja", (1, 10))) if _version(name) < least]
    named = os.environ.get("CXX")
    compiler = next(filter(_compiles, [named] if named else ["c++", "g++", "clang++"]), None)
    if named and compiler is None:
        sys.exit(f"CXX={named} makes no modules of C++17: name another compiler, or unset it")
    if compiler is None:
        wanted.append("ziglang")
    # those that are there stay: with other headers everything would be built anew
    if missing := [name for name in wanted if not any(TOOLS.glob(f"{name.replace('-', '_')}*"))]:
        _pip("install", "--quiet", "--upgrade", "--target", TOOLS, *missing)
    print(f"building the compiled core with {compiler or 'zig, two minutes the first time'} …", flush=True)
    variables = {
        "PYTHONPATH": str(TOOLS),
        "PATH": os.pathsep.join([str(TOOLS / "bin"), os.environ["PATH"]]),
        "CMAKE_GENERATOR": "Ninja",
        "CMAKE_ARGS": f"{os.environ.get('CMAKE_ARGS', '')} -DLEVELS=own",
    }
    variables |= _zig(variables["CMAKE_ARGS"]) if compiler is None else {"CXX": compiler}
    # what another compiler left cannot be gone on with
    cache = ROOT / "vbaa_calib" / "native" / "CMakeCache.txt"
    if cache.exists() and f"={shutil.which(variables['CXX'])}\n" not in cache.read_text():
        shutil.rmtree(cache.with_name("CMakeFiles"))
        cache.unlink()
    extras = f"[{sys.argv[1]}]" if len(sys.argv) > 1 else ""
    _pip("install", "--no-build-isolation", "--no-deps", "--editable", ROOT, **variables)
    # without the tools on the path, which would count as installed
    _pip("install", f"vbaa-calib{extras}")
    # plain paths: with an import hook PYTHONPATH would not count, and every start be slower
    for hook in Path(sysconfig.get_path("purelib")).glob("_editable_skbc_vbaa_calib.pth"):
        hook.write_text(f"{ROOT}\n")
    print(f"built in {time.perf_counter() - begin:.0f} s", flush=True)


def _pip(*words: object, **variables: str) -> None:
    command = [sys.executable, "-m", "pip", "--no-input", *map(str, words)]
    if words[0] == "install":
        command += ["--no-compile", "--constraint", str(ROOT / "constraints.txt")]
    with LOG.open("a") as log:
        done = subprocess.run(command, env=os.environ | variables, stdout=log, stderr=subprocess.STDOUT, check=False)
    if done.returncode:
        sys.exit(f"the compiled core could not be built: see the end of {LOG}; CXX=… names another compiler")


def _compiles(compiler: str) -> bool:
    """Whether the compiler exists and builds a C++17 module."""
    source = "#include <vector>\nusing V = double __attribute__((vector_size(64)));\nstd::vector<double> v;\n"
    command = [compiler, "-std=c++17", "-shared", "-fPIC", "-x", "c++", "-", "-o", str(TOOLS / "trial.so")]
    try:
        return not subprocess.run(command, input=source, text=True, capture_output=True, check=False).returncode
    except OSError:
        return False


def _version(tool: str) -> tuple[int, ...]:
    """Version of a tool of this machine; () where it is missing."""
    if not shutil.which(tool):
        return ()
    words = subprocess.run([tool, "--version"], capture_output=True, text=True, check=False).stdout
    return tuple(map(int, re.findall(r"\d+", words)[:2]))


def _zig(arguments: str) -> dict[str, str]:
    """Environment variables that make CMake use zig, through scripts with the names of its tools."""
    folder = TOOLS / "bin"
    for name in ("c++", "cc", "ar", "ranlib"):
        script = folder / f"zig-{name}"
        # by itself it compiles for this machine's processor, its C++ library too
        flags = " -mcpu=baseline" if name.startswith("c") else ""
        script.write_text(f'#!/bin/sh\nexec "{TOOLS}/ziglang/zig" {name}{flags} "$@"\n')
        script.chmod(0o755)
    archives = f"-DCMAKE_AR={folder}/zig-ar -DCMAKE_RANLIB={folder}/zig-ranlib"
    return {
        "CXX": str(folder / "zig-c++"),
        "CC": str(folder / "zig-cc"),
        "CMAKE_ARGS": f"{arguments} {archives}",
        "ZIG_GLOBAL_CACHE_DIR": str(TOOLS / "zig-cache"),
    }


if __name__ == "__main__":
    main()
