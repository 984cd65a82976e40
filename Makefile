# What a person runs. Each recipe is one line; the work is in scripts/.
# PYTHON=/path/to/python3 chooses the interpreter (3.11 or newer); without it the newest found is taken.
PYTHON ?=
export PYTHON
VENV := .venv
# Stamps: rarms itself is installed; and so is what its tests and checks need.
RUNS := $(VENV)/.installed
TESTS := $(VENV)/.installed-dev

.DEFAULT_GOAL := help
.PHONY: help demo demo-linux demo-ros test test-long coverage test-lowest lint test-benchmarks test-windows test-powershell generated counts lock figures evaluation pictures docs bench release clean

help: ## Show this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' Makefile | while IFS='|' read -r name says; do printf '%-20s %s\n' "$$name" "$$says"; done

demo: $(RUNS) ## The delivery robot, from its manifest to an applied plan on the simulated host
	@scripts/demo

demo-linux: $(RUNS) ## The same with real components on this Linux, as root; three to five minutes
	@scripts/demo-linux

demo-ros: $(RUNS) ## A robot of ROS 1 nodes from Debian, measured by the time between messages, as root; five minutes
	@scripts/demo-ros

test: $(TESTS) ## All tests but tests/system and tests/real_powershell, and of these one of each kind
	@scripts/test

test-long: $(TESTS) ## All tests with the large counts, then unit tests and laws on all Pythons (hours)
	@RARMS_LONG=1 scripts/test && scripts/all-pythons

coverage: $(TESTS) ## All that CI tests, and the share of branches that it takes (half an hour and more)
	@CI=true RARMS_COVERAGE=1 scripts/test

test-lowest: $(TESTS) ## Tests of code that uses dependencies, with their lowest allowed versions
	@scripts/lowest-versions

test-benchmarks: $(TESTS) ## The tests of benchmarks, the paper's figures and the Linux evaluation
	@.venv/bin/python -m pytest --numprocesses auto benchmarks/tests

lint: $(TESTS) ## ruff, mypy, the import contracts, dead code and rules of our own
	@scripts/lint

test-windows: $(TESTS) ## Tests of code that uses files, paths or processes, under the real Windows CPython (wine)
	@scripts/windows-tests

test-powershell: $(TESTS) ## The generated scripts under the real PowerShell, for Windows (wine) and for Linux
	@scripts/powershell-tests

generated: $(TESTS) ## Write what is made from the code: schemas, references, the index of findings
	@scripts/generate

counts: $(TESTS) ## The size of the code base: ids, classes, modules, lines by room, what a plan runs
	@.venv/bin/python -m scripts.counts

lock: $(TESTS) ## The versions that the Action installs, with their hashes; after a change of dependencies
	@scripts/lock

figures: $(TESTS) ## The paper's figures on the simulated host, with its numbers next to them
	@scripts/figures

evaluation: $(TESTS) ## The same, and more, from real components on this Linux, as root (half an hour)
	@scripts/evaluation

pictures: $(TESTS) ## The tutorial's pictures of a terminal, that of a pull request's comment, and that of the studio
	@$(VENV)/bin/python -m scripts.pictures
	@$(VENV)/bin/python -m scripts.comment_picture
	@$(VENV)/bin/python -m scripts.studio_picture

docs: $(TESTS) ## The rendered documentation, in .cache/site; fails at links that lead nowhere
	@$(VENV)/bin/zensical build --strict

bench: $(TESTS) ## All benchmarks, as ratios measured in one run
	@scripts/bench

release: $(TESTS) ## Build this version, try the wheel in a fresh environment, list what a person still has to do
	@scripts/release

clean: ## Remove .venv and everything else that was made here
	@rm -rf $(VENV) .cache dist .coverage .coverage.* .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

$(RUNS): pyproject.toml scripts/make-venv
	@scripts/make-venv $(VENV) && touch $@

$(TESTS): pyproject.toml scripts/make-venv
	@scripts/make-venv $(VENV) dev && touch $(RUNS) $@
