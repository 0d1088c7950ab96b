# Each target sets up what it needs in .venv, once, and again when pyproject.toml or constraints.txt change.
#   make demo PYTHON=python3.12     another interpreter (Python 3.11 or later)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint constraints.txt
PINS := pyproject.toml constraints.txt
# pytest runs in that many processes, each file in one of them: what a file's tests share is made once
JOBS ?= 2

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test suite long lint plain coverage fuzz studio cluster platforms docs benchmark picture clean

help:
	@echo "make demo       from recordings to the physics that their validation concealed; writes out/demo.html"
	@echo "make test       lint, the documentation, the contact laws as plain Python, and the tests but for the longest"
	@echo "make long       the longest tests"
	@echo "make lint       ruff, mypy, import-linter"
	@echo "make coverage   the share of lines and branches that the whole test suite reaches; a table in out/coverage.txt"
	@echo "make fuzz       20,000 damaged files at every reader and every JSON and TOML file; none may crash, hang or trace back"
	@echo "make studio     the tests that drive the studio in a browser; the machine should have nothing else to do"
	@echo "make cluster    the tests of work spread over machines, with a Ray cluster of this machine alone"
	@echo "make platforms  exported C and FMUs of other platforms: built, and run by the emulators in EMULATORS"
	@echo "make docs       the documentation, in docs/_build/html"
	@echo "make benchmark  speed of the law and of the plant, as ratios"
	@echo "make picture    the picture of the README: a diagnosis"

demo: $(VENV)/.demo
	$(BIN)/wsp demo

# Side by side; the suite begins when the first of the others ends, and takes longest: its summary is the last line.
test: $(VENV)/.dev $(VENV)/.docs
	$(MAKE) --jobs 3 lint docs plain suite

suite: $(VENV)/.dev
	$(BIN)/pytest --numprocesses $(JOBS) --dist loadfile -m "not long"

long: $(VENV)/.dev
	$(BIN)/pytest --numprocesses $(JOBS) -m long

studio: $(VENV)/.dev
	WSP_STUDIO_BROWSER=1 $(BIN)/pytest tests/test_studio_browser.py

cluster: $(VENV)/.dev
	$(PIP) --editable ".[cluster]"
	$(BIN)/pytest tests/test_executor.py

# such as EMULATORS='linux-aarch64 "qemu-aarch64 -L /usr/aarch64-linux-gnu" win64 wine64'
platforms: $(VENV)/.dev
	$(PIP) ziglang
	$(BIN)/pytest tests/test_platforms.py
	$(BIN)/python -m experiments.other_platforms $(if $(EMULATORS),--emulators $(EMULATORS))

# Compiled code hides from coverage and from Python's own checks: some tests once more without the compiler.
plain: $(VENV)/.dev
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest --quiet -m plain

# Compiled kernels are seen in the plain run only; the second run adds to the first one's data.
coverage: $(VENV)/.dev
	@mkdir -p out
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest --quiet -m plain --cov --cov-report=
	$(BIN)/pytest --numprocesses $(JOBS) --cov --cov-append --cov-report=
	$(BIN)/coverage report > out/coverage.txt
	@echo "out/coverage.txt"; grep ^TOTAL out/coverage.txt

lint: $(VENV)/.dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

# Damaged files at every door; what goes wrong is kept in tests/crashes.
fuzz: $(VENV)/.dev
	$(BIN)/python experiments/fuzz.py --files 20000 --jobs $(JOBS)

docs: $(VENV)/.docs
	$(BIN)/sphinx-build -W --keep-going -E -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

benchmark: $(VENV)/.report
	$(BIN)/python experiments/benchmark.py

picture: $(VENV)/.report
	$(BIN)/python experiments/readme_picture.py

clean:
	rm -rf $(VENV) docs/_build out

# --- set-up -----------------------------------------------------------------------------------------------------------

$(BIN)/python:
	@command -v $(PYTHON) >/dev/null || { echo "no '$(PYTHON)' found: install Python 3.11 or later, or name it: make PYTHON=..."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$$($(PYTHON) --version) is too old: wsp-env needs 3.11 or later; name another: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 || \
		{ $(PYTHON) -m venv --without-pip --clear $(VENV) && $(PYTHON) -m pip --python $@ install --quiet pip; } || \
		{ rm -rf $(VENV); echo "cannot make a virtual environment with $(PYTHON): it needs the modules venv and pip"; exit 1; }

$(VENV)/.demo: $(VENV)/.report
	$(PIP) --editable ".[report,export]"
	@touch $@

$(VENV)/.report: $(PINS) | $(BIN)/python
	$(PIP) --editable ".[report]"
	@touch $@

# torch first and alone: its index of CPU builds (where it can be reached) saves some GB of CUDA, which PyPI's build asks for
$(VENV)/.torch: constraints.txt | $(BIN)/python
	$(PIP) --no-deps --retries 0 --extra-index-url https://download.pytorch.org/whl/cpu torch
	@touch $@

$(VENV)/.dev: $(PINS) $(VENV)/.torch | $(BIN)/python
	$(PIP) --editable ".[dev]"
	@touch $@

$(VENV)/.docs: $(PINS) | $(BIN)/python
	$(PIP) --editable ".[docs]"
	@touch $@
