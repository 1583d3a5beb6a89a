"""Documentation runs, types hold, pictures can be drawn."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import runpy
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pymmae
import pytest
from conftest import EXAMPLES, MOTOR, SMALL

HERE = Path(__file__).parent
PAGES = sorted((HERE.parent / "examples").glob("*.py"))
MODULES = [m.name for m in pkgutil.iter_modules(pymmae.__path__) if m.name != "_core"]


@pytest.mark.parametrize("module", MODULES)
def test_examples_of_the_documentation(module):
    failures, _ = doctest.testmod(importlib.import_module(f"pymmae.{module}"))
    assert failures == 0


def test_every_public_function_has_an_example():
    for name in pymmae.__all__:
        thing = getattr(pymmae, name)
        if callable(thing) and not isinstance(thing, type):
            text = thing.__doc__
            assert ">>>" in text and "Source" in text and ".. code-block::" in text, name


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(page), run_name="__main__")
    assert list(tmp_path.glob("*.png"))


def test_there_is_a_page_a_paper():
    assert [p.stem for p in PAGES] == ["adaptive", "bicycle", "oscillator", "pendulum", "tracker"]


def test_types():
    # mypy refuses folders of installed packages
    typed = [str(HERE / "typed.py"), str(HERE.parent / "pymmae")]
    arguments = [sys.executable, "-m", "mypy", "--strict", "--no-incremental", *typed]
    done = subprocess.run(arguments, capture_output=True, text=True, cwd=HERE)
    assert done.returncode == 0, done.stdout + done.stderr


def test_figures():
    from pymmae import plot

    for call in (
        lambda: plot.eip(pymmae.eip(EXAMPLES / "two_parameters.toml")),
        lambda: plot.weights(pymmae.run(SMALL)),
        lambda: plot.weights(pymmae.monte_carlo(SMALL, every=1)),
        lambda: plot.errors(pymmae.monte_carlo(SMALL, every=1)),
        lambda: plot.states(pymmae.run(SMALL)),
        lambda: plot.parameters(pymmae.adaptive(MOTOR)),
        lambda: plot.parameters(pymmae.adaptive(MOTOR, trials=1, forgetting=[0.1, 0.2])),
        lambda: plot.states(pymmae.adaptive(MOTOR)),
        lambda: plot.states(pymmae.adaptive(MOTOR, [[0.0], [0.1]], [[0.0], [1.0]])),
    ):
        call()
        plt.close("all")


def test_the_benchmarks_run():
    script = HERE.parent / "benches" / "calls.py"
    done = subprocess.run(
        [sys.executable, str(script), "--quick"], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "us a call" in done.stdout
