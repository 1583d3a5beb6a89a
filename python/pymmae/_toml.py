"""Python values as TOML, the language of scenario files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from .errors import DTypeError


def _key(name: Any) -> str:
    if not isinstance(name, str):
        raise DTypeError(f"scenario: the key {name!r} is no text: write it in quotes", "dtype")
    bare = name.isascii() and name.replace("_", "a").replace("-", "a").isalnum()
    return name if bare else _text(name)


def _text(value: str) -> str:
    # JSON escapes what TOML wants escaped, and DEL
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(path: str, value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    elif isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mapping):
        inner = (f"{_key(k)} = {_value(f'{path}.{k}', v)}" for k, v in value.items())
        return "{ " + ", ".join(inner) + " }" if value else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(f"{path}[{i}]", v) for i, v in enumerate(value)) + "]"
    raise DTypeError(
        f"scenario: {path} is a {type(value).__name__}: give numbers, text, lists, dictionaries",
        "dtype",
    )


def dumps(document: Mapping[str, Any]) -> str:
    """The scenario as TOML: numbers keep their bits, one table a key of the top."""
    plain = [(k, v) for k, v in document.items() if not isinstance(v, Mapping)]
    tables = [(k, v) for k, v in document.items() if isinstance(v, Mapping)]
    lines = [f"{_key(k)} = {_value(k, v)}" for k, v in plain]
    for name, table in tables:
        lines.append(f"\n[{_key(name)}]")
        lines.extend(f"{_key(k)} = {_value(f'{name}.{k}', v)}" for k, v in table.items())
    return "\n".join(lines) + "\n"
