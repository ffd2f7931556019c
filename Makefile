# make help lists the targets. The environment in .venv is built from requirements.lock when missing or stale.
PYTHON ?= python3
PROFILE ?=
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
LOCKS := requirements.lock requirements-cuda.lock
STAMP := $(VENV)/.lock-$(shell cat $(LOCKS) pyproject.toml | $(PYTHON) -c "import hashlib,sys;print(hashlib.sha256(sys.stdin.buffer.read()).hexdigest()[:16])")
export DVC_NO_ANALYTICS := 1
export MLFLOW_DISABLE_TELEMETRY := true
export PATH := $(CURDIR)/$(BIN):$(PATH)
# All that stages write, as dvc.yaml names it (tested): `make clean` removes this and no more.
OUTPUTS := data/body data/code data/policies data/rollouts data/runs data/spinal data/synergies \
	models/digits models/embeddings models/sac models/synergies \
	reports/curves reports/figures reports/tables reports/index.html reports/summary.json \
	reports/isometry.json reports/isometry_pairs.parquet
.DEFAULT_GOAL := help

$(STAMP):
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'hdsafebo needs Python 3.11 or newer; set PYTHON=/path/to/python3.11')"
	@echo "building $(VENV) from requirements.lock"
	@rm -f $(VENV)/.lock-*
	$(PYTHON) -m venv $(VENV)
	$(PIP) --no-deps --require-hashes -r requirements.lock
	@case "$$($(BIN)/python -c 'from importlib.metadata import version; print(version("torch"))')" in \
		*+cpu) ;; *) $(PIP) --no-deps --require-hashes -r requirements-cuda.lock ;; esac
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

.PHONY: env repro test test-slow test-fast lint mlflow reference lock docs tutorials package clean help

env: $(STAMP)  ## build the virtual environment .venv

repro: $(STAMP)  ## run the pipeline; PROFILE=smoke|standard|reference|paper sets its size
	$(if $(PROFILE),$(BIN)/hdsafebo profile $(PROFILE))
	@git rev-parse --git-dir >/dev/null 2>&1 || $(BIN)/dvc config --local core.no_scm true
	$(BIN)/dvc repro

test: $(STAMP)  ## run the tests (fast ones, and one small run of the whole pipeline)
	$(BIN)/python -m pytest

test-slow: $(STAMP)  ## run all tests, the long ones too
	$(BIN)/python -m pytest -m "slow or not slow"

test-fast: $(STAMP)  ## the tests of the mathematics and the methods: an answer in two minutes of CPU
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "not slow and not thorough" tests/gp tests/search tests/files tests/params \
		tests/runs tests/optimizers

lint: $(STAMP)  ## ruff, mypy and the layer contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

mlflow: $(STAMP)  ## open the MLflow UI on the local store, and print where its runs are
	$(BIN)/hdsafebo mlflow

reference: $(STAMP)  ## run the reference profile (hours, resumable) and refresh reports/reference
	$(BIN)/hdsafebo profile reference
	$(BIN)/dvc repro
	$(BIN)/hdsafebo keep-reference

lock: $(STAMP)  ## pin all packages with their hashes, from pyproject.toml; UPGRADE=--upgrade takes the newest
	$(PIP) uv
	$(BIN)/python tools/lock.py $(UPGRADE)

docs: $(STAMP)  ## write the pages that come from the code and build the documentation into site/, warnings are errors
	$(BIN)/python -m tools.docs
	$(BIN)/zensical build --strict --config-file mkdocs.yml
	$(BIN)/python -m tools.docs --finish site
	$(BIN)/python tools/check_site.py site

tutorials: $(STAMP)  ## run the tutorials and write their pages and pictures
	$(BIN)/python -m tools.docs --tutorials

package: $(STAMP)  ## build wheel and source archive, and install them into clean environments with each extra (minutes)
	$(PIP) uv
	$(BIN)/python tools/check_package.py

clean:  ## remove the environment, caches and what the pipeline made; sessions and the journal of runs stay
	rm -rf $(VENV) build dist site $(wildcard .*_cache) .hypothesis src/*.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
	rm -rf $(OUTPUTS)

help:  ## this text
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## ?/\1|/' | awk -F'|' '{printf "  make %-10s %s\n", $$1, $$2}'
