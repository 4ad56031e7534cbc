# `make run` on a fresh machine sets up .venv, then simulates. `make help` lists the rest.
# Needs Python 3.10 to 3.13 with its headers, a C++ compiler and the package registry; no ROS installation, no root.

VENV ?= .venv
first_scene := config/scenes/field_swing_brittle.yaml
# A first picture in little time: larger particles, ground laid from smaller blocks, and seconds enough for three cycles of
# the shank. Another SCENE runs as it is written.
first_flags := --preset coarse --set duration_s=2.1 --set soil.bed.tile_m=0.3
SCENE ?= $(first_scene)
OUT ?= runs/$(shell date +%Y%m%d-%H%M%S)
# The soil takes as many threads as there are cores, four at most: the results are the same bits.
RUN_FLAGS ?= --threads $(shell n=$$(nproc 2>/dev/null || echo 1); test $$n -le 4 || n=4; echo $$n) \
	$(if $(filter $(first_scene),$(SCENE)),$(first_flags))
PYTEST_FLAGS ?=

# A candidate counts when it runs: version managers leave stand-ins on the path that only print an error.
python_fits = $(shell $(1) -c 'import ensurepip, sys, venv; print((3, 10) <= sys.version_info < (3, 14))' 2>/dev/null)
first_python = $(if $(1),$(if $(filter True,$(call python_fits,$(firstword $(1)))),$(firstword $(1)),$(call \
	first_python,$(wordlist 2,$(words $(1)),$(1)))))
PYTHON ?= $(call first_python,python3.12 python3.11 python3.13 python3.10 python3)

prefix := $(abspath $(VENV))
bin := $(prefix)/bin
out := $(OUT)
stamp := $(prefix)/.set-up-
set_up := $(stamp)subsoil $(stamp)kernels

# Another ROS or Python environment must not mix with this one: its folders would come first.
ifneq (,$(AMENT_PREFIX_PATH)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE))
unexport LD_LIBRARY_PATH
endif
unexport PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Else each of the ten processes of a first run would compile all its Python modules anew: 10 s each.
unexport PYTHONDONTWRITEBYTECODE
export PATH := $(bin):$(PATH)
export VIRTUAL_ENV := $(prefix)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# rclpy, numba and matplotlib want a home to write to.
ifneq (yes,$(shell test -n "$$HOME" -a -d "$$HOME" -a -w "$$HOME" && echo yes))
export HOME := $(prefix)/home
endif

# Kernels are compiled beside the messages, also where make was not told how many jobs it may have.
jobs = $(if $(findstring jobserver,$(MAKEFLAGS)),,-j3)
ros_prefix := AMENT_PREFIX_PATH=$(prefix) CMAKE_PREFIX_PATH=$(prefix)
pip := $(bin)/python -m pip
# A worker for each core, 2 to 4: many tests start several processes.
pytest := $(bin)/python -m pytest -n $(shell n=$$(nproc 2>/dev/null || echo 2); test $$n -ge 2 || n=2; \
	test $$n -le 4 || n=4; echo $$n) --dist loadfile

.DEFAULT_GOAL := setup
.PHONY: setup setup-extras setup-test setup-check setup-docs run test test-quick test-full validate fuzz check format colcon \
	wheels docs docs-version test-kilted bench clean help

setup:  ## make .venv for run and report: ROS 2 Jazzy, subsoil_msgs, subsoil_ros, first kernels
	@$(MAKE) --no-print-directory $(jobs) $(set_up)

setup-extras: setup  ## add what subsoil render, sweep, study and run --live need
	@$(MAKE) --no-print-directory $(stamp)extras

setup-test: setup  ## add what tests need
	@$(MAKE) --no-print-directory $(stamp)test

setup-check: setup  ## add what tests and checks need
	@$(MAKE) --no-print-directory $(stamp)check

setup-docs: setup  ## add what the documentation as a site needs
	@$(MAKE) --no-print-directory $(stamp)docs

run: setup  ## simulate SCENE (field_swing_brittle, 2.1 s) into OUT (runs/<time>), and write its report.html
	$(bin)/subsoil run $(SCENE) --out $(out) $(RUN_FLAGS)
	$(bin)/subsoil report $(out) --html

test: setup-test  ## the tests that tell most for their time, files on 2 to 4 workers
	$(bin)/python -m dev.warm_kernels --tests
	$(pytest) -m "not full" --costs=build/test_costs.json $(PYTEST_FLAGS)

test-quick: setup-test  ## tests/unit: no process, few kernels
	$(pytest) tests/unit -m "not full" $(PYTEST_FLAGS)

test-full: setup-test  ## all tests
	$(bin)/python -m dev.warm_kernels --tests
	$(pytest) $(PYTEST_FLAGS)

validate: setup-test  ## the tables of validation/ that check themselves, before a release; long
	$(bin)/python -m validation
	$(bin)/python -m validation.flow_function
	$(bin)/python -m validation.wide_blade

fuzz: setup-test  ## 20,000 random cases of each fuzzer, of which the tests draw a few hundred; hours
	$(bin)/python -m dev.fuzz

check: setup-check  ## style, types, layers, and that no test file costs too much
	$(bin)/ruff check .
	$(bin)/ruff format --check .
	$(bin)/python -m mypy
	$(bin)/lint-imports
	$(bin)/python -m tests.costs build/test_costs.json

format: setup-check  ## put the sources in the style that check wants
	$(bin)/ruff check --fix .
	$(bin)/ruff format .

colcon: setup-test  ## build both packages as a ROS 2 workspace into build/ and install/
	$(ros_prefix) $(bin)/colcon build --base-paths . msg_defs

wheels: setup-test  ## wheels of both packages into build/wheels
	rm -rf build/lib build/bdist.*  # setuptools would pack what an older build left there
	$(ros_prefix) $(pip) wheel --quiet --no-build-isolation --no-deps --wheel-dir build/wheels . ./msg_defs

docs: setup-docs  ## documentation as a site into build/site, strictly
	NO_MKDOCS_2_WARNING=1 $(bin)/python -m mkdocs build --strict

docs-version: setup-docs  ## documentation of this version beside those of others, on the branch gh-pages
	PYTHONPATH=. NO_MKDOCS_2_WARNING=1 $(bin)/mike deploy --update-aliases \
		$$(sed -n 's/^__version__ = "\([0-9]*\.[0-9]*\).*/\1/p' subsoil_ros/_version.py) latest

test-kilted: setup  ## the same run under ROS 2 Jazzy and Kilted: the same bits? 5 min the first time
	$(bin)/python -m dev.two_distributions build/kilted

bench: setup-test  ## cost of engines and lockstep, beside the peers that are installed; tens of minutes
	$(bin)/python -m benchmarks.soil
	$(bin)/python -m benchmarks.peers.compare
	$(bin)/python -m benchmarks.peers.plate_drag
	$(bin)/python -m benchmarks.mechanism
	$(bin)/python -m benchmarks.lockstep

clean:  ## remove .venv and all that was built; runs/ stays
	rm -rf $(VENV) build install log *.egg-info .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(stamp)packages: requirements/run.txt requirements/lock.txt
	@test -n "$(PYTHON)" || { echo "No Python 3.10 to 3.13 with venv found. Install one (Debian: python3-venv)," \
		"or name it: make PYTHON=/path/to/python3" >&2; exit 2; }
	@test "$(call python_fits,$(PYTHON))" = True || { echo "PYTHON=$(PYTHON) does not run, or is not Python 3.10 to" \
		"3.13 with venv. Name another, or leave PYTHON out." >&2; exit 2; }
	@command -v c++ >/dev/null || command -v g++ >/dev/null || command -v clang++ >/dev/null || { echo "No C++" \
		"compiler found; subsoil_msgs is compiled. Install one (Debian: g++)." >&2; exit 2; }
	@test -f "$$($(PYTHON) -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h" || { echo "$(PYTHON)" \
		"has no Python.h; subsoil_msgs is compiled. Install its headers (Debian: python3-dev)." >&2; exit 2; }
	$(PYTHON) -m dev.set_up environment $(prefix)
	@touch $@

$(stamp)messages: $(stamp)packages requirements/build.txt \
		$(wildcard msg_defs/* msg_defs/msg/*.msg msg_defs/srv/*.srv msg_defs/action/*.action)
	$(bin)/python -m dev.set_up messages
	@touch $@

# Editable: a change of Python sources needs no new set-up. Launch files, scenes and meshes are copied to share/.
$(stamp)subsoil: $(stamp)messages setup.py setup.cfg package.xml \
		$(wildcard resource/* scripts/* launch/*.launch.py config/*.json config/scenes/*.yaml config/templates/*.yaml \
		config/meshes/*.stl config/soils/*.yaml config/calibration/*.yaml config/materials/*.yaml config/presets/*.yaml config/references/*.yaml config/studies/*.yaml config/foxglove/*.json)
	$(bin)/python -m dev.set_up subsoil
	@touch $@

# Looks at the sources only when they change; what is in the user's cache already is not compiled again. Beside the
# messages, but after them where older ones are installed: it records a run.
$(stamp)kernels: $(stamp)packages $(wildcard $(stamp)messages) dev/warm_kernels.py \
		$(shell find subsoil_ros/dem subsoil_ros/mbd -name '*.py')
	$(bin)/python -m dev.set_up kernels
	@touch $@

$(stamp)extras: $(stamp)packages requirements/extras.txt
	$(bin)/python -m dev.set_up packages extras
	@touch $@

$(stamp)test: $(stamp)packages $(patsubst %,requirements/%.txt,build extras test)
	$(bin)/python -m dev.set_up packages build extras test
	@touch $@

$(stamp)check: $(stamp)test requirements/check.txt
	$(bin)/python -m dev.set_up packages check
	@touch $@

$(stamp)docs: $(stamp)packages requirements/docs.txt
	$(bin)/python -m dev.set_up packages docs
	@touch $@
