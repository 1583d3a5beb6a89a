"""What several test files need."""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"

#: Two plants, two models: the smallest study and the smallest trial there are.
SMALL = {
    "plant": {
        "time": "discrete",
        "dt": 0.5,
        "states": ["x"],
        "outputs": ["y"],
        "disturbances": ["w"],
        "A": "a",
        "G": 1,
        "C": 1,
        "Q": 1,
        "R": 1,
        "parameters": {"a": 0.5},
    },
    "bank": {"models": {"a": [0.3, 0.8]}},
    "eip": {"grid": {"a": [0.4, 0.9]}, "verify": "none"},
    "truth": {"model": 2},
    "run": {"steps": 8, "trials": 2},
}

#: x' = a x + b u, a = -1, b = 2: the smallest adaptive observer of two parameters.
MOTOR = {
    "adaptive": {
        "dt": 0.02,
        "inputs": ["u"],
        "outputs": ["y"],
        "observers": {
            "motor": {
                "states": ["x"],
                "A": 0,
                "C": 1,
                "K": 2,
                "P0": 1e6,
                "window": 1,
                "theta": {
                    "a": {"entry": ["x", "x"], "truth": "a"},
                    "b": {"column": "u", "truth": "b"},
                },
            }
        },
        "truth": {
            "states": ["x"],
            "derivative": "a*x + b*u",
            "output": "x",
            "parameters": {"a": -1, "b": 2},
            "noise": {"y": 0.01},
        },
    },
    "signals": {"inputs": {"u": {"wave": "sine", "amplitude": 1, "omega": 2}}},
    "run": {"steps": 300, "every": 50, "trials": 3, "seed": 7},
}


@pytest.fixture
def command() -> str:
    """The command line, where the tests of the crate have built it."""
    path = os.environ.get("MMAE_COMMAND")
    if not path:
        pytest.skip("MMAE_COMMAND does not name the command mmae")
    return path


def stable(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Random stable matrices (continuous time)."""
    a = rng.standard_normal(shape)
    n = shape[-1]
    return a - np.eye(n) * (np.abs(np.linalg.eigvals(a)).max() + 0.1)


def spd(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Random symmetric positive definite matrices."""
    a = rng.standard_normal(shape)
    return a @ np.swapaxes(a, -1, -2) + np.eye(shape[-1])
