# Entry points of the project; `make help` lists them. Paths are relative, so that the checkout may lie anywhere.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

# A Python 3.10 to 3.13 to make .venv with. Left empty, tools/find_python.sh looks for one.
PYTHON ?=

# A ROS that is sourced in this shell must not lend its packages to .venv, which has its own.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONHOME PYTHONPATH RMW_IMPLEMENTATION
unexport VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE
ifdef ROS_DISTRO
unexport LD_LIBRARY_PATH
endif

# A Python 3.12 to make .venv_apt_jazzy with. Left empty, tools/find_python.sh looks for one.
JAZZY_PYTHON ?=

# Time of `make fuzz` [s], divided among its TARGETS (default: all).
SECONDS ?= 600
TARGETS ?=

# What runs here neither hears nor disturbs robots on the network.
test jazzy demo faults fuzz: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
# Small matrices: two threads of a BLAS are slower than one.
test jazzy faults fuzz: export OMP_NUM_THREADS := 1
# Tests of nodes in real time, which must not wait for a core. The soak is of what a long time brings: it is left out.
REAL_TIME = bag_recorder computed_torque control_loop many_clients mobile_base_simulator replay_check
REAL_TIME += fault_rounds streaming_faults streaming_interruptions streaming_soak
# A test in real time that fails runs again: the machine may have had no core for it. A defect fails it each time.
REAL_TIME_RERUNS = --reruns 2 --reruns-delay 2
# What `make jazzy` tests beside nodes: what depends most on the version of NumPy, and on machine code, which is not there.
# `make jazzy JAZZY_TESTS=test` tests all.
JAZZY_TESTS ?= $(wildcard test/test_*.py) $(addprefix test/,cli codegen control flexible joint_space model newton_euler recordings)
# The nodes that `make jazzy` tests: one that streams, and one with services.
JAZZY_NODES = computed_torque dynamics_server
# Fewer of what is random, nothing slow, no comparison with another library, no faults between processes: here it is
# the packages that differ.
jazzy: export RANDOM_TREES := 30
jazzy: export SIMULATED_SECONDS := 0.7
jazzy: export SIMULATED_MECHANISMS := 4
jazzy: export SEEDS := 1

BOOTSTRAP = python=$$(PYTHON='$(PYTHON)' sh tools/find_python.sh) && "$$python" tools/bootstrap.py $(if $(PYTHON),--this-python)

.PHONY: help venv test quick jazzy demo docs lint format lock wheels wheels-test control colcon bench soak faults fuzz clean

help:  ## list the targets
	@sed -nE 's/^([a-z-]+):.*## (.*)/  make \1	\2/p' Makefile

venv:  ## make or bring up to date .venv for tests: ROS 2 Jazzy, this project, and all that the tests need
	@$(BOOTSTRAP) --tests

test: venv  ## run the tests
	.venv/bin/python -m pytest -n 2 --dist worksteal --ignore test/nodes
	.venv/bin/python -m pytest -n 2 --dist loadfile docs README.md  # their code blocks; those of a page in one process
	.venv/bin/python -m pytest -n 2 --dist loadfile $(REAL_TIME_RERUNS) test/nodes $(REAL_TIME:%=--ignore test/nodes/test_%.py)
	.venv/bin/python -m pytest $(REAL_TIME_RERUNS) $(REAL_TIME:%=test/nodes/test_%.py)  # by themselves: they must not wait for a core

quick: venv  ## run the tests that need no ROS and are fast, in under two minutes
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n 2 --dist worksteal -m "not slow and not ros and not reference" --ignore test/nodes

jazzy:  ## run the tests with what Ubuntu 24.04 has beside ROS 2 Jazzy from apt: Python 3.12, NumPy 1.26, no llvmlite, no rosbags
	@python=$$(WANTED=3.12 PYTHON='$(JAZZY_PYTHON)' sh tools/find_python.sh) && "$$python" tools/bootstrap.py --apt-jazzy
	.venv_apt_jazzy/bin/python -m pytest -n 2 --dist worksteal -m "not slow and not reference" --ignore test/nodes --ignore test/docs --ignore test/fuzz $(JAZZY_TESTS)
	.venv_apt_jazzy/bin/python -m pytest $(REAL_TIME_RERUNS) $(JAZZY_NODES:%=test/nodes/test_%.py)

demo:  ## call a server and simulate robots; writes demo.png, demo_tracking.png and bags; .venv gets no test packages
	@$(BOOTSTRAP)
	.venv/bin/demo

docs:  ## build the documentation into build/docs, tutorials executed
	@$(BOOTSTRAP) --docs
	.venv/bin/python -m sphinx -W --keep-going -n -b html docs build/docs
	@echo "open build/docs/index.html"

lint: venv  ## check style, format and types of the Python files
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

format: venv  ## put the Python files into format
	.venv/bin/ruff check --fix-only .
	.venv/bin/ruff format .

lock:  ## pin anew the versions in requirements/constraints.txt (needs uv)
	@sh tools/lock.sh

wheels:  ## build both wheels into dist/, the interfaces for each of PYTHONS (default: one Python)
	@sh tools/build_wheels.sh $(PYTHONS)

wheels-test: venv  ## install both wheels into empty environments, one for each of PYTHONS, and use them there
	WHEEL_PYTHONS="$(PYTHONS)" .venv/bin/python -m pytest test/packaging

control: venv  ## build the control laws in C++ with a plain compiler and models of all robots, test them, measure updates
	@sh tools/control_test.sh

colcon:  ## build all three packages as in a ROS workspace, into build/, install/ and log/
	@$(BOOTSTRAP) --colcon
	@sh tools/colcon_build.sh

bench: venv  ## measure recursions, compiled models, loops, parallel robots, streaming and services beside others
	.venv/bin/python benchmarks/inverse_direct.py
	.venv/bin/python benchmarks/compiled_models.py
	.venv/bin/python benchmarks/closed_loops.py
	.venv/bin/python benchmarks/single_calls.py
	.venv/bin/python benchmarks/derivatives.py
	.venv/bin/python benchmarks/simulation_steps.py
	.venv/bin/python benchmarks/parallel_robots.py
	.venv/bin/python benchmarks/elastodynamics.py
	.venv/bin/python benchmarks/streaming_latency.py
	.venv/bin/python benchmarks/services.py
	.venv/bin/python benchmarks/many_clients.py
	.venv/bin/python benchmarks/replay.py
	.venv/bin/python benchmarks/viewer.py

soak: venv  ## what takes long: conversions of many trees, every state of parallel robots, noisy identifications, faults in recordings, ten minutes of motion without a collision, processes stopped and killed around streamed efforts, ten minutes of streaming, ten minutes of fifty clients
	EVERY_ROBOT=1 .venv/bin/python -m pytest -s test/codegen -k "hexapod_stack or delta or navaro or orthoglide or andrews_squeezer or bricard or tiago_pro" --timeout 900
	EVERY_ROBOT=1 .venv/bin/python -m pytest -s test/simulation/test_compiled_steps.py test/simulation/test_loops_at_speed.py test/parallel/test_shipped_platforms.py --timeout 900
	EVERY_ROBOT=1 .venv/bin/python -m pytest -s test/viewing/test_viewer.py
	EVERY_PART=1 .venv/bin/python -m pytest -s test/checking/test_long_recordings.py
	PROGRAM_STATES=40 .venv/bin/python -m pytest -s test/constraints/test_closed_loops.py -k compiled_programs --timeout 900
	RANDOM_TREES=200 .venv/bin/python -m pytest -s test/model/formats/test_conversions.py --timeout 900
	COMPARED=1000 .venv/bin/python -m pytest -s test/parallel/test_platform_models.py -k both_models --timeout 1500
	SIMULATED_SECONDS=30 SIMULATED_MECHANISMS=200 .venv/bin/python -m pytest -s test/simulation/test_loops_at_speed.py --timeout 900
	EVERY_ROBOT=1 MOTOR_DRAWS=1000 .venv/bin/python -m pytest -s test/parallel/test_assembly_modes.py --timeout 1500
	EVERY_ROBOT=1 sh tools/control_test.sh
	NOISY_RUNS=200 .venv/bin/python -m pytest -s test/identification/test_fitting.py -k errors_are_as_large
	EVERY_ROBOT=1 SEEDS=10 .venv/bin/python -m pytest -s test/identification/test_base_parameters.py -k another_way --timeout 900
	FAULT_TRIALS=50 .venv/bin/python -m pytest -s test/checking/test_faults.py --timeout 900
	NOISY_RUNS=200 .venv/bin/python -m pytest -s test/identification/test_position_noise.py test/identification/test_gains.py
	NOISY_RUNS=200 .venv/bin/python -m pytest -s test/identification/test_payload_fit.py -k errors_agree
	MONITORED_MINUTES=10 MONITORED_PUSHES=100 .venv/bin/python -m pytest -s test/monitoring/test_pushed_panda.py --timeout 900
	RANDOM_MOMENTA=30 EVERY_ROBOT=1 .venv/bin/python -m pytest -s test/codegen/trace/test_momentum_models.py --timeout 900
	INTERRUPTION_ROUNDS=100 .venv/bin/python -m pytest -s test/nodes/test_streaming_interruptions.py
	SOAK_SECONDS=600 CLOSED_LOOP_SECONDS=20 .venv/bin/python -m pytest -s --timeout 900 test/nodes/test_streaming_soak.py test/nodes/test_control_loop.py
	CLIENT_SECONDS=600 .venv/bin/python -m pytest -s --timeout 1500 test/nodes/test_many_clients.py

ROUNDS ?= 100

faults: venv  ## hurt running nodes, ROUNDS times (100) by each of FAULTS (a pattern; all): kills, stops, clocks, storms, full disk, no network
	PYTHONPATH=test .venv/bin/python -m nodes.faults.harness --rounds $(ROUNDS) --faults '$(FAULTS)'

fuzz: venv  ## mutate descriptions, recordings, requests and states for SECONDS (default: 600), or those of TARGETS; finds go to build/fuzz
	.venv/bin/python fuzz/run.py $(TARGETS) --seconds $(SECONDS)

clean:  ## remove all that the other targets made
	rm -rf .venv .venv.lock .venv_apt_jazzy .venv_apt_jazzy.lock build dist install log demo.png demo_tracking.png demo_bag robot_dynamics.egg-info
	rm -rf .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find robot_dynamics test benchmarks tools fuzz -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true
