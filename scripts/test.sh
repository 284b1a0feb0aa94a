#!/usr/bin/env bash
# The whole check, as CI runs it: sets up .venv with the test tools, then ruff, mypy, import-linter and pytest.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" all test

# the pictures' tests need an OpenGL that renders without a display
if ! python -c 'from ctypes.util import find_library as f; raise SystemExit(not (f("EGL") or f("OSMesa")))'; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        apt-get update -qq && apt-get install -qq -y --no-install-recommends libegl1 libgl1-mesa-dri >/dev/null
    else
        echo "note: no EGL and no OSMesa; install Debian package libegl1 (with libgl1-mesa-dri) for the pictures' tests" >&2
    fi
fi

# the tests of a report's viewer need a browser
if ! command -v chromedriver >/dev/null; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        apt-get update -qq && apt-get install -qq -y --no-install-recommends chromium chromium-driver >/dev/null ||
            echo "note: no chromium-driver: the tests of a report's viewer are skipped" >&2
    else
        echo "note: no chromedriver; install Debian packages chromium and chromium-driver for the viewer's tests" >&2
    fi
fi

cd "$root"
export PYTHONDONTWRITEBYTECODE=  # the tests start hundreds of processes, which import a third faster with bytecode
ruff check .
ruff format --check .
# Beside mypy: what many tests call is compiled, and all tests get their bytecode. Each process of pytest would do both
# for itself, as it keeps what it has compiled when it ends.
{
    gantrysim compile gantrysim/jobs/*.toml
    # without others, whose collection takes longer than they run; there may be none among the tests that were asked for
    selected=("$@")
    [ $# -gt 0 ] || mapfile -t selected < <(grep -rl "pytest.mark.first" tests --include "test_*.py")
    pytest -m "first and not soak" --numprocesses 2 --dist worksteal "${selected[@]}" || [ $? = 5 ]
} &
mypy
lint-imports --no-cache
wait $!
# a process more than cores would collect and compile for nothing; the tests of a file share its fixtures;
# there may be none beside the first ones
pytest -m "not first and not soak" --numprocesses "$(getconf _NPROCESSORS_ONLN)" --dist worksteal "$@" ||
    [ $? = 5 ]
