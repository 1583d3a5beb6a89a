"""Draws how cost grows from the numbers of benches/scaling.rs.

    cargo bench --bench scaling -- --json > scaling.json
    python benches/peers/scaling.py scaling.json docs/scaling.svg

Needs matplotlib.
"""

import json
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

AXES = [
    ("trials", "trials", "trials T (n = 4, q = 2, 4 models, 32 steps)", True),
    ("models", "models", "models N (n = 4, q = 2)", True),
    ("states", "n", "states n (q = 1, 16 models)", False),
    ("outputs", "q", "outputs q (n = 8, 16 models)", False),
    ("steps", "steps", "steps (n = 4, q = 2, 16 models)", True),
    ("threads", "threads", "threads (n = 4, q = 2, 16 models)", False),
]
LOOKS = {"bank": ("#0072b2", "o", "bank, records given"), "simulate": ("#d55e00", "s", "simulation, everything")}


def main():
    source, target = sys.argv[1:3]
    with open(source) as lines:
        points = json.load(lines)
    plt.rcParams.update({"font.size": 9, "svg.fonttype": "none", "svg.hashsalt": "mmae"})
    figure, panels = plt.subplots(2, 3, figsize=(10, 5.6), sharey=True)
    for panel, (axis, key, label, logarithmic) in zip(panels.flat, AXES):
        for what, (colour, marker, name) in LOOKS.items():
            chosen = [p for p in points if p["axis"] == axis and p["what"] == what]
            x, y = [p[key] for p in chosen], [p["gflops"] for p in chosen]
            panel.plot(x, y, color=colour, marker=marker, markersize=4, label=name)
        panel.set_xlabel(label)
        panel.grid(color="#dddddd", linewidth=0.6)
        panel.set_axisbelow(True)
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)
        if logarithmic:
            panel.set_xscale("log")
        if axis == "threads":
            panel.set_xticks([1, 2])
            panel.set_xlim(0.5, 2.5)
    for row in panels:
        row[0].set_ylabel("filter GFLOP/s of a core")
    # the panels share this axis
    panels[0][0].set_ylim(0, 1.05 * max(p["gflops"] for p in points))
    handles, names = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, names, frameon=False, loc="upper center", ncols=2)
    figure.tight_layout(rect=(0, 0, 1, 0.95))
    figure.savefig(target, metadata={"Date": None})


if __name__ == "__main__":
    main()
