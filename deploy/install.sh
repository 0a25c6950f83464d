#!/usr/bin/env bash
# Installs the toolkit of this checkout into an environment of its own. docs/on-board.md says what for.
#
#   deploy/install.sh [--prefix DIR] [--extras LIST] [--exact] [--onnxruntime REQUIREMENT] [--python PYTHON]
#   deploy/install.sh --system        # as root: units, udev rules, limits, user; starts and enables nothing
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
prefix=/opt/adatracker extras=wheeled,quadruped,drone,live exact= onnxruntime= python=python3 system=

refuse() {
    echo "install.sh: $1" >&2
    exit 2
}

while [ $# -gt 0 ]; do
    case $1 in
    --exact) exact=1 ;;
    --system) system=1 ;;
    --prefix | --extras | --onnxruntime | --python)
        [ $# -gt 1 ] || refuse "$1 wants a value"
        case $1 in
        --prefix) prefix=$2 ;;
        --extras) extras=$2 ;;
        --onnxruntime) onnxruntime=$2 ;;
        --python) python=$2 ;;
        esac
        shift
        ;;
    *) refuse "unknown option $1; known are --prefix, --extras, --exact, --onnxruntime, --python and --system" ;;
    esac
    shift
done

if [ -n "$system" ]; then # DESTDIR: for packages and tests
    etc=${DESTDIR:-}/etc
    for unit in "$root"/deploy/systemd/*.service; do
        install -Dm644 "$unit" "$etc/systemd/system/$(basename "$unit")"
    done
    install -Dm644 "$root/deploy/systemd/watchdog.conf" "$etc/systemd/system.conf.d/50-adatracker-watchdog.conf"
    install -Dm644 "$root/deploy/sysusers/adatracker.conf" "$etc/sysusers.d/adatracker.conf"
    install -Dm644 "$root/deploy/udev/60-adatracker.rules" "$etc/udev/rules.d/60-adatracker.rules"
    install -Dm644 "$root/deploy/limits/adatracker.conf" "$etc/security/limits.d/adatracker.conf"
    [ -e "$etc/adatracker/robot.env" ] ||
        install -Dm644 "$root/deploy/systemd/robot.env" "$etc/adatracker/robot.env"
    echo "installed below $etc; now: systemd-sysusers && udevadm control --reload && systemctl daemon-reload"
    exit
fi

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    refuse "$python is older than Python 3.11: give a newer one with --python (docs/on-board.md says where from)"
"$python" -m venv "$prefix"
pip=("$prefix/bin/python" -m pip --disable-pip-version-check install --quiet)
if [ -n "$exact" ]; then # what was tested: wheels with these hashes, and this checkout
    "${pip[@]}" --require-hashes --requirement "$root/deploy/requirements.txt"
    "${pip[@]}" --no-deps "$root"
else
    "${pip[@]}" "$root[$extras]"
fi
if [ -n "$onnxruntime" ]; then # never two: they overwrite each other's files
    "$prefix/bin/python" -m pip --quiet uninstall --yes onnxruntime
    "${pip[@]}" "$onnxruntime"
fi
"$prefix/bin/adatracker-deploy" --version
echo "$(du -sm "$prefix" | cut -f1) MB in $prefix"
