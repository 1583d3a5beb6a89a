#!/bin/sh
# Our rates beside those of SciPy, SLICOT, NumPy, JAX, Eigen and filter libraries on the same
# problems in the same run.
#
#   benches/peers/run.sh [--rounds 7] [--seconds 0.3] [--case care_n8] [--out FILE]
#
# Makes a throw-away virtual environment (PEERS_VENV=DIR keeps one there and
# reuses it), builds benches/throughput.rs, prints a table of ratios and writes
# the raw numbers to target/peers.json. Needs cargo, python3 with venv, and pip.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."

if [ -n "${PEERS_VENV:-}" ]; then
    venv=$PEERS_VENV
else
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT INT TERM
    venv=$scratch/venv
fi
if ! "$venv/bin/python" -c 'import scipy' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check 'numpy>=2' 'scipy>=1.15'
    # A wheel exists for few platforms and a build needs Fortran: go on without.
    "$venv/bin/pip" install --quiet --disable-pip-version-check slycot 2>/dev/null ||
        echo "slycot could not be installed: the comparison with SLICOT is left out" >&2
    for peer in 'jax[cpu]' simdkalman filterpy torch-kf; do
        "$venv/bin/pip" install --quiet --disable-pip-version-check "$peer" 2>/dev/null ||
            echo "$peer could not be installed: it is left out" >&2
    done
fi

# The C++ contender, where a compiler and Eigen (Debian: libeigen3-dev) are there.
eigen=${CXX:-g++}
for include in ${EIGEN3_INCLUDE_DIR:-} /usr/include/eigen3 /usr/local/include/eigen3; do
    if [ -e "$include/Eigen/Dense" ]; then
        "$eigen" -std=c++17 -O3 -march=native -DNDEBUG -I"$include" "$here/eigen.cpp" -o "$venv/eigen" &&
            PEERS_EIGEN=$venv/eigen && export PEERS_EIGEN
        break
    fi
done
[ -n "${PEERS_EIGEN:-}" ] ||
    echo "no C++ compiler with Eigen: the comparison with it is left out (apt-get install g++ libeigen3-dev)" >&2

program=$(cargo bench --no-run --bench throughput --message-format=json |
    "$venv/bin/python" -c '
import json, sys
found = [m["executable"] for m in map(json.loads, sys.stdin)
         if m.get("executable") and m.get("target", {}).get("name") == "throughput"]
print(found[-1])')

# One thread for everyone, and no byte code left in the tree.
export XLA_FLAGS='--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1'
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 RAYON_NUM_THREADS=1
export PYTHONDONTWRITEBYTECODE=1
"$venv/bin/python" "$here/peers.py" --program "$program" "$@"
