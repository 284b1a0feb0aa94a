#!/usr/bin/env bash
# Tries the lowest versions that pyproject.toml admits: .venv-minimum with constraints-minimum.txt, and a part of the tests.
# Usage: minimum.sh [TESTS]. PYTHON names the interpreter, by default python3.11, the oldest that is supported.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

extras=dask,drawings,film,learning,live,notebook,tables  # rl would bring gigabytes of PyTorch
tests=(  # each package is used by some of these
    tests/test_extras.py tests/cli/test_help_and_names.py tests/cli/test_widths.py tests/controllers/test_mc_basic.py
    tests/controllers/drawings tests/env/test_env.py tests/env/test_env_registration.py tests/exchange/test_tables.py
    tests/job/test_job.py tests/engine/native/test_tick.py tests/live/test_safety.py tests/render/test_film.py
    tests/report/plots tests/report/test_document.py tests/report/test_notebook.py
    tests/study/test_study_backends.py tests/tables
    "tests/test_strangers.py::test_a_module_is_imported_alone"
    "tests/test_strangers.py::test_a_record_of_every_built_in_job_is_loaded"
)

"${PYTHON:-python3.11}" -m venv --clear .venv-minimum
PATH="$PWD/.venv-minimum/bin:$PATH"
export PIP_CONSTRAINT=constraints-minimum.txt PIP_DISABLE_PIP_VERSION_CHECK=1
# the client of the oldest starlette, with which its apps are tested, is made of httpx
python -m pip install --quiet ".[$extras]" imageio pytest hypothesis httpx
# old packages use what is deprecated in the newest of those that they bring along
python -m pytest -q -p no:cacheprovider -W default::DeprecationWarning "${@:-${tests[@]}}"
