# Every command a person needs. Each one sets up .venv by itself; `make help` lists them.

VENV := .venv
PY := $(VENV)/bin/python
INSTALLED := $(VENV)/.installed
LINKS := $(VENV)/types/sealegs
EXTRAS := train contrib wandb hub sweep report video hw gamepad dynamixel hdf5 ros docs dev
FOREIGN := lerobot deepdiff orderly-set
RUFF = $(PY) -m ruff check . && $(PY) -m ruff format --check .
LAYERS = PYTHONPATH=$(VENV)/types $(VENV)/bin/lint-imports --no-logo --no-cache
PYTEST = $(PY) -m pytest -n 2 --dist worksteal --durations=15

# Compiled modules are kept, whatever the shell says: without them each of the many processes that tests start compiles
# all that it imports (torch alone takes 5 s), because pip is told not to.
unexport PYTHONDONTWRITEBYTECODE

# Headless drawing. MuJoCo on macOS has one way to draw and takes no choice.
ifeq ($(shell uname),Linux)
export MUJOCO_GL ?= egl
endif

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-all test-weekly lint types pytest bench hidden hidden-wide hidden-arm hidden-everyday transfer sensitivity policy-matrix fuzz docs format clean

help: ## list the commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(INSTALLED) ## make .venv with the pinned packages

demo: $(INSTALLED) ## the main job: log, diagnosis, training; under 10 minutes
	$(PY) demo.py

test: $(INSTALLED) $(LINKS) ## lint, and the tests that take seconds
	$(RUFF)
	$(LAYERS)
	@$(MAKE) --no-print-directory pytest

test-all: $(INSTALLED) $(LINKS) ## what `make test` leaves out: types, and the tests that take half an hour; SHARE=0/3: a third of them
	@$(MAKE) --no-print-directory types
	$(PYTEST) --durations=80 -m "long and not weekly" $(if $(SHARE),--share $(SHARE))

test-weekly: $(INSTALLED) ## the tests of a minute and more, which `make test-all` leaves out; SHARE=0/8: an eighth of them
	$(PYTEST) -m weekly $(if $(SHARE),--share $(SHARE))

lint: $(INSTALLED) $(LINKS) ## ruff, layers of imports, pyright
	$(RUFF)
	$(LAYERS)
	@$(MAKE) --no-print-directory types

types: $(INSTALLED) $(LINKS) ## only pyright
	$(PY) -m pyright

pytest: $(INSTALLED) ## only the tests of `make test`
	$(PYTEST) -m "not long"

bench: $(INSTALLED) ## measure the speed, write benchmarks/results
	$(PY) -m benchmarks

hidden: $(INSTALLED) ## the finder against every hidden effect, hours; can be stopped and goes on, writes benchmarks/results
	$(PY) -m benchmarks.hidden

hidden-wide: $(INSTALLED) ## the finder against machines drawn from a wide prior, hours; can be stopped and goes on
	$(PY) -m benchmarks.hidden_wide

hidden-arm: $(INSTALLED) ## the finder against hidden arms, joint by joint, hours; can be stopped and goes on
	$(PY) -m benchmarks.hidden_arm

hidden-everyday: $(INSTALLED) ## the finder against machines with many effects at once, hours; can be stopped and goes on
	$(PY) -m benchmarks.hidden_everyday

transfer: $(INSTALLED) ## policies trained on several models, judged on hidden machines, hours; can be stopped and goes on
	$(PY) -m sealegs transfer

sensitivity: $(INSTALLED) ## what each threshold of the search does when halved or doubled, from recorded searches
	$(PY) -m benchmarks.sensitivity

policy-matrix: $(INSTALLED) ## the committed policies on every actuator model of their robot, 20 minutes; can be stopped and goes on
	$(PY) -m benchmarks.policy_matrix

fuzz: $(INSTALLED) ## hostile documents, N of each kind from SEED: make fuzz N=10000 SEED=7
	SEALEGS_FUZZ=$(or $(N),2000) SEALEGS_FUZZ_SEED=$(or $(SEED),1) $(PYTEST) -m "not long" tests/security/test_fuzz_documents.py

docs: $(INSTALLED) $(LINKS) ## the documentation as a site in build/site, readable offline
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict
	@echo "Written: build/site/index.html. To search in it: $(PY) -m http.server -d build/site 8000"

format: $(INSTALLED) ## put the code into the house format
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .

clean: ## remove .venv and caches; never what you recorded (runs, logs)
	rm -rf $(VENV) .pytest_cache .ruff_cache
	find . -name __pycache__ -not -path './runs/*' -prune -exec rm -rf {} +

# The first Python of at least 3.11 that starts. Read from pyproject.toml: one list of what is needed.
$(INSTALLED): pyproject.toml setup.py constraints.txt
	@for python in python3.11 python3 python3.12 python3.13; do \
	    if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	        echo "Setting up $(VENV) with $$($$python --version); the first time takes some minutes."; \
	        exec $$python -m venv $(VENV); \
	    fi; \
	done; \
	echo "sealegs needs Python 3.11 or newer, and neither python3.11 nor python3 is one: install it and run make again." >&2; \
	exit 1
	$(PY) -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
	print(*p["dependencies"], *(r for e in "$(EXTRAS)".split() for r in p["optional-dependencies"][e]), sep="\n")' \
	    > $(VENV)/requirements.txt
	@# what is imported gets compiled then; compiling all of it takes a minute
	$(PY) -m pip install --disable-pip-version-check --no-compile -c constraints.txt -r $(VENV)/requirements.txt
	@# a foreign client that the tests run unchanged on the virtual servos; of what it needs, its buses need this
	$(PY) -m pip install --disable-pip-version-check --no-compile --no-deps -c constraints.txt $(FOREIGN)
	$(PY) -m pip install --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

# The checkout is the package: the type checker finds it as `sealegs` by one link, whatever its folder is called.
$(LINKS): $(INSTALLED)
	@rm -rf $@ && mkdir -p $(@D) && ln -s $(CURDIR) $@
