#!/usr/bin/env bash
# Installs the wheel of ./dist into a fresh environment, runs the demonstration from an empty folder, then the Python tests and
# a notebook (PAIG_NOTEBOOKS=all for all of them). The last line counts tests.
#
# libtorch is that of the checkout (LIBTORCH, or ./libtorch), so nothing large is fetched; PAIG_FETCH=1 fetches it as a user's
# first start does.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if [ -z "${PAIG_FETCH:-}" ]; then
    export PAIG_LIBTORCH=${LIBTORCH:-$root/libtorch/torch}/lib
else
    export PAIG_CACHE=$work/cache
fi
step() {
    local begun=$SECONDS
    echo "== $1"
    shift
    "$@"
    echo "   $((SECONDS - begun)) s"
}
step "fresh environment" "${PYTHON:-python3}" -m venv "$work/environment"
bin=$work/environment/bin
step "install the wheel" "$bin/python" -m pip install --quiet "$root"/dist/paig-*.whl
# The server's library is one that only the program has.
grep -q '"pkg:cargo/axum@' "$work"/environment/lib/python*/site-packages/paig-*.dist-info/sboms/paig.cyclonedx.json
demo() { (cd "$work" && "$bin/paig" demo) > "$work/demo.txt" || { cat "$work/demo.txt"; return 1; }; tail -n 3 "$work/demo.txt"; }
step "paig demo" demo
grep -q '^found' "$work/demo.txt"
step "install what tests need" "$bin/python" -m pip install --quiet pytest mypy nbclient ipykernel
step "tests and notebook" "$bin/python" -m pytest -q --durations=5 -p no:cacheprovider tests/python
