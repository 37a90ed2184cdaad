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

# What runs here neither hears nor disturbs robots on the network.
test demo: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
# Small matrices: two threads of a BLAS are slower than one.
test: export OMP_NUM_THREADS := 1

BOOTSTRAP = python=$$(PYTHON='$(PYTHON)' sh tools/find_python.sh) && "$$python" tools/bootstrap.py $(if $(PYTHON),--this-python)

.PHONY: help venv test demo lint format lock colcon bench soak clean

help:  ## list the targets
	@sed -nE 's/^([a-z]+):.*## (.*)/  make \1	\2/p' Makefile

venv:  ## make or bring up to date .venv: ROS 2 Jazzy, all other packages, and this project
	@$(BOOTSTRAP)

test: venv  ## run the tests
	.venv/bin/python -m pytest -n 2 --dist worksteal --ignore test/nodes
	.venv/bin/python -m pytest test/nodes  # by themselves: what runs nodes in real time must not wait for a core

demo: venv  ## a server asked, and simulated robots moved; writes demo.png, demo_tracking.png and bags
	.venv/bin/demo

lint: venv  ## check style and format of the Python files
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .

format: venv  ## put the Python files into format
	.venv/bin/ruff check --fix-only .
	.venv/bin/ruff format .

lock:  ## pin anew the versions in requirements/constraints.txt (needs uv)
	@sh tools/lock.sh

colcon: venv  ## build both packages as in a ROS workspace, into build/, install/ and log/
	@$(BOOTSTRAP) --colcon
	@sh tools/colcon_build.sh

bench: venv  ## measure recursions, compiled models, loops, parallel robots and the streaming of efforts beside others
	.venv/bin/python benchmarks/inverse_direct.py
	.venv/bin/python benchmarks/compiled.py
	.venv/bin/python benchmarks/closed_loops.py
	.venv/bin/python benchmarks/parallel_robots.py
	.venv/bin/python benchmarks/elastodynamics.py
	.venv/bin/python benchmarks/streaming_latency.py
	.venv/bin/python benchmarks/replay.py

soak: venv  ## what takes long: mutated descriptions, every state of parallel robots, noisy identifications, faults in recordings, processes stopped and killed around streamed efforts, ten minutes of streaming
	MUTATIONS=100000 .venv/bin/python -m pytest -s test/model/formats/test_mutated_texts.py
	COMPARED=1000 .venv/bin/python -m pytest -s test/test_parallel_models.py -k both_models --timeout 1500
	NOISY_RUNS=200 .venv/bin/python -m pytest -s test/identification/test_fitting.py -k errors_are_as_large
	FAULT_TRIALS=50 .venv/bin/python -m pytest -s test/replay/test_faults.py --timeout 900
	NOISY_RUNS=200 .venv/bin/python -m pytest -s test/identification/test_position_noise.py test/identification/test_gains.py
	INTERRUPTION_ROUNDS=100 .venv/bin/python -m pytest -s test/nodes/test_streaming_interruptions.py
	SOAK_SECONDS=600 CLOSED_LOOP_SECONDS=20 .venv/bin/python -m pytest -s --timeout 900 test/nodes/test_streaming_soak.py test/nodes/test_closed_loop.py

clean:  ## remove all that the other targets made
	rm -rf .venv .venv.lock build install log demo.png demo_tracking.png demo_bag robot_dynamics.egg-info
	rm -rf .pytest_cache .ruff_cache .hypothesis
	find robot_dynamics test benchmarks tools -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true
