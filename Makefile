# `make demo` and `make test` work from a bare clone with Python 3.11 (PYTHON=... for another).
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin

.PHONY: help demo test test-all oracles bench lint lock clean
.DEFAULT_GOAL := help

help: ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1	/'

.venv: .venv/.product ## the virtual environment with the pinned product dependencies

.venv/.python:
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade 'pip==26.3'
	@touch $@

.venv/.product: requirements.lock pyproject.toml .venv/.python
	$(BIN)/python -m pip install --quiet --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

.venv/.dev: requirements-dev.lock .venv/.product
	$(BIN)/python -m pip install --quiet --requirement requirements-dev.lock
	@touch $@

demo: .venv/.product ## score the three synthetic subjects and write the HTML report
	$(BIN)/kiribench demo --out reports/demo

lint: .venv/.dev ## ruff, mypy --strict, import-linter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint ## lint and the test suite without the slow oracles
	$(BIN)/pytest -n 2 --dist loadgroup -m "not slow"

test-all: lint oracles ## everything, with the slow oracles
	$(BIN)/pytest -n 2 --dist loadgroup

oracles: ## Debian's CalculiX and Chromium, where apt is at hand and they are missing
	@command -v ccx >/dev/null && command -v chromium >/dev/null || \
	  { command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ] && apt-get update -qq && \
	    apt-get install -y -qq --no-install-recommends calculix-ccx chromium; } || \
	  echo "calculix-ccx and chromium are not all installed: the tests that need them are skipped" >&2

bench: .venv/.dev ## every benchmark against its named peer, interleaved
	@status=0; for file in tests/benchmarks/bench_*.py; do \
	  echo "== $$file"; $(BIN)/python $$file || status=1; done; exit $$status

lock: ## resolve the dependencies anew and write both locks
	rm -rf .venv-lock && $(PYTHON) -m venv .venv-lock
	.venv-lock/bin/python -m pip install --quiet --upgrade 'pip==26.3'
	.venv-lock/bin/python -m pip install --quiet 'torch==2.13.0' --group build '.[boosting,cluster]'
	.venv-lock/bin/python -m pip freeze --exclude kiribench | sed 's/+cpu//' > requirements.lock
	.venv-lock/bin/python -m pip install --quiet --group bench
	.venv-lock/bin/python -m pip freeze --exclude kiribench | sed 's/+cpu//' > requirements-dev.lock
	rm -rf .venv-lock

clean: ## remove what the targets above made
	rm -rf .venv reports/demo
