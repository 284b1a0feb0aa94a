#!/usr/bin/env bash
# Runs the tests with their coverage measured, in about twice their time, and writes the table of docs/validation.md.
# Usage: bash scripts/coverage.sh [ARGUMENT OF PYTEST ...]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" all test

cd "$root"
coverage erase
# room by room: a test that plays with file numbers may spoil what its own process has measured
for part in tests/*/ tests/test_*.py; do
    [ "$part" = tests/support/ ] && continue
    # where a test fails because it is measured, as those of imports do, the others still count
    coverage run -m pytest --numprocesses "$(($(getconf _NPROCESSORS_ONLN) + 1))" --dist worksteal "$part" "$@" || true
done
coverage combine --quiet
coverage json --quiet
python scripts/coverage_table.py coverage.json
