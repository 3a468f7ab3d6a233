# make compare [ENV=TwoXReach-v0]   the main job: train, compare, report          make test    the tests; make test-all   more of them
# make check                        ruff, formatting, mypy                        make bench   speeds, as ratios
# make analyze                      the papers' figures, regions, numbers            make film    the film in README
# make benchmark   all agents of all ids, 5 seeds each, resumable: most of a day; make who-wins: its matrix
# make docs                         the site, notebooks run: docs/_build/html/index.html
ENV ?= TwoXReach-v0
PYTHON ?= python3
BIN := .venv/bin

.PHONY: compare test test-all check bench benchmark who-wins analyze film docs install clean

compare: .venv/installed
	$(BIN)/python scripts/compare.py $(ENV)

test: .venv/installed
	$(BIN)/python -m pytest -n 2 --dist loadgroup

test-all: .venv/installed
	$(BIN)/python -m pytest -n 2 --dist loadgroup --full

check: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: .venv/installed
	$(BIN)/python scripts/benchmark.py
	$(BIN)/python tests/mechanics/benchmark_workspace.py

benchmark: .venv/installed
	$(BIN)/python scripts/campaign.py --policies agents/tensegrity_agents/policies

who-wins: .venv/installed
	$(BIN)/python scripts/matrix.py
	cp results/matrix/who_wins.png results/matrix/uncertainty.png docs/pictures/

analyze: .venv/installed
	$(BIN)/python scripts/analyze.py two-x
	$(BIN)/python scripts/analyze.py dual-triangle
	$(BIN)/python scripts/analyze.py planar-four-bar
	$(BIN)/python scripts/analyze.py spatial-prism

film: .venv/installed
	$(BIN)/python scripts/compare.py TwoXReach-v0
	cp results/TwoXReach-v0/side_by_side.gif docs/pictures/side_by_side.gif

docs: .venv/docs-installed
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

install: .venv/installed

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[agents,mujoco,dev]"
	@touch $@

.venv/docs-installed: .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[docs]"
	@touch $@

clean:
	rm -rf .venv results docs/_build docs/api/envs docs/api/agents docs/environments
