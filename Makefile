# `make demo` and `make test` make their own environment; nothing but make and Python 3.11 to 3.14 (with venv) is needed.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO_STAMP := $(VENV)/.installed-demo
PEERS := $(VENV)/.peers
SOURCES := $(wildcard core drivers companion clients/python tests benchmarks examples)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Container images often set it. Each process would then compile all modules: 1.6 s of processor time for the service.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help env demo check test test-computing compiled test-processes test-realtime test-versions nightly bench soak vm-test golden golden-recordings proto lint lock reference-tables clean

help: ## what can be made
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /|/' | while IFS='|' read -r name what; do printf 'make %-17s  %s\n' "$$name" "$$what"; done

env: $(STAMP) ## the environment in .venv with all tools of development, made from nothing

$(STAMP): pyproject.toml clients/python/pyproject.toml requirements-dev.lock .ci/find-python .ci/make-env
	@bash .ci/make-env $(VENV) requirements-dev.lock && touch $@
	@echo "the environment is complete: . $(BIN)/activate puts the command companion into the path of this terminal"

# without the tools of development; where those are installed, they are kept
$(DEMO_STAMP): pyproject.toml clients/python/pyproject.toml requirements-demo.lock .ci/find-python .ci/make-env
	@if [ ! -e $(STAMP) ]; then bash .ci/make-env $(VENV) requirements-demo.lock; else $(MAKE) --no-print-directory --silent env; fi && touch $@

demo: $(DEMO_STAMP) ## the live service on a simulated flight, its log replayed and drawn (five minutes the first time, half a minute later)
	@$(BIN)/companion demo $(ARGS)

# A worker that crashes ends the run with the name of its test; pytest-xdist otherwise starts another one, and was seen to wait
# for ever. BY_FILE: a file stays with one worker, since its tests share what it renders and compiles.
WORKERS := --max-worker-restart=0
BY_FILE := $(WORKERS) --dist loadfile

# Files of folder $(2) with tests of marker $(1), in the order of their names: to collect all files takes each worker 9 s of
# processor time. tests/conftest.py ensures that the file of a test contains its markers.
WITH_MARK = $$(grep -rl --include='test_*.py' 'mark\.$(1)' $(2) | LC_ALL=C sort)

lint: $(STAMP) ## ruff, mypy, the contracts between the packages
	@$(BIN)/ruff check $(SOURCES)
	@$(BIN)/ruff format --check $(SOURCES)
	@$(BIN)/mypy
	@$(BIN)/mypy examples
	@$(BIN)/lint-imports

check: $(STAMP) lint ## lint, types and the tests that a change affects (two minutes; REVISION=HEAD~3: since then)
	@tests="$$($(BIN)/python .ci/affected_tests.py $(or $(REVISION),HEAD))"; \
	if [ -n "$$tests" ]; then $(BIN)/pytest $(BY_FILE) -n 2 -m "unit or process" $$tests; else echo "no test is affected"; fi

# Tests that start processes or wait for the clock come last and apart: beside computing tests, even with the lowest priority of
# those, a browser or a service did not answer in time. A failed pass ends none of the others (-k).
test: lint ## all checks, 10 to 25 minutes on two cores
	@$(MAKE) --no-print-directory -k test-computing test-processes test-realtime

# Tests of the branches of kernels (marker nojit) run twice more: without the JIT and with bounds checks. Kernels with bounds
# checks have a cache directory of their own (companion/kernels/jit_cache.py); with whole files fewer are compiled by both workers.
test-computing: $(STAMP)
	@echo "== kernels without the JIT"; NUMBA_DISABLE_JIT=1 $(BIN)/pytest $(WORKERS) -n 2 -m "nojit and unit and not compiled" $(call WITH_MARK,nojit,tests/core)
	@echo "== kernels with bounds checks"; NUMBA_BOUNDSCHECK=1 $(BIN)/pytest $(BY_FILE) -n 2 -m "nojit and unit" $(call WITH_MARK,nojit,tests/core)
	@echo "== unit tests"; $(BIN)/pytest $(BY_FILE) -n 2 -m unit tests

# So that no test with processes waits for a compiler: compiled where they never were.
compiled: $(STAMP)
	@$(BIN)/companion warmup

# Four at a time, since they wait for a third of their time. The long files first (LONG_FILES in tests/conftest.py), then in the
# order of their names: sorted by the number of tests, files of few long tests would come last.
test-processes: compiled
	@echo "== tests with processes, sockets and the clock"
	@$(BIN)/pytest $(BY_FILE) --no-loadscope-reorder -n 4 -m "process and not realtime" $(call WITH_MARK,process,tests)

# On a slow machine three services at once do not keep up with their cameras. In the same order.
test-realtime: compiled
	@echo "== tests that follow a service in real time"
	@$(BIN)/pytest $(BY_FILE) --no-loadscope-reorder -n 2 -m realtime $(call WITH_MARK,realtime,tests)

test-versions: $(STAMP) ## Python 3.11 to 3.14, each with the lowest and highest packages (needs the network; ARGS='--only 3.12')
	@$(BIN)/python .ci/test_versions.py $(ARGS)

SEED ?= $(shell date +%s)
nightly: $(STAMP) ## slow tests, and property tests with new examples; SEED=N repeats those of a run
	@echo "hypothesis seed: $(SEED)"
	@$(BIN)/pytest $(WORKERS) -n 2 --hypothesis-profile=nightly --hypothesis-seed=$(SEED) -m "not soak and not vm" tests/core tests/client tests/drivers tests/companion
	@$(BIN)/pytest $(WORKERS) -n 2 -m slow tests/benchmarks tests/system

# What we compare with is large (1.2 GB) and only for the section `peers`; one that has no wheel here is left out.
$(PEERS): $(STAMP) .ci/constraints-peers.txt
	@if $(BIN)/python -m benchmarks.peers.install; then touch $@; fi

NEEDS_PEERS := $(if $(findstring --only,$(ARGS)),$(findstring peers,$(ARGS)),yes)
bench: $(STAMP) $(if $(NEEDS_PEERS),$(PEERS)) ## all figures of docs/research/benchmarks (hours); ARGS=--quick: minutes, ARGS='--only speed'
	@$(BIN)/python -m benchmarks $(ARGS)
	@$(BIN)/python -m benchmarks.fidelity.limits

soak: $(STAMP) ## the long runs (hours)
	@$(BIN)/pytest -m soak tests

# A kernel is only downloaded and unpacked, never installed. Debian and Ubuntu; needs apt-get.
VM_KERNEL ?= $(CURDIR)/.vm-kernel
$(VM_KERNEL):
	@bash .ci/fetch-kernel "$@"

vm-test: $(STAMP) | $(VM_KERNEL) ## the service under a real systemd in a virtual machine (some minutes; needs qemu)
	@VM_KERNEL="$(VM_KERNEL)" $(BIN)/pytest -m vm tests/system

golden: $(STAMP) ## rewrite the golden results and show what changed
	@$(BIN)/pytest --update-golden tests/test_golden.py tests/benchmarks/test_regression.py

golden-recordings: $(STAMP) ## fly the golden recordings anew (only when the simulator changed), then as `make golden`
	@$(BIN)/python -m tests.golden
	@$(MAKE) --no-print-directory golden

proto: $(STAMP) ## the Python code of the message schema
	@PYTHON=$(BIN)/python sh clients/python/osape_client/proto/generate.sh

lock: ## rewrite the lock files from pyproject.toml and .ci/constraints.txt (needs the network)
	@bash .ci/make-lock

reference-tables: $(STAMP) ## rewrite the tables of docs/reference that are made from the code
	@$(BIN)/python -m tests.companion.reference_tables

clean: ## delete the environment and what demo and tests left (compiled kernels: ~/.cache/osape-companion)
	rm -rf $(VENV) .numba-cache demo-out bench-out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .coverage
	find $(SOURCES) -type d -name __pycache__ -prune -exec rm -rf {} +
	rm -rf clients/python/build clients/python/*.egg-info
