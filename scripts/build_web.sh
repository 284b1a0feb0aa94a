#!/usr/bin/env bash
# Builds the page's viewer from its sources in gantrysim/report/web, with esbuild: viewer.min.js, with uPlot, and the 3-D
# view, viewer3d.min.js.gz, with three.js, compressed as pages carry it; and the workbench, workbench.min.js, from
# gantrysim/live/web and the viewer's sources. Before that TypeScript checks the types in their comments; with the
# argument "check" nothing else is done.
# Needs node, npm and the npm registry; users of gantrysim need none of them.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
web=$root/gantrysim/report/web
live=$root/gantrysim/live/web
uplot=1.6.32
three=0.187.0
esbuild=0.25.12
typescript=5.9.3

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-save --no-audit --no-fund "uplot@$uplot" "three@$three" "@types/three@$three" \
    "esbuild@$esbuild" "typescript@$typescript"
# the workbench imports the viewer's sources from beside its own
mkdir -p report/web live/web
cp "$web"/*.js "$web"/*.mjs "$web"/*.d.ts report/web
cp "$live"/*.js live/web
rm -f ./*/web/*.min.js
cp "$root/scripts/tsconfig.json" .
npx tsc --project .
if [ "${1:-}" = check ]; then
    exit
fi
cp report/web/*.js .

digest=$(cd "$web" && ls -- *.js | grep -v '^viewer.min.js$' | LC_ALL=C sort | xargs cat | sha256sum | cut -d' ' -f1)
bundle() { # SOURCE TARGET LIBRARY FURTHER OPTIONS
    local source=$1 target=$2 library=$3
    shift 3
    npx esbuild "$source" --bundle --minify --format=iife --target=es2022 --charset=utf8 --legal-comments=none \
        --banner:js="/* gantrysim's viewer, sources $digest; with $library */" --outfile="$folder/$target" \
        --log-level=warning "$@"
}
bundle main.js viewer.min.js "uPlot $uplot, MIT, see LICENSE.uplot"
bundle space3d.js viewer3d.min.js "three.js $three, MIT, see LICENSE.three" --global-name=gantrysimSpace
digest=$(cd "$root/gantrysim" && ls -- report/web/*.js live/web/*.js | grep -v '\.min\.js$' | LC_ALL=C sort | xargs cat | sha256sum | cut -d' ' -f1)
bundle live/web/workbench.js workbench.min.js "uPlot $uplot, MIT, see LICENSE.uplot"
cp workbench.min.js "$live/workbench.min.js"
cp node_modules/uplot/dist/uPlot.min.css "$web/uplot.css"
cp node_modules/uplot/LICENSE "$web/LICENSE.uplot"
cp node_modules/three/LICENSE "$web/LICENSE.three"
cp viewer.min.js "$web/viewer.min.js"
gzip -9 --no-name --stdout viewer3d.min.js > "$web/viewer3d.min.js.gz"
wc -c viewer3d.min.js "$web"/viewer*.min.js* "$live"/workbench.min.js
