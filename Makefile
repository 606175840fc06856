# Everything here works from a fresh clone with nothing but python3 (3.11 or newer) and make.

.DEFAULT_GOAL := help
.NOTPARALLEL:
.DELETE_ON_ERROR:
.PHONY: help demo test test-slow docs bench format clean

PYTHON ?= python3
JOBS ?= 2
TRIALS ?= 100
DEMO ?= demo

# One BLAS thread: the batches are small, and timings must not depend on the machine's idle cores.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MPLBACKEND := Agg
# Byte code is kept: without it every worker and every command that a test starts compiles the project again.
unexport PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE

# Recorded data beside the project; tests that need it are skipped where there is none.
ifeq ($(strip $(QUIETFIX_DATA)),)
ifneq ($(wildcard ../shared/data/.),)
export QUIETFIX_DATA := $(abspath ../shared/data)
endif
endif

ENVIRONMENT := $(PYTHON) .ci/environment.py
TEST_EXTRAS := test,bench
FAST := -m "not slow" -n $(JOBS)

help: ## show what make can do
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 18

demo: ## install, and run 100 trials of three_satellite into demo/
	@$(ENVIRONMENT) .venv
	.venv/bin/quietfix run three_satellite --trials $(TRIALS) --out $(DEMO) --overwrite

test: ## lint, types, the fast tests; these also under Python 3.12 or 3.13 where there is one
	@$(ENVIRONMENT) .venv --extras $(TEST_EXTRAS)
	.venv/bin/ruff check --quiet .
	.venv/bin/ruff format --check --quiet .
	.venv/bin/mypy
	.venv/bin/python -m pytest $(FAST)
	@newer=$$($(ENVIRONMENT) --find-newer) || exit 1; \
	if [ -z "$$newer" ]; then \
		echo "make test: skipped under a second Python: python3 is 3.12 or newer itself, or neither" \
			"python3.13 nor python3.12 runs on the PATH or under pyenv"; \
	else \
		$(ENVIRONMENT) .venv-new --extras $(TEST_EXTRAS) --python "$$newer" && \
		echo ".venv-new/bin/python -m pytest: Python and Drake" \
			"$$(.venv-new/bin/python -c 'import platform, importlib.metadata as m; print(platform.python_version(), m.version("drake"))')" && \
		.venv-new/bin/python -m pytest $(FAST); \
	fi

test-slow: ## studies at full size, notebooks, packaging
	@$(ENVIRONMENT) .venv --extras $(TEST_EXTRAS)
	.venv/bin/python -m pytest -m slow -n $(JOBS) --durations 10

docs: ## the site, into docs/_build/html; its examples are run, a warning is an error
	@$(ENVIRONMENT) .venv --extras $(TEST_EXTRAS),docs
	.venv/bin/python -m sphinx -b html -W --keep-going -n -q docs docs/_build/html
	@echo "docs/_build/html/index.html"

bench: ## the speed table (BENCH_ARGS are passed on)
	@$(ENVIRONMENT) .venv --extras $(TEST_EXTRAS)
	.venv/bin/python -m tests.benchmarks $(BENCH_ARGS)

format: ## sort imports, fix what ruff can fix, format
	@$(ENVIRONMENT) .venv --extras $(TEST_EXTRAS)
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

clean: ## remove environments, caches, builds and the demo's results
	rm -rf .venv .venv-new build dist docs/_build *.egg-info .mypy_cache .pytest_cache .ruff_cache demo demo.partial
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
