# make help lists the targets. The environment in .venv is built from requirements.lock when missing or stale.
PYTHON ?= python3
PROFILE ?=
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.lock-$(shell cat requirements.lock pyproject.toml | $(PYTHON) -c "import hashlib,sys;print(hashlib.sha256(sys.stdin.buffer.read()).hexdigest()[:16])")
export DVC_NO_ANALYTICS := 1
export MLFLOW_DISABLE_TELEMETRY := true
export PATH := $(CURDIR)/$(BIN):$(PATH)
.DEFAULT_GOAL := help

$(STAMP):
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'hdsafebo needs Python 3.11 or newer; set PYTHON=/path/to/python3.11')"
	@echo "building $(VENV) from requirements.lock"
	@rm -f $(VENV)/.lock-*
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check torch==2.13.0
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	@touch $@

.PHONY: env repro test test-slow test-fast lint mlflow reference lock clean help

env: $(STAMP)  ## build the virtual environment .venv

repro: $(STAMP)  ## run the pipeline; PROFILE=smoke|standard|reference|paper sets its size
	$(if $(PROFILE),$(BIN)/hdsafebo profile $(PROFILE))
	$(BIN)/dvc repro

test: $(STAMP)  ## run the tests (fast ones, and one small run of the whole pipeline)
	$(BIN)/python -m pytest

test-slow: $(STAMP)  ## run all tests, the long ones too
	$(BIN)/python -m pytest -m "slow or not slow"

test-fast: $(STAMP)  ## the tests of the mathematics and the methods: an answer in two minutes of CPU
	$(BIN)/python -m pytest tests/gp tests/search tests/files tests/params tests/runs tests/optimizers

lint: $(STAMP)  ## ruff, mypy and the layer contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

mlflow: $(STAMP)  ## open the MLflow UI on the local store
	$(BIN)/mlflow ui --backend-store-uri sqlite:///mlruns.db --host 127.0.0.1 --port 5000

reference: $(STAMP)  ## run the reference profile (hours, resumable) and refresh reports/reference
	$(BIN)/hdsafebo profile reference
	$(BIN)/dvc repro
	$(BIN)/hdsafebo keep-reference

lock: $(STAMP)  ## pin what is installed now into requirements.lock
	$(BIN)/python -m pip freeze --exclude-editable | sed "s/^\(torch==[0-9.]*\)+cpu/\1/" > requirements.lock

clean:  ## remove the environment, caches and outputs (the journal of runs stays)
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis src/*.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
	rm -rf $(filter-out data/README.md data/mnist,$(wildcard data/*)) $(filter-out models/README.md,$(wildcard models/*))
	rm -rf $(filter-out reports/README.md reports/reference,$(wildcard reports/*))

help:  ## this text
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## ?/\1|/' | awk -F'|' '{printf "  make %-10s %s\n", $$1, $$2}'
