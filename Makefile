# make setup | run | test | test-slow | test-nightly | test-kernel | test-ros2 | gates | gates-full | safety-coverage | check | reference | results | site | wheel | release | mutation
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Collecting all the others takes half a minute.
SLOW_FILES = $(shell grep -rl "mark\.slow" tests --include "test_*.py" --exclude-dir bench)
STAMP := $(VENV)/.installed

.PHONY: setup run test test-slow test-nightly test-kernel test-ros2 gates gates-full safety-coverage check reference results site wheel release mutation

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[bench,cluster,export,fit,flight,fmi,live,mf4,rosbag,tune]" --group dev
	# Numba fails on what it compiled from classes that have another name now.
	find sim_backends tests -name '*.nb[ci]' -delete
	$(BIN)/python .ci/compile_simulators.py
	touch $@

run: setup
	$(BIN)/rover-hil run robotino --virtual

# One worker more than cores: some tests wait for emulated devices in real time.
test: setup
	$(BIN)/python -m pytest -n $$(($$(nproc) + 1)) --dist loadfile -m "not slow and not nightly" --durations 20

# Processes, browsers, clusters and whole tutorials: minutes. Installs Chromium, its driver and groff where they are missing.
test-slow: setup
	.ci/slow_tools
	$(BIN)/python -m pytest -n auto --dist loadfile -m "slow and not nightly" --durations 40 $(SLOW_FILES)
	# The page of `bench` in a real browser, one after the other: each needs both cores to answer in time.
	$(BIN)/python -m pytest -n 0 -m "slow and not nightly" --durations 10 tests/rover_hil/bench

# What repeats a faster test on more cases: about twenty minutes on two cores. With `make test-kernel` before a release.
test-nightly: setup
	.ci/slow_tools
	$(BIN)/python -m pytest -n auto --dist loadfile -m nightly --ignore tests/rover_hil/bench
	$(BIN)/python -m pytest -n 0 -m nightly tests/rover_hil/bench

# Part of the nightly, not of `make test`: minutes, and 90 MB of Debian's packages in .cache/kernel the first time.
test-kernel: setup
	$(BIN)/python .ci/kernel

# The topics of ROS 2 with a peer of another make, Fast DDS 2.9.1 of Debian 12: two minutes. ROS2_PEER_SECONDS=600 for ten more.
test-ros2: setup
	.ci/ros2_tools
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[ros2]"
	$(BIN)/python -m tests.ros2_peer.build .cache/ros2_peer
	ROS2_PEER=.cache/ros2_peer/peer $(BIN)/python -m pytest -n 0 -s tests/ros2_peer tests/rover_hil/connect

# What must not get worse, against benchmarks/results/gates.md: a quarter of an hour on two cores.
gates: setup
	$(BIN)/python -m benchmarks.gates

# Prints the figures of benchmarks/results/floors.csv: 60 other floors, all versions. Nothing is tuned on it.
gates-full: setup
	$(BIN)/python -m benchmarks.gates --full
	$(BIN)/python -m benchmarks.safety.faults --two-processes

safety-coverage: setup
	$(BIN)/python -m coverage run -m pytest -q -n 0 tests/controllers/safety tests/controllers/test_limits.py \
		tests/controllers/test_stuck_wheels.py tests/controllers/test_gyro.py tests/controllers/test_unseen_bounds.py tests/controllers/test_error_budget.py tests/controllers/test_steering.py \
		tests/rover_hil/test_watchdog.py tests/rover_hil/test_watchdog_process.py \
		tests/rover_hil/test_watchdog_program.py tests/rover_hil/test_heartbeat.py \
		tests/rover_hil/test_operators.py tests/rover_hil/connect/test_commands.py -k "not replays_exactly"
	$(BIN)/python -m coverage report

# Ten minutes; prints the mutants that survive, see docs/contributing/add_a_stop_rule.md.
mutation: setup
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group mutation
	$(BIN)/mutmut run
	! $(BIN)/mutmut results | grep survived

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

reference: setup
	$(BIN)/python -m docs.generate docs/reference

# The pages of recorded figures, from the CSV files beside them.
results: setup
	$(BIN)/python -m benchmarks.results

# The documents as a searchable site: build/site/index.html.
site: setup
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group site
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going -b html -c docs/site docs build/site
	cp build/site/README.html build/site/index.html

wheel: setup
	rm -rf build/lib build/bdist.* dist
	$(BIN)/python -m build --wheel --outdir dist .
	$(BIN)/python .ci/check_wheel.py dist

# Source archive and wheel in dist/, checked, and the wheel run in an empty environment: three minutes. Nothing is published.
release: setup
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group release
	.ci/release
