# Everything on a fresh machine with Python >= 3.11 and make. `make demo` installs first what it needs, once, and
# `make test` the tools besides.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --no-compile --constraint constraints.txt
INSTALLED := $(VENV)/.runtime $(VENV)/.tools
# One thread per process: the arrays are small, and two workers share two cores.
export OMP_NUM_THREADS ?= 1
# What Python compiles is kept next to its source: the tests start hundreds of processes that load the same modules.
unexport PYTHONDONTWRITEBYTECODE
CXX_FILES := $(wildcard $(addprefix vbaa_calib/native/, *.?pp src/*.?pp src/*/*.?pp))
CORE := $(CXX_FILES) vbaa_calib/native/CMakeLists.txt vbaa_calib/native/build.py
CONFIGURE := $(BIN)/cmake -S vbaa_calib/native -G Ninja -DPython_EXECUTABLE=$(abspath $(BIN)/python)

.PHONY: demo test test-slow fuzz kills sanitize processors docs docs-pictures sbom lint install gl clean
.DEFAULT_GOAL := test

install: $(INSTALLED)

# with the compiled core, which is built anew where its sources changed
$(VENV)/.runtime: pyproject.toml constraints.txt $(CORE)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python >= 3.11 is needed: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python vbaa_calib/native/build.py view
	@touch $@

# of the package that is installed: adds others and changes none
$(VENV)/.tools: $(VENV)/.runtime
	$(PIP) 'vbaa-calib[dev]'
	@touch $@

# VTK renders without a screen through EGL; where we may, we install it, elsewhere `vbaa` says what is missing.
gl: $(VENV)/.runtime
	@$(BIN)/python -m viz.render.probe || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
	  && apt-get update -qq && apt-get install -y -qq --no-install-recommends libegl1 libgl1-mesa-dri; } \
	  || echo "no 3-D pictures here: install libegl1 and libgl1-mesa-dri"

demo: $(VENV)/.runtime gl
	$(BIN)/vbaa demo --out demo --force

# files in the order of their names: short ones come last, so that no worker ends long after the other
test: $(INSTALLED) gl
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m 'not slow'

# the long Monte-Carlo runs too, of which the other tests hold seeded subsets: an hour
test-slow: $(INSTALLED) gl
	$(BIN)/python -m pytest -n 2 --dist loadfile

# a million files changed at random, and every reader on them: two hours; what breaks one is kept in tests/fuzz/seeds
fuzz: $(INSTALLED)
	$(BIN)/python -m tests.fuzz.fuzz --runs 1000000 --report fuzz.md

# two thousand kills of the verbs that write: half an hour
kills: $(INSTALLED)
	$(BIN)/python -m tests.cli.killer --kills 2000

# the same answers as on other processors? twenty minutes; with PHOTOGRAPHS=DIR the real sets' lenses, too
processors: $(INSTALLED)
	$(CONFIGURE) -B vbaa_calib/native '-DLEVELS=base;v3;v4' >/dev/null
	$(BIN)/cmake --build vbaa_calib/native
	$(BIN)/python -m benchmarks.processors --page benchmarks/processors.md $(if $(PHOTOGRAPHS),--photographs $(PHOTOGRAPHS))

# the documentation as a site: docs/_build/index.html
docs: $(INSTALLED)
	$(BIN)/python -m sphinx -W --keep-going -n -q -j auto -b html docs docs/_build

# the documentation's pictures, of a demo of this release; needs chromium
docs-pictures: $(INSTALLED) gl
	$(BIN)/python docs/drawings.py
	$(BIN)/python docs/pictures.py

# every package that is needed, with its version and licence: sbom.json (CycloneDX); EXTRAS="dev" for those, too
sbom: $(INSTALLED)
	$(BIN)/python docs/sbom.py sbom.json $(EXTRAS)

# clang-tidy reads each file as the compiler does, the bindings as one
TIDY := printf '%s\n' build/tidy/CMakeFiles/bindings.dir/Unity/unity_0_cxx.cxx \
  $(filter-out vbaa_calib/native/src/bindings/%, $(filter %.cpp, $(CXX_FILES))) \
  | xargs -P 2 -n 4 $(BIN)/clang-tidy -p build/tidy --quiet
build/tidy/compile_commands.json: $(VENV)/.tools vbaa_calib/native/CMakeLists.txt
	$(CONFIGURE) -B build/tidy -DLEVELS=base -DCMAKE_EXPORT_COMPILE_COMMANDS=ON >/dev/null

lint: $(VENV)/.tools build/tidy/compile_commands.json
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run --Werror $(CXX_FILES)
	$(TIDY) --checks=-clang-analyzer-*

TOUCHING := tests/camera tests/antenna tests/detect tests/synth tests/test_native.py \
  tests/estimator/test_solve_oracle.py
# the core by Clang's analyzer, then under sanitizers the tests that touch it: half an hour
sanitize: $(INSTALLED) build/tidy/compile_commands.json
	$(TIDY)
	$(CONFIGURE) -B build/sanitized -DSANITIZE=address,undefined,float-cast-overflow -DMODULES=$(abspath vbaa_calib/native) >/dev/null
	$(BIN)/cmake --build build/sanitized
	LD_PRELOAD="$$(c++ -print-file-name=libasan.so) $$(c++ -print-file-name=libstdc++.so)" ASAN_OPTIONS=detect_leaks=0 \
	  VBAA_PROCESSOR=sanitized $(BIN)/python -m pytest -n 2 --dist loadfile -m 'not slow' $(TOUCHING)

clean:
	rm -rf $(VENV) build $(addprefix vbaa_calib/native/, CMakeFiles CMakeCache.txt base v3 v4 sanitized) demo docs/_build .pytest_cache .mypy_cache .ruff_cache
