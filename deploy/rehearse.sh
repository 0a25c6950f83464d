#!/usr/bin/env bash
# A short rehearsal of a wheeled robot with what deploy/install.sh installed, and its score: is the installation whole?
#   deploy/rehearse.sh [PREFIX]
set -euo pipefail
command=${1:-/opt/adatracker}/bin/adatracker-deploy
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
"$command" --platform wheeled --sitl --segmenter truth --steps 40 --log-dir "$logs"
"$command" score "$logs"
