# Sourced by demo.sh and test.sh: makes .venv beside the project and installs it, pinned by constraints.txt.
# Usage: source setup.sh [EXTRA[,EXTRA ...] [GROUP]], extras and dependency group of pyproject.toml. Leaves $root,
# .venv/bin first in $PATH, and in $installed "yes" where it has installed now.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
extra=${1:+[$1]}
group=${2:-}

find_python() {
    local candidate
    for candidate in "${PYTHON:-python3}" python3 python3.14 python3.13 python3.12 python3.11; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    echo "error: no Python 3.11 or later found; name one as in PYTHON=python3.12 bash $0" >&2
    return 1
}

if ! "$root/.venv/bin/python" -m pip --version >/dev/null 2>&1; then
    python=$(find_python) || exit 2
    if ! "$python" -m venv --clear "$root/.venv" >/dev/null; then
        echo "error: $python cannot make a virtual environment: install Debian package python3-venv" >&2
        exit 2
    fi
fi
PATH="$root/.venv/bin:$PATH"

# install again only where what is asked for has changed
wanted=$(cat "$root/pyproject.toml" "$root/constraints.txt" "$root/gantrysim/__init__.py" | cksum)
installed=
stamp="$root/.venv/installed${1:+-$1}${group:+-$group}"
if [ "$(cat "$stamp" 2>/dev/null)" != "$wanted" ]; then
    echo "installing gantrysim$extra into .venv (the first time takes a minute or two)"
    # from within the folder: pip splits the constraints' path at spaces
    (
        cd "$root"
        export PIP_CONSTRAINT=constraints.txt PIP_DISABLE_PIP_VERSION_CHECK=1
        if [ -n "$group" ]; then
            .venv/bin/python -m pip install --quiet "pip>=25.1"  # the first that reads dependency groups
        fi
        .venv/bin/python -m pip install --quiet --editable ".$extra" ${group:+--group "$group"}
    )
    echo "$wanted" >"$stamp"
    installed=yes
fi
