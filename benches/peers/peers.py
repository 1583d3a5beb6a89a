"""Ours beside SciPy, SLICOT, NumPy, JAX and filter libraries: same problems, same run.

Rounds are interleaved (one slice of every contender, again and again), so a
slow moment of the machine falls on all of them; best rounds are compared, and
the spread is the range of the ratio over rounds. Everyone has one thread.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time

import numpy
import scipy
from contenders import contenders, slycot

AGREE = 1e-8
# Simulations draw other numbers: their checksums, near one, agree as means over trials do.
AGREE_DRAWN = 0.15


def timed(run, seconds):
    """Items per second of whole passes, for at least `seconds`; and the checksum."""
    items, start = 0, time.perf_counter()
    while True:
        count, checksum = run()
        items += count
        spent = time.perf_counter() - start
        if spent >= seconds:
            return items / spent, checksum


def ours(program, case, seconds):
    command = [program, "--json", "--case", case, "--threads", "1", "--rounds", "1"]
    command += ["--seconds", str(seconds)]
    result = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return result[case]["rate"], result[case]["checksum"]


def cpu():
    try:
        with open("/proc/cpuinfo") as lines:
            return next(x.split(":", 1)[1].strip() for x in lines if x.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def commit():
    git = ["git", "describe", "--always", "--dirty", "--abbrev=12"]
    return subprocess.run(git, capture_output=True, text=True).stdout.strip() or "unknown"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", required=True, help="the built benches/throughput")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=0.3, help="length of one slice")
    parser.add_argument("--case", action="append", help="only this one; may repeat")
    parser.add_argument("--out", default="target/peers.json", help="raw numbers")
    args = parser.parse_args()

    known = subprocess.run([args.program, "--list"], check=True, capture_output=True, text=True).stdout.split()
    unknown = set(args.case or []) - set(known)
    if unknown:
        sys.exit(f"no case {', '.join(sorted(unknown))}: there are {', '.join(known)}")
    cases = args.case or known
    rates = {case: {} for case in cases}
    sums = {case: {} for case in cases}
    runs = {case: contenders(case) for case in cases}
    for case in cases:  # warm up, and see that all compute the same before timing anything
        sums[case]["mmae"] = ours(args.program, case, 0.0)[1]
        for name, run in runs[case].items():
            sums[case][name] = run()[1]
        want = sums[case]["mmae"]
        agree = AGREE_DRAWN if case.startswith("simulate_") else AGREE
        for name, got in sums[case].items():
            if not abs(got - want) <= agree * abs(want):
                sys.exit(f"{case}: {name} has checksum {got!r}, mmae {want!r}: not the same numbers")
    for number in range(args.rounds):
        print(f"round {number + 1} of {args.rounds}", file=sys.stderr)
        for case in cases:
            rate = ours(args.program, case, args.seconds)[0]
            rates[case].setdefault("mmae", []).append(rate)
            for name, run in runs[case].items():
                rates[case].setdefault(name, []).append(timed(run, args.seconds)[0])

    about = {
        "cpu": cpu(),
        "threads": 1,
        "commit": commit(),
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "slycot": getattr(slycot, "__version__", None),
        "rounds": args.rounds,
        "seconds": args.seconds,
        "unit": "problems per second; pairs in eip_pendulum, model-trial-steps in bank_ and simulate_, updates in rls_",
    }
    if os.path.dirname(args.out):
        os.makedirs(os.path.dirname(args.out), exist_ok=True)
    with open(args.out + ".part", "w") as out:
        json.dump({"about": about, "rates": rates, "checksums": sums}, out, indent=1)
    os.replace(args.out + ".part", args.out)

    print(f"{about['cpu']}, one thread, commit {about['commit']}, best of {args.rounds} rounds")
    print(f"NumPy {numpy.__version__}, SciPy {scipy.__version__}, slycot {about['slycot'] or 'not installed'}")
    print(f"{'case':<18} {'mmae /s':>9}  {'peer':<25} {'peer /s':>9} {'ratio':>7}  range over rounds")
    for case in cases:
        mine = rates[case]["mmae"]
        for name in runs[case]:
            theirs = rates[case][name]
            ratios = [a / b for a, b in zip(mine, theirs)]
            row = f"{case:<18} {max(mine):9.3g}  {name:<25} {max(theirs):9.3g} {max(mine) / max(theirs):7.3g}"
            print(f"{row}  {min(ratios):.3g} .. {max(ratios):.3g}")
    print(f"all checksums agree to {AGREE:g} (simulations to {AGREE_DRAWN:g}); raw numbers in {args.out}")


if __name__ == "__main__":
    main()
