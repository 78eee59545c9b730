#!/usr/bin/env bash
# Makes the README's film: six cameras around a bunny that drives, breathes and bends, for 6 s that end as they
# began: it drives two squares of the ground, breathes twice and bends once, and the view sways to and fro.
set -euo pipefail
cd "$(dirname "$0")"
recording=$(mktemp -d)/hexagon.mcap

encircle run --headless --no-viewer --duration 10.5 --record "$recording" --runs "$(dirname "$recording")" \
  --path line --semi-axes 0.5 0.5 --lap 6 --deformation breathing:0.12:0.33333333+bend:0.45:0.16666667
encircle export "$recording" --to video --out hexagon.webp --start 4 --end 10 \
  --size 800x450 --theme dark --view sway --trail 3
