#!/usr/bin/env bash
# Builds the documentation with search and API pages into site/; a warning, such as a broken link, is an error.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" "" docs

cd "$root"
zensical build --clean --strict
echo "site: $root/site/index.html; with search: python -m http.server --directory site"
