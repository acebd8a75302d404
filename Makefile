# make demo   record, replay and compare on the sample log
# make test   every check, but for the long ones
# make slow   the checks that take minutes
# make bench  what a replay costs, printed and kept in docs/benchmarks.md
# make paper  the paper's experiments in simulation, into docs/paper.md

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lint slow bench paper sample clean

demo: $(VENV)/installed
	$(BIN)/arucolog demo

test: lint
	$(BIN)/pytest -m "not bench and not slow"

slow: $(VENV)/installed
	$(BIN)/pytest -m slow

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/installed
	$(BIN)/pytest -m bench -s

paper: $(VENV)/installed
	$(BIN)/python -m analysis.paper

sample: $(VENV)/installed
	$(BIN)/python -m tests.make_sample

$(VENV)/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "Python 3.11 or newer is needed; $$($(PYTHON) --version 2>&1) was found."; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null \
		|| { echo "python3 -m venv is missing here. Install it with: sudo apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --editable . --group dev
	touch $@

clean:
	rm -rf $(VENV) logs/demo
