# `make check` and `make test` are what CI runs.
PYTHON ?= python3

.PHONY: setup check format test bench

setup:
	$(PYTHON) -m pip install -e '.[all,dev]'

check:
	ruff check .
	ruff format --check .
	mypy
	lint-imports

format:
	ruff check --fix .
	ruff format .

test:
	pytest

bench:
	$(PYTHON) benchmarks/codec.py
	$(PYTHON) benchmarks/mapping.py
	$(PYTHON) benchmarks/rendering.py
	$(PYTHON) benchmarks/pipeline.py
