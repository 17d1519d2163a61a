#!/usr/bin/env bash
# Tests and lints, none skipped because another failed. The last line counts tests; after a failure the lines before it name what
# failed and what its results depend on: processor, vector path, libtorch's CPU capability.
#
#   setup/test.sh all        every test on the widest vector path, the short tests of the others, lints
#   setup/test.sh paths      the short tests of the other vector paths alone
set -uo pipefail
cd "$(dirname "$0")/.."
cargo=${CARGO:-cargo}
profile=ci
# Tests run beside each other. libtorch's threads that wait leave the processor to them: a third of the time on two cores.
export OMP_WAIT_POLICY=passive
program=${CARGO_TARGET_DIR:-target}/$profile/paig
log=$(mktemp)
trap 'rm -f "$log"' EXIT
broken=()

# A step's name, then its command; the output is kept for the count.
step() {
    local name=$1
    shift
    echo "== $name: $*"
    "$@" 2>&1 | tee -a "$log" || broken+=("$name")
}

# What computes differently on each path: kernels, the model against libtorch and the goldens, whole trainings. Not those of the
# path in `$1`, which all tests have run on.
paths() {
    local path
    for path in portable avx2; do
        [ "$path" = "${1:-}" ] && continue
        if [ "$path" = avx2 ] && ! grep -qw avx2 /proc/cpuinfo; then
            echo "== vector path avx2: this processor lacks it"
            continue
        fi
        short() {
            local what=$1
            shift
            step "vector path $path, $what" env PAIG_INSTRUCTIONS="$path" \
                "$cargo" test --profile "$profile" --workspace --no-fail-fast "$@"
        }
        short kernels --test kernels
        short model --test library -- kernel_extremes:: cells:: refinement::
        short training --test programs -- training::a_short training::divergence training::a_join_that_diverges
    done
}

case ${1:-all} in
    all)
        step tests "$cargo" test --profile "$profile" --workspace --no-fail-fast
        paths "$("$program" --version | sed -n 's/.*vector path //p')"
        step lints "${MAKE:-make}" --keep-going lint PROFILE="$profile"
        ;;
    paths) paths ;;
    *)
        echo "expected all or paths, found $1" >&2
        exit 2
        ;;
esac

sum() {
    grep -oE "[0-9]+ $1;" "$log" | awk '{ count += $1 } END { print count + 0 }'
}
if [ ${#broken[@]} -gt 0 ]; then
    echo
    grep -E '^test .* FAILED$' "$log" | sort -u
    "$program" --version || true
    printf 'failed: %s\n' "${broken[@]}"
fi
echo "$(sum passed) passed, $(sum failed) failed"
[ ${#broken[@]} -eq 0 ]
