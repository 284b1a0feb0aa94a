#!/usr/bin/env bash
# From a fresh machine to figures, plots and a video: sets up .venv and runs the main job into out/an225/.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh" drawings,film

if [ -n "$installed" ]; then
    echo "compiling the functions of a run, once for this machine (some 25 s)"
    gantrysim compile >/dev/null
fi
gantrysim run an225 --out "$root/out/an225"
echo "report: $root/out/an225/report.html"
if [ -f "$root/out/an225/video.mp4" ]; then
    echo "video: $root/out/an225/video.mp4"
fi
