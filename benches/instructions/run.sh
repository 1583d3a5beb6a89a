#!/bin/sh
# Instructions of one pass of the main kernels, beside the stored counts.
#
#   benches/instructions/run.sh [--store]
#
# Counted by valgrind, which has no AVX-512, so on the AVX2 path: the same number on every
# machine and however busy it is. Fails where a count has grown by more than TOLERANCE
# percent; --store replaces the counts. They belong to one compiler: with another the
# comparison is printed and does not fail.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
stored=$here/counts.txt
tolerance=3

case "$(uname -m)" in
x86_64) ;;
*)
    echo "instruction counts are kept for x86-64 only"
    exit 0
    ;;
esac
if ! command -v valgrind >/dev/null; then
    apt-get install -qq -y valgrind >/dev/null 2>&1 || {
        echo "valgrind is not there and cannot be installed: instructions are not counted" >&2
        exit 0
    }
fi
compiler=$(rustc --version)
program=$(cargo bench --no-run --bench throughput --message-format=json 2>/dev/null |
    sed -n 's/.*"name":"throughput".*"executable":"\([^"]*\)".*/\1/p' | tail -n 1)
[ -n "$program" ] || { echo "benches/throughput was not built" >&2; exit 1; }

# Instructions of $2 passes of case $1, with everything around them.
count() {
    valgrind --tool=callgrind --callgrind-out-file=/dev/null "$program" \
        --threads 1 --passes "$2" --case "$1" 2>&1 >/dev/null |
        sed -n 's/.*Collected *: *\([0-9]*\).*/\1/p'
}

if [ "${1:-}" = --store ]; then
    cases=$("$program" --list | grep -vE "_nobound|_loop|_N256")
    {
        echo "# $compiler"
        for case in $cases; do
            echo "$case $((($(count "$case" 3) - $(count "$case" 1)) / 2))"
        done
    } >"$stored.part"
    mv "$stored.part" "$stored"
    cat "$stored"
    exit 0
fi

same=yes
[ "$(sed -n 's/^# //p' "$stored")" = "$compiler" ] || same=no
worse=0
while read -r case before; do
    [ "$case" != "#" ] || continue
    now=$((($(count "$case" 3) - $(count "$case" 1)) / 2))
    change=$(awk "BEGIN { printf \"%+.1f\", 100 * ($now - $before) / $before }")
    verdict=ok
    if [ "$((now * 100))" -gt "$((before * (100 + tolerance)))" ]; then
        verdict=MORE
        worse=1
    fi
    printf '%-20s %12d instructions, stored %12d: %6s %%  %s\n' "$case" "$now" "$before" "$change" "$verdict"
done <"$stored"
if [ "$worse" = 1 ] && [ "$same" = yes ]; then
    echo "a kernel takes more than $tolerance % more instructions: find out why, or store the new counts" >&2
    echo "with benches/instructions/run.sh --store and say in the commit what they pay for" >&2
    exit 1
fi
[ "$same" = yes ] || echo "the counts are those of another compiler: not judged"
