"""What is no array of numbers is refused by name, and nothing crashes."""

from __future__ import annotations

import time

import numpy as np
import pandas as pd
import pymmae
import pytest

EYE = np.eye(2)
CALLS = {
    "care": (pymmae.care, {"A": -EYE, "B": EYE, "Q": EYE, "R": EYE, "S": 0 * EYE}),
    "dare": (pymmae.dare, {"A": EYE, "B": EYE, "Q": EYE, "R": EYE, "S": 0 * EYE}),
    "lyap": (pymmae.lyap, {"A": -EYE, "Q": EYE}),
    "sylvester": (pymmae.sylvester, {"A": -EYE, "B": -EYE, "C": EYE}),
    "riccati_ode": (
        pymmae.riccati_ode,
        {"F": -EYE, "H": EYE, "Q": EYE, "R": EYE, "P": EYE, "h": np.array(0.1)},
    ),
}
BAD = {
    "complex": (EYE * 1j, TypeError),
    "object": (np.array([[1, None], [2, 3]], dtype=object), TypeError),
    "text": (np.array([["a", "b"], ["c", "d"]]), TypeError),
    "one text": ("abc", TypeError),
    "Boolean": (EYE.astype(bool), TypeError),
    "dates": (pd.DataFrame({"t": [pd.NaT, pd.Timestamp("2020-01-01")]}), TypeError),
    "masked": (np.ma.masked_array(EYE, mask=EYE == 0), TypeError),
    "big-endian": (EYE.astype(">f8"), TypeError),
    "empty": (np.zeros((0, 0)), ValueError),
    "no items": (np.zeros((0, 2, 2)), ValueError),
    "ragged": ([[1.0], [1.0, 2.0]], (ValueError, TypeError)),
    "three columns": (np.ones((5, 3)), ValueError),
}


def cases():
    for name, (function, arguments) in CALLS.items():
        for argument in arguments:
            for kind, (value, error) in BAD.items():
                if argument == "h" and kind == "three columns":
                    continue  # fifteen steps
                title = f"{name}-{argument}-{kind}"
                yield pytest.param(function, arguments, argument, value, error, id=title)


def test_there_are_two_hundred():
    assert len(list(cases())) >= 200


@pytest.mark.parametrize(("function", "arguments", "argument", "value", "error"), list(cases()))
def test_refused_by_name(function, arguments, argument, value, error):
    with pytest.raises(error) as caught:
        function(**{**arguments, argument: value})
    assert isinstance(caught.value, pymmae.Error)
    # the one that is wrong, or one that no longer fits it
    assert any(f"{name}" in str(caught.value) for name in arguments)
    if isinstance(caught.value, pymmae.DTypeError):
        assert str(caught.value).startswith(argument)


@pytest.mark.parametrize("value", [1.0, np.float64(1.0), np.ones(2), None])
@pytest.mark.parametrize("function", [pymmae.lyap, pymmae.care])
def test_too_few_dimensions(function, value):
    arguments = CALLS[function.__name__][1]
    with pytest.raises((TypeError, ValueError), match="^A "):
        function(**{**arguments, "A": value})


def test_sizes_that_no_machine_holds():
    huge = np.broadcast_to(np.eye(1), (2**40, 1, 1))
    start = time.monotonic()
    with pytest.raises(MemoryError, match="A needs"):
        pymmae.lyap(huge, np.eye(1))
    with pytest.raises(MemoryError, match="A needs"):
        pymmae.care(huge, np.eye(1), np.eye(1), np.eye(1))
    # two shapes that only together are too large
    column = np.broadcast_to(-np.eye(1), (2**20, 1, 1, 1))
    with pytest.raises(MemoryError):
        pymmae.lyap(column, np.broadcast_to(np.eye(1), (2**20, 1, 1)))
    assert time.monotonic() - start < 30


def test_every_entry_that_is_no_number_is_told_by_place():
    for bad in (np.nan, np.inf, -np.inf):
        for i in range(2):
            for j in range(2):
                a = -EYE.copy()
                a[i, j] = bad
                with pytest.raises(pymmae.InputError, match=rf"A\[{i}\]\[{j}\]") as caught:
                    pymmae.lyap(a, EYE)
                assert caught.value.code == "not_finite"


SCENARIOS = [
    ({}, "plant"),
    ({"plant": 3}, "plant"),
    ({"plant": {"family": "no such"}}, "family"),
    ({"plant": {"family": "pendulum"}, "bank": {"models": {"L": [float("nan")]}}}, "bank.models"),
    ({"plant": {"family": "pendulum"}, "bank": {"models": {"Q": [1.0]}}}, "Q"),
    ({"plant": {"family": "pendulum"}, "odd": 1}, "odd"),
    ({"plant": {"family": "pendulum"}, "title": None}, "title"),
    ({"plant": {"family": "pendulum"}, "bank": {"models": {"L": object()}}}, "models"),
    ({1: 2}, "1"),
]


@pytest.mark.parametrize(("tables", "word"), SCENARIOS)
@pytest.mark.filterwarnings("ignore::pymmae.ScenarioWarning")
def test_scenarios_that_are_wrong(tables, word):
    with pytest.raises(pymmae.Error, match=word):
        pymmae.eip(tables)


def test_a_scenario_error_tells_every_place():
    with pytest.raises(pymmae.ScenarioError) as caught:
        pymmae.Scenario.parse("format = 1\n[plant]\nfamily = 'x'\n[bnk]\n", name="a.toml")
    places = [(d["line"], d["column"], d["key"]) for d in caught.value.diagnostics]
    assert (3, 10, "plant.family") in places and any(key == "bnk" for *_, key in places)


@pytest.mark.parametrize("path", ["/no/such/file.toml", "/", "a\0b"])
def test_files_that_cannot_be_read(path):
    with pytest.raises(OSError) as caught:
        pymmae.eip(path)
    assert isinstance(caught.value, pymmae.FileError)
