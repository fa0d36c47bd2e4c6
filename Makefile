# Two commands matter: `make run` and `make test`. Both set up everything they need in .venv.

PYTHON ?= $(firstword $(foreach name,python3.11 python3.12 python3.13 python3,$(shell command -v $(name) 2>/dev/null)))
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
SECONDS ?= 60

.PHONY: run test fuzz lint format types bench fidelity worlds package clean help

help:            ## show this list
	@grep -E '^[a-z]+: .*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/'

run: $(VENV)/ready        ## start the server (ARGS="--world office" adds options)
	$(BIN)/usarsim serve $(ARGS)

test: $(VENV)/ready-dev   ## run the tests
	$(BIN)/python -m pytest -n 4 --dist loadfile $(ARGS)

fuzz: $(VENV)/ready-fuzz  ## look for bytes that no reader can stand (SECONDS=60 for each)
	$(BIN)/python tests/fuzz/run.py --seconds $(SECONDS) $(ARGS)

lint: $(VENV)/ready-dev   ## check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/ready-dev ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/ready-dev  ## measure speed, latency and memory
	$(BIN)/usarsim bench $(ARGS)

fidelity: $(VENV)/ready-dev ## run the physics acceptance tests and print their table
	$(BIN)/usarsim bench fidelity $(ARGS)

worlds: $(VENV)/ready-dev ## build the shipped worlds again from their generators
	$(BIN)/python -m usarsim_worldgen

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
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/ready-dev: pyproject.toml | $(VENV)/pip
	$(BIN)/python -m pip install --quiet --editable . --group test --group lint
	@touch $@ $(VENV)/ready

$(VENV)/ready-fuzz: $(VENV)/ready-dev
	$(BIN)/python -m pip install --quiet --group fuzz
	@touch $@
