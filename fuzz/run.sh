#!/usr/bin/env bash
# Coverage-guided fuzzing with libFuzzer, one worker, on a stable toolchain.
#
#   fuzz/run.sh video SECONDS [SEED ..]        any bytes as a video; seeds are files or folders
#
# ADDRESS=1 builds with AddressSanitizer. The corpora grow in target/fuzz/corpus; what breaks a target is kept in fuzz-found.
set -euo pipefail
cd "$(dirname "$0")/.."
triple=$(rustc -vV | sed -n 's/^host: //p')
folder=target/fuzz/${ADDRESS:+address-}build
flags="--cfg fuzzing -Ccodegen-units=1 -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table
    -Cllvm-args=-sanitizer-coverage-trace-compares ${ADDRESS:+-Zsanitizer=address}"

# The versions that the programs are built of.
[ -e fuzz/Cargo.lock ] || cp Cargo.lock fuzz/Cargo.lock

build() {
    RUSTC_BOOTSTRAP=1 RUSTFLAGS=$(echo $flags) ${CARGO:-cargo} build --quiet --release --manifest-path fuzz/Cargo.toml \
        --target "$triple" --target-dir "$folder" --bin "$@"
}

# A header that claims more memory than this, or an input of more seconds, is a finding.
fuzz() {
    local program=$1 name=$2 seconds=$3
    shift 3
    local corpus=target/fuzz/corpus/$name
    mkdir -p "$corpus" fuzz-found
    ASAN_OPTIONS=detect_leaks=0 "$folder/$triple/release/$program" -max_total_time="$seconds" -timeout=30 -rss_limit_mb=3072 \
        -malloc_limit_mb=1024 -max_len=65536 -print_final_stats=1 -artifact_prefix="fuzz-found/$name-" "$corpus" "$@"
}

case ${1:-} in
    video)
        build video
        seconds=$2
        shift 2
        [ $# -gt 0 ] || set -- crates/decode/tests/data
        fuzz video "${NAME:-video}" "$seconds" "$@"
        ;;
    *)
        sed -n '2,/^set/{s/^# \{0,1\}//;/^set/d;p}' "$0" >&2
        exit 2
        ;;
esac
