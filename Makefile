# SPDX-License-Identifier: Apache-2.0
# Every target but clean sets up what it needs in .venv; see .ci/setup.

# Software rendering without a screen; macOS draws by itself.
ifeq ($(shell uname),Linux)
export MUJOCO_GL ?= egl
endif

# Packages of another installation (ROS, for one) would shadow those in .venv. And without compiled files,
# every start of LeRobot would take seconds more.
unexport PYTHONPATH PYTHONDONTWRITEBYTECODE

SIZE ?= quick

.PHONY: setup demo reproduce test test-fast lint clean

setup:
	@.ci/setup

demo: setup
	@PATH="$(CURDIR)/.venv/bin:$$PATH" bash configs/demo.sh

# SIZE is one of reproduce/plan.yaml: quick (an hour on two cores), full or hub. It goes on where it stopped.
reproduce: setup
	@.venv/bin/python -m reproduce --size=$(SIZE)

# Two test files at a time, on one thread each: more of them would need more memory.
tests = OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n 2 --dist=loadfile

test: lint
	$(tests)

# What starts no process, trains nothing and draws little: for the time between two edits.
test-fast: setup
	$(tests) -q -m "not slow"

lint: setup
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy

clean:
	rm -rf .venv build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
