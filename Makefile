# make train: install what is needed, train the default policy, print the table.
# make test:  install what is needed, run the whole suite.
# make bench: the speed benchmarks, ratios from one run.
# make pictures: the README's pictures anew.

PYTHON ?= python3
VENV   := .venv
PY     := $(VENV)/bin/python
PIP    := $(PY) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: train test lint bench pictures clean

train: $(VENV)/train.stamp
	$(PY) train.py $(ARGS)

test: $(VENV)/test.stamp
	$(PY) -m pytest -n 2 $(ARGS)

lint: $(VENV)/test.stamp
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

bench: $(VENV)/test.stamp
	$(PY) -m tests.speed.bench $(ARGS)

pictures: $(VENV)/test.stamp
	$(PY) -m agents.cli.pictures docs/pictures

clean:
	rm -rf $(VENV) build dist *.egg-info

# torch first and alone: a pinned version resolves to the CPU build where one is at hand, a range may not.
$(VENV)/train.stamp: pyproject.toml constraints.txt
	test -x $(PY) || $(PYTHON) -m venv $(VENV)
	$(PIP) torch==2.13.0
	$(PIP) --editable '.[train]'
	touch $@

$(VENV)/test.stamp: $(VENV)/train.stamp
	$(PIP) --editable '.[train,test,view]'
	touch $@
