#!/usr/bin/env bash
# Runs the tests with their coverage measured, in about twice their time, and writes the table of docs/validation.md.
# Usage: bash scripts/coverage.sh [ARGUMENT OF PYTEST ...]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" test

cd "$root"
coverage erase
coverage run -m pytest --numprocesses "$(($(getconf _NPROCESSORS_ONLN) + 1))" --dist worksteal "$@"
coverage combine --quiet
coverage json --quiet
python scripts/coverage_table.py coverage.json
