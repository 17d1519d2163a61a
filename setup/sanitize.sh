#!/usr/bin/env bash
# Memory and data-race checks, on a stable toolchain. The last line is JSON with the counts.
#
#   setup/sanitize.sh address    AddressSanitizer: the decoders, the tracker, the resizing and their test clips
#   setup/sanitize.sh kernels    the same of the kernels, with UndefinedBehaviorSanitizer in their C++ (needs libtorch)
#   setup/sanitize.sh thread     ThreadSanitizer: the thread that decodes ahead; needs the nightly toolchain and rust-src
#   setup/sanitize.sh miri       Miri: threads and activations of the kernels; needs the nightly toolchain with miri
#   setup/sanitize.sh valgrind   memcheck on the commands of a small video; needs valgrind and target/release/paig
set -uo pipefail
cd "$(dirname "$0")/.."
cargo=${CARGO:-cargo}
triple=$(rustc -vV | sed -n 's/^host: //p')
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# More damaged copies of a stream would take hours here; fuzz/run.sh has them.
export DAMAGED_COPIES=${DAMAGED_COPIES:-2} PROPTEST_CASES=${PROPTEST_CASES:-32}

# Tests with a sanitizer, in a folder of their own: its flags change every crate.
tests() {
    local sanitizer=$1
    shift
    RUSTC_BOOTSTRAP=1 RUSTFLAGS="-Zsanitizer=$sanitizer ${LINK:-}" RUSTDOCFLAGS="-Zsanitizer=$sanitizer" \
        $cargo test --release --no-fail-fast --target "$triple" --target-dir "target/sanitize/$sanitizer" "$@" 2>&1 | tee "$log"
}

# Of the last tests: how many passed or failed, and how many reports there were.
count() {
    local name=$1 passed failed reports
    passed=$(grep -oE '[0-9]+ passed;' "$log" | awk '{ sum += $1 } END { print sum + 0 }')
    failed=$(grep -oE '[0-9]+ failed;' "$log" | awk '{ sum += $1 } END { print sum + 0 }')
    reports=$(grep -cE 'ERROR: (Address|Leak)Sanitizer|WARNING: ThreadSanitizer|runtime error:|Undefined Behavior' "$log")
    echo "{\"${name}_tests\": $((passed + failed)), \"${name}_failed\": $failed, \"${name}_reports\": $reports}"
    [ "$failed" -eq 0 ] && [ "$reports" -eq 0 ] && [ "$passed" -gt 0 ]
}

case ${1:-} in
    address)
        tests address --package paig-decode --package paig-resize --package paig-track
        count asan
        ;;
    kernels)
        # libtorch and OpenMP keep what they allocated once until the process ends.
        printf 'leak:libtorch\nleak:libc10\nleak:libgomp\nleak:libiomp5\nleak:libmkl\n' > target/sanitize.suppressions
        export LSAN_OPTIONS=suppressions=$PWD/target/sanitize.suppressions:print_suppressions=0
        # `vptr` needs the type information of libtorch's classes, which are not instrumented.
        export CXXFLAGS="-fsanitize=address,undefined -fno-sanitize=vptr -fno-omit-frame-pointer"
        LINK="-Clink-arg=-lubsan" tests address --package paig-kernels --lib
        count ubsan
        ;;
    thread)
        cargo="$cargo +nightly" tests thread -Zbuild-std --package paig-decode --test streams
        count tsan
        ;;
    miri)
        # Without libtorch, which Miri cannot call, and on the portable path: it lacks AVX-512.
        MIRIFLAGS=-Zmiri-disable-isolation $cargo +nightly miri test --target-dir target/sanitize/miri \
            --package paig-kernels --features doc-only --lib -- threads:: lstm_cell:: 2>&1 | tee "$log"
        count miri
        ;;
    valgrind)
        work=$(mktemp -d)
        trap 'rm -rf "$log" "$work"' EXIT
        # The widest instructions are unknown to valgrind.
        ATEN_CPU_CAPABILITY=default PAIG_INSTRUCTIONS=portable valgrind --error-exitcode=9 \
            --suppressions=setup/valgrind.supp target/release/paig import tests/data/numbered.mp4 --input-steps 3 \
            --pred-steps 2 --out "$work/task" 2>&1 | tee "$log"
        reports=$(grep -oE 'ERROR SUMMARY: [0-9]+' "$log" | grep -oE '[0-9]+')
        echo "{\"valgrind_tests\": 1, \"valgrind_reports\": ${reports:-1}}"
        [ "${reports:-1}" -eq 0 ]
        ;;
    *)
        sed -n '2,/^set/{s/^# \{0,1\}//;/^set/d;p}' "$0" >&2
        exit 2
        ;;
esac
