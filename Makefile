# Every command sets up what it needs first. VENV and PYTHON may be given: make test VENV=/tmp/venv PYTHON=python3.12
VENV   ?= .venv
PYTHON ?= $(firstword $(foreach version,3.11 3.12 3.13,$(shell command -v python$(version) 2>/dev/null)) python3)
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
# Tests run in as many processes as there are cores; those of a file share what they prepare. Files begin in the order of
# tests/conftest.py, so that no process has nothing to do at the end.
AT_ONCE := -n logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder
# Bytecode and kernels are compiled once, not by each process that tests start.
KEEPS := PYTHONDONTWRITEBYTECODE=
.DEFAULT_GOAL := help
.PHONY: help setup quickstart test test-fast faults fuzz check measure accuracy bench peer samples docs dist versions lock clean

help:           ## show these lines
	@grep -hE '^[a-z-]+: .*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## */\1\t/' | expand -t 14

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "dicflow needs Python 3.11 or newer; name one with PYTHON=..."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

setup: $(READY) ## make the virtual environment in .venv, and compile the kernels ahead
	$(BIN)/dicflow warm

quickstart: $(READY) ## measure the specimen in data_samples and say where the maps are
	$(BIN)/dicflow run pipelines/quickstart.yaml --data data_samples
	@echo 'in the browser: $(BIN)/dicflow app pipelines/quickstart.yaml --data data_samples'

test: $(READY)  ## run the tests
	$(KEEPS) $(BIN)/dicflow warm
	$(KEEPS) $(BIN)/python -m pytest $(AT_ONCE)

test-fast: $(READY) ## run the tests that need neither a whole pipeline nor many repetitions
	$(KEEPS) $(BIN)/dicflow warm
	$(KEEPS) $(BIN)/python -m pytest $(AT_ONCE) -m "not slow"

faults: $(READY) ## kill, damage, fill up and race a store, hundreds of times; takes ten minutes
	$(BIN)/python -m tests.faults

fuzz: $(READY)  ## every reader of files on 500 changed files each, 13,000 in all; a few minutes
	$(BIN)/python -m tests.fuzz

check: $(READY) ## ruff, mypy (of the benchmarks too) and the bars of the code
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m tests.measure

measure: $(READY) ## arrows, lengths, arguments and types of the code against their bars
	$(BIN)/python -m tests.measure

accuracy: $(READY) ## the five replicas and the real images against their truth; takes a while
	$(BIN)/python -m tests.accuracy

bench: $(READY) ## cost of a cold and a warm run, of two workers against one, of the engine
	$(BIN)/python -m tests.bench

peer:           ## install the program that the benchmark compares with, in .venv-peer
	$(PYTHON) -m venv .venv-peer
	.venv-peer/bin/python -m pip install --quiet --disable-pip-version-check pyvale

samples: $(READY) ## make data_samples again; the bytes do not change
	$(BIN)/dicflow synth sample data_samples --force
	$(BIN)/dicflow synth rubber data_samples/rubber --force

docs: $(READY)  ## build the manual in build/manual; warnings are errors
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs --quiet build --clean
	@echo 'the manual: build/manual/index.html'

dist: $(READY)  ## build wheel and sdist in dist, and check them
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[release]'
	rm -rf dist
	$(BIN)/python -m build
	$(BIN)/python -m twine check --strict dist/*

versions: $(READY) ## the wheel under every Python from 3.11 to 3.13 that is here: install it, measure the demonstration
	$(BIN)/python -m tests.versions

lock: $(READY)  ## write constraints.txt from the installed versions
	$(BIN)/python -m pip freeze --exclude-editable --exclude dicflow > constraints.txt

clean:          ## remove the environment, caches, stores and results
	rm -rf $(VENV) .venv-peer .mypy_cache .pytest_cache .ruff_cache .hypothesis build dist pipelines/.dicflow pipelines/results
