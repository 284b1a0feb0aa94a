#!/usr/bin/env bash
# Attacks on what reads and writes a user's files, physics at fine steps, a thousand episodes: takes an hour.
# Writes docs/robustness.md. Usage: bash scripts/soak.sh [ARGUMENT OF PYTEST ...]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" test

cd "$root"
python scripts/soak.py "$@"
