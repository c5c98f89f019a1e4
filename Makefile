# make train: install what is needed, train the default policy, print the table.
# make shell: a shell in which `magwire` and `python` are those of .venv.
# make docs:  the pages of docs/ with an API reference, as a site in site/.
# make test:  install what is needed, run the whole suite.
# make bench: the speed benchmarks, ratios from one run.
# make pictures: the README's pictures anew.
# make floors: a smoke test on the lowest versions that pyproject.toml allows.

PYTHON ?= python3
VENV   := .venv
PY     := $(VENV)/bin/python
PIP    := $(PY) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: train shell docs test lint bench pictures floors floors-core clean

train: $(VENV)/train.stamp
	$(PY) train.py $(ARGS)
	@echo
	@echo "Next, in this environment:   . $(VENV)/bin/activate      (or: make shell)"
	@echo "Then, for example:           magwire --help"

shell: $(VENV)/train.stamp
	@. $(VENV)/bin/activate && exec "$${SHELL:-/bin/sh}"

docs: $(VENV)/docs.stamp
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict --quiet
	@echo "open site/index.html"

test: $(VENV)/test.stamp
	$(PY) -m pytest -n 2 $(ARGS)

lint: $(VENV)/test.stamp
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(VENV)/bin/lint-imports --no-cache

bench: $(VENV)/test.stamp
	$(PY) -m tests.speed.bench $(ARGS)

pictures: $(VENV)/test.stamp
	$(PY) -m agents.cli.pictures docs/pictures

# The lowest versions that pyproject.toml allows, first the core without extras.
floors-core:
	rm -rf $(VENV)-floor && $(PYTHON) -m venv $(VENV)-floor
	$(VENV)-floor/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints-floor.txt .
	cd tests && ../$(VENV)-floor/bin/python -P floors.py

floors: floors-core
	$(VENV)-floor/bin/python -m pip install --quiet --disable-pip-version-check torch==2.13.0
	$(VENV)-floor/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints-floor.txt '.[train]'
	cd tests && ../$(VENV)-floor/bin/python -P floors.py --train

clean:
	rm -rf $(VENV) $(VENV)-floor site build dist *.egg-info

# torch first and alone: a pinned version resolves to the CPU build where one is at hand, a range may not.
$(VENV)/train.stamp: pyproject.toml constraints.txt
	test -x $(PY) || $(PYTHON) -m venv $(VENV)
	$(PIP) torch==2.13.0
	$(PIP) --editable '.[train]'
	touch $@

$(VENV)/docs.stamp: $(VENV)/train.stamp
	$(PIP) --editable '.[train,docs]'
	touch $@

$(VENV)/test.stamp: $(VENV)/train.stamp
	$(PIP) --editable '.[train,test,view,cluster,anatomy]'
	touch $@
