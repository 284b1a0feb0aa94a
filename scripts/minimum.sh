#!/usr/bin/env bash
# Tries the lowest versions that pyproject.toml admits: .venv-minimum with constraints-minimum.txt, and a part of the tests.
# Usage: minimum.sh [TESTS]. PYTHON names the interpreter, by default python3.11, the oldest that is supported.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

extras=dask,drawings,film,learning,tables  # rl would bring gigabytes of PyTorch
# nothing here compares exact figures of pictures or libraries: these tests touch every package
tests=(
    tests/test_strangers.py
)

"${PYTHON:-python3.11}" -m venv --clear .venv-minimum
PATH="$PWD/.venv-minimum/bin:$PATH"
export PIP_CONSTRAINT=constraints-minimum.txt PIP_DISABLE_PIP_VERSION_CHECK=1
python -m pip install --quiet ".[$extras]" imageio pytest hypothesis
# beside the checkout's own, which another version of numba has compiled
export NUMBA_CACHE_DIR="$PWD/.venv-minimum/numba"
python -m pytest -p no:cacheprovider "${@:-${tests[@]}}"
