# make demo: set up and run the sample drive.   make test: set up and run the fast tests.
# make docs: the site in build/site.   make man: the man page in build/man.

PYTHON ?= $(shell command -v python3.11 || command -v python3 || echo python3)
VENV := .venv
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check
INSTALL := $(PIP) install --quiet --no-deps --requirement
PYTEST_ARGS ?=
MUTANTS ?=

.PHONY: demo test slow mutants fuzz check docs man clean

demo: $(VENV)/.runtime
	@$(VENV)/bin/automap run data/sample-drive

test: $(VENV)/.dev
	@$(VENV)/bin/python -m pytest -n auto --dist loadfile $(PYTEST_ARGS)

slow: $(VENV)/.dev
	@$(VENV)/bin/python -m pytest -m slow $(PYTEST_ARGS)

# for the night: 200 mistakes at random, another 200 with MUTANTS="--seed 2"; those known of old first
mutants: $(VENV)/.dev
	@$(VENV)/bin/python -m tests.mutation.run --known
	@$(VENV)/bin/python -m tests.mutation.run --count 200 $(MUTANTS)

fuzz: $(VENV)/.dev
	@$(VENV)/bin/python -m tests.fuzz.run $(FUZZ_ARGS)

check: $(VENV)/.dev
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/ruff format --check .
	@$(VENV)/bin/mypy

docs: $(VENV)/.dev man
	@NO_MKDOCS_2_WARNING=1 $(VENV)/bin/python -m mkdocs build --strict --quiet
	@echo "build/site/index.html"

man: $(VENV)/.runtime
	@$(VENV)/bin/python docs/site/manual.py build/man

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(VENV)/.created:
	@bash .ci/create-venv "$(PYTHON)" $(VENV)
	@touch $@

# --no-deps: the lock files name every package, so nothing else is let in
$(VENV)/.runtime: $(VENV)/.created requirements.lock requirements-build.lock pyproject.toml
	@echo "installing the pinned packages into $(VENV) (once; some 200 MB)"
	@$(INSTALL) requirements.lock --requirement requirements-build.lock
	@$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.runtime requirements-dev.lock
	@echo "installing the pinned test tools into $(VENV) (once)"
	@$(INSTALL) requirements-dev.lock
	@touch $@
