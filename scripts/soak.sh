#!/usr/bin/env bash
# A thousand episodes of random actions in every environment: nothing breaks, nothing is left behind. Takes minutes.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" test

cd "$root"
pytest -m soak "$@"
