# `make study` on a new machine builds an environment and runs the study.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
# Modules are compiled when they are imported, as most of the installed ones never are.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

# Python keeps its compiled bytecode, also where the shell forbids it: every process of the tests would compile it anew.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: study studio test lint docs release bench coverage environment kernels clean
.DELETE_ON_ERROR:

study: $(VENV)/installed
	$(BIN)/emsid study

# The page in the browser; the installation fetches uPlot, which draws its plots.
studio: $(VENV)/installed
	$(INSTALL) -e '.[studio]'
	$(BIN)/emsid studio

# Tests of one file mostly stay in one process, where they share what their fixtures have fitted.
test: $(VENV)/compiled
	$(BIN)/pytest -n 3 --dist worksteal $(TESTS)

lint: $(VENV)/tested-with
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The site: every command on its pages is run, and a warning or a broken link is an error.
docs: $(VENV)/documented-with
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet -d build/docs/trees docs build/docs/html
	$(BIN)/python docs/check_site.py build/docs/html
	@echo "open build/docs/html/index.html"

# Wheel and sdist: tests that need no compiled kernels run from the sdist, and the README's lines from the wheel on the
# newest Python that is found.
release: $(VENV)/tested-with
	rm -rf dist build/sdist && mkdir -p build/sdist
	$(BIN)/python -m build --outdir dist . >build/release.log
	tar -xzf dist/emsid-*.tar.gz -C build/sdist --strip-components 1
	cd build/sdist && PYTHONPATH=src $(CURDIR)/$(BIN)/pytest tests/test_packaging.py tests/test_units.py tests/test_io_table.py
	.ci/wheel dist/emsid-*.whl "$$(.ci/newest)"

bench: $(VENV)/measured-with
	$(BIN)/python bench/run.py
	$(BIN)/python bench/steps.py
	$(BIN)/python bench/live.py
	$(BIN)/python bench/accuracy.py

# Whether 95 % intervals contain the true values, on 300 simulated records each (the tests use fewer records), and the
# tests that search real recordings.
coverage: $(VENV)/tested-with
	cd tests && ../$(BIN)/python coverage_cascade.py 300
	cd tests && ../$(BIN)/python coverage_feedback.py 300
	cd tests && ../$(BIN)/python coverage_grey_box.py 300
	cd tests && ../$(BIN)/python coverage_settings.py 300
	cd tests && ../$(BIN)/python coverage_brushless.py 100 10kHz
	$(BIN)/pytest -m long

# What lint, pages and tests need, so that no installation runs beside them.
environment: $(VENV)/installed
	$(INSTALL) -e '.[dev,docs]'
	@touch $(VENV)/tested-with $(VENV)/documented-with

kernels: $(VENV)/compiled

clean:
	rm -rf $(VENV)

# One environment in three stages; each is built once, and again when a version changes.
$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "emsid needs Python 3.11 or newer: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e .
	@touch $@

$(VENV)/tested-with: $(VENV)/installed
	$(INSTALL) -e '.[dev]'
	@touch $@

# Compile the kernels once, so that the test processes do not all compile them.
$(VENV)/compiled: $(VENV)/tested-with tests/compile_kernels.py $(shell grep -rlE --include='*.py' 'njit|_kernel|_compiled' src)
	$(BIN)/python tests/compile_kernels.py
	@touch $@

$(VENV)/documented-with: $(VENV)/installed
	$(INSTALL) -e '.[docs]'
	@touch $@

$(VENV)/measured-with: $(VENV)/installed
	$(INSTALL) -e '.[bench]'
	@touch $@
