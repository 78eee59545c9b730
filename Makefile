# `make check` and `make test` are what CI runs.
PYTHON ?= python3

.PHONY: setup check audit format test bench

setup:
	$(PYTHON) -m pip install -e '.[all,dev]'

check:
	ruff check .
	ruff format --check .
	mypy
	lint-imports
	bandit -q -c pyproject.toml -r schemas services

# Known vulnerabilities of what is installed: asks PyPI's service, so `check` cannot.
audit:
	pip-audit --skip-editable

format:
	ruff check --fix .
	ruff format .

test:
	pytest

bench:
	$(PYTHON) benchmarks/codec.py
	$(PYTHON) benchmarks/mapping.py
	$(PYTHON) benchmarks/rendering.py
	$(PYTHON) benchmarks/planning.py
	$(PYTHON) benchmarks/pipeline.py
