# Everything a newcomer needs; `make study` on a fresh machine does the rest.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: study test lint bench clean
.DELETE_ON_ERROR:

study: $(VENV)/installed
	$(BIN)/emsid study

test: $(VENV)/tested-with
	$(BIN)/pytest -n 2

lint: $(VENV)/tested-with
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/measured-with
	$(BIN)/python bench/run.py

clean:
	rm -rf $(VENV)

# One environment, three depths; each is made once and again when a version changes.
$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "emsid needs Python 3.11 or newer: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e .
	@touch $@

$(VENV)/tested-with: $(VENV)/installed
	$(INSTALL) -e '.[dev]'
	@touch $@

$(VENV)/measured-with: $(VENV)/installed
	$(INSTALL) -e '.[bench]'
	@touch $@
