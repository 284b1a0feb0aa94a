#!/usr/bin/env bash
# Builds the page's viewer, gantrysim/report/web/viewer.min.js, from its sources there and uPlot, with esbuild.
# Needs node, npm and the npm registry; users of gantrysim need none of them.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
web=$root/gantrysim/report/web
uplot=1.6.32
esbuild=0.25.12

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cp "$web"/*.js "$folder"
rm -f "$folder/viewer.min.js"
cd "$folder"
npm install --silent --no-save --no-audit --no-fund "uplot@$uplot" "esbuild@$esbuild"

digest=$(cd "$web" && ls -- *.js | grep -v '^viewer.min.js$' | LC_ALL=C sort | xargs cat | sha256sum | cut -d' ' -f1)
banner="/* gantrysim's viewer, sources $digest; with uPlot $uplot, MIT, see LICENSE.uplot */"
npx esbuild main.js --bundle --minify --format=iife --target=es2020 --charset=utf8 --legal-comments=none \
    --banner:js="$banner" --outfile="$folder/viewer.min.js" --log-level=warning
cp node_modules/uplot/dist/uPlot.min.css "$web/uplot.css"
cp node_modules/uplot/LICENSE "$web/LICENSE.uplot"
cp viewer.min.js "$web/viewer.min.js"
wc -c "$web/viewer.min.js"
