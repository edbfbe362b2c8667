"""Parameters from a TOML file."""

from __future__ import annotations

import math
import tomllib
from dataclasses import fields
from pathlib import Path

from levelhead.errors import UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.params import MethodParams


def load_params(method: str, path: Path | None) -> MethodParams | None:
    """Return a method's parameters from a file; None without one.

    The file holds the parameters by name, at the top or in a table named after the method; angles may be given in
    degrees with the suffix ``_deg`` or ``_deg_s`` (``omega_accel_deg_s = 45``).

    Raises
    ------
    UsageError
        When the method is unknown, the file cannot be read, or it names something that is not a parameter.
    """
    if method not in METHODS:
        raise UsageError(f"There is no method {method!r}; choose one of {', '.join(METHODS)}.")
    kind = METHODS[method].params
    if path is None:
        return None
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"The parameter file {path} cannot be read: {error}.") from None
    table = content.get(method, {k: v for k, v in content.items() if k not in METHODS})
    if not isinstance(table, dict):
        raise UsageError(f"[{method}] in {path} is not a table; write `[{method}]` with one parameter per line.")
    names = {field.name for field in fields(kind)}
    values: dict[str, object] = {}
    for key, value in table.items():
        name = key.removesuffix("_deg_s").removesuffix("_deg")
        if name not in names:
            raise UsageError(f"{path} sets {key!r}, which {method} does not have; it has {', '.join(sorted(names))}.")
        in_degrees = name != key
        if in_degrees and not isinstance(value, int | float):
            raise UsageError(f"{key} in {path} is {value!r}; pass a number of degrees.")
        values[name] = math.radians(value) if in_degrees else tuple(value) if isinstance(value, list) else value
    return _build(kind, values, path)


def _build(kind: type[MethodParams], values: dict[str, object], path: Path) -> MethodParams:
    defaults = kind()
    for name, value in values.items():
        wanted = getattr(defaults, name)
        # What is open by default (None) is a number when it is given.
        number = isinstance(wanted, float | None) and isinstance(value, int | float) and not isinstance(value, bool)
        lengths = wanted is None and isinstance(value, tuple)
        if not number and not lengths and type(value) is not type(wanted):
            raise UsageError(
                f"{name} in {path} is {value!r}; pass a {'float' if wanted is None else type(wanted).__name__}."
            )
    object_values = {field.name: values.get(field.name, getattr(defaults, field.name)) for field in fields(kind)}
    made: MethodParams = kind.from_dict(object_values)
    return made
