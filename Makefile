# make demo: set up and run the sample drive.   make test: set up and run the fast tests.
# make docs: the site in build/site.   make man: the man page in build/man.

PYTHON ?= $(shell command -v python3.11 || command -v python3 || echo python3)
VENV := .venv
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check
# modules are compiled when they are first imported: most never are
INSTALL := $(PIP) install --quiet --no-deps --no-compile --requirement
PYTEST_ARGS ?=
MUTANTS ?=
# where an image sets this, every process that a test starts compiles all its modules anew
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test slow mutants fuzz faults check docs man lock sbom audit release clean

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

# some 40 minutes of two cores
faults: $(VENV)/.dev
	@$(VENV)/bin/python -m tests.faults.run $(FAULTS_ARGS)

check: $(VENV)/.dev
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/ruff format --check .
	@$(VENV)/bin/mypy

docs: $(VENV)/.dev man
	@NO_MKDOCS_2_WARNING=1 $(VENV)/bin/python -m mkdocs build --strict --quiet
	@echo "build/site/index.html"

man: $(VENV)/.runtime
	@$(VENV)/bin/python docs/site/manual.py build/man

# the hashes of all files of the pinned versions, after a pin was changed
lock: $(VENV)/.created
	@$(PIP) install --quiet uv
	@for name in requirements requirements-build requirements-dev; do \
	  { grep '^#' $$name.lock; $(VENV)/bin/uv pip compile --quiet --no-deps --generate-hashes --no-annotate \
	    --no-header --python-version 3.11 $$name.lock; } > build.lock.tmp && mv build.lock.tmp $$name.lock || exit 1; done

sbom: $(VENV)/.runtime
	@$(VENV)/bin/python -m release.sbom

# known vulnerabilities of the pins; its data are in the net, and it says so where they cannot be had
audit: $(VENV)/.created
	@test -x $(VENV)-audit/bin/pip-audit || { $(PYTHON) -m venv $(VENV)-audit && \
	  $(VENV)-audit/bin/python -m pip --disable-pip-version-check install --quiet pip-audit; } || true
	@$(VENV)/bin/python -m release.audit $(VENV)-audit/bin/pip-audit

# wheel and sdist, the same bytes from the same commit
release: $(VENV)/.runtime sbom
	@SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(VENV)/bin/python -m hatchling build -d dist

clean:
	rm -rf $(VENV) $(VENV)-audit build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(VENV)/.created:
	@bash .ci/create-venv "$(PYTHON)" $(VENV)
	@touch $@

# --no-deps: the lock files name every package, so nothing else is let in
$(VENV)/.build: $(VENV)/.created requirements-build.lock
	@$(INSTALL) requirements-build.lock
	@touch $@

$(VENV)/.runtime: $(VENV)/.build requirements.lock pyproject.toml
	@echo "installing the pinned packages into $(VENV) (once; 1.2 GB of disk)"
	@$(INSTALL) requirements.lock
	@$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

# none of these packages is one of the runtime's: make -j2 installs both at once
$(VENV)/.tools: $(VENV)/.build requirements-dev.lock
	@echo "installing the pinned test tools into $(VENV) (once)"
	@$(INSTALL) requirements-dev.lock
	@touch $@

$(VENV)/.dev: $(VENV)/.runtime $(VENV)/.tools
	@touch $@
