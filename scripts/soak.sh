#!/usr/bin/env bash
# Runs the long tests: attacks on readers and writers of files, physics at fine steps, a thousand episodes, and all cases
# and examples of tests that the suite tries on some. Takes two hours.
# Writes the table of docs/validation.md. Usage: bash scripts/soak.sh [ARGUMENT OF PYTEST ...]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" all test

cd "$root"
python scripts/soak.py "$@"
