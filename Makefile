# The commands of this repository. Each recipe is one line; the work is in scripts/.
# PYTHON=/path/to/python3 chooses the interpreter (3.11 or newer); without it, make uses the newest installed one.
PYTHON ?=
export PYTHON
VENV := .venv
# Stamps of the installation: rarms itself, and the requirements of its tests and checks.
RUNS := $(VENV)/.installed
TESTS := $(VENV)/.installed-dev

.DEFAULT_GOAL := help
.PHONY: help demo demo-linux demo-ros test test-long coverage test-lowest lint test-benchmarks test-windows test-powershell generated counts lock figures evaluation pictures docs bench release clean

help: ## Show this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' Makefile | while IFS='|' read -r name says; do printf '%-22s %s\n' "$$name" "$$says"; done

demo: $(RUNS) ## Measure, plan, apply and prove the delivery robot on the simulated host
	@scripts/demo

demo-linux: $(RUNS) ## The same with real components on this Linux; as root, three to five minutes
	@scripts/demo-linux

demo-ros: $(RUNS) ## The same with ROS 1 nodes from Debian; as root, five minutes
	@scripts/demo-ros

test: $(TESTS) ## Run all tests except tests/system and tests/real_powershell, and samples of these
	@scripts/test

test-long: $(TESTS) ## Run all tests with the large counts, then unit tests and laws on all Pythons (hours)
	@RARMS_LONG=1 scripts/test && scripts/all-pythons

coverage: $(TESTS) ## Run the tests of CI and print the branch coverage (half an hour and more)
	@CI=true RARMS_COVERAGE=1 scripts/test

test-lowest: $(TESTS) ## Run the tests of code that uses dependencies, with their lowest allowed versions
	@scripts/lowest-versions

test-benchmarks: $(TESTS) ## Run the tests of the benchmarks, the paper's figures and the Linux evaluation
	@.venv/bin/python -m pytest --numprocesses auto benchmarks/tests

lint: $(TESTS) ## Run ruff, mypy, the import contracts, vulture, our own rules, zizmor and hadolint
	@scripts/lint

test-windows: $(TESTS) ## Run the tests of files, paths and processes with CPython for Windows (wine)
	@scripts/windows-tests

test-powershell: $(TESTS) ## Run the generated scripts with PowerShell for Windows (wine) and for Linux
	@scripts/powershell-tests

generated: $(TESTS) ## Write the generated files: schemas, references, the index of findings
	@scripts/generate

counts: $(TESTS) ## Print the size of the code base: ids, classes, modules, lines, functions of a plan
	@.venv/bin/python -m scripts.counts

lock: $(TESTS) ## Write locked-requirements.txt again, after a change of dependencies
	@scripts/lock

figures: $(TESTS) ## Draw the paper's figures from the simulated host, with the paper's numbers
	@scripts/figures

evaluation: $(TESTS) ## Draw these figures and more from real components; as root, half an hour
	@scripts/evaluation

pictures: $(TESTS) ## Draw the pictures of the tutorial, of a pull request's comment and of the studio
	@$(VENV)/bin/python -m scripts.pictures
	@$(VENV)/bin/python -m scripts.comment_picture
	@$(VENV)/bin/python -m scripts.studio_picture

docs: $(TESTS) ## Render the documentation into .cache/site; fails at broken links
	@$(VENV)/bin/zensical build --strict

bench: $(TESTS) ## Run all benchmarks; the results are ratios within one run
	@scripts/bench

release: $(TESTS) ## Build this version, test the wheel, and list the remaining manual steps
	@scripts/release

clean: ## Remove .venv and all other generated files
	@rm -rf $(VENV) .cache dist .coverage .coverage.* .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

$(RUNS): pyproject.toml scripts/make-venv
	@scripts/make-venv $(VENV) && touch $@

$(TESTS): pyproject.toml scripts/make-venv
	@scripts/make-venv $(VENV) dev && touch $(RUNS) $@
