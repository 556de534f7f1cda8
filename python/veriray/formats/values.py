"""Parameters of a node, checked against `plugins` and converted."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import SceneError
from ..numeric import check_matrix
from .node import Node, allowed, shorten
from .plugins import COLOUR, IOR, IORS, PLUGINS, REQUIRED, Param

_DEFAULTS: dict[str, dict[str, Any]] = {}  # of the plugins met without a parameter


def check(node: Node) -> dict[str, Any]:
    """A node's parameters, converted and complete with defaults; None for absent ones."""
    if not node.values and node.plugin in _DEFAULTS:
        return dict(_DEFAULTS[node.plugin])
    plugin = PLUGINS[node.plugin]
    for name, value in node.values.items():
        if name in plugin.unsupported:
            raise SceneError(f'{node}: "{name}": {plugin.unsupported[name]}', value.where)
        if name not in plugin.params:
            raise SceneError(
                f'{node}: unknown parameter "{name}" = {shorten(value.value)}'
                + allowed(name, plugin.params),
                value.where,
            )
    result = {}
    for name, param in plugin.params.items():
        if name in node.values:
            result[name] = _parameter(node, name, param)
        elif param.default is REQUIRED:
            raise SceneError(f'{node}: "{name}" ({param.kind}) is missing', node.where)
        elif param.kind == IOR:
            result[name] = IORS[param.default]
        else:
            colour = param.kind == COLOUR and param.default is not None
            result[name] = (param.default,) * 3 if colour else param.default
    if not node.values:
        _DEFAULTS[node.plugin] = dict(result)
    return result


def _parameter(node: Node, name: str, param: Param) -> Any:
    given = node.values[name]
    label = f'{node}: "{name}" = {shorten(given.value)}'
    if given.kind not in param.accepted:
        raise SceneError(f"{label} is of type {given.kind}, expected {param.kind}", given.where)
    value = given.value
    if param.kind == "transform":
        try:
            return check_matrix(f'{node}: "{name}"', value)
        except SceneError as error:
            raise SceneError(str(error), given.where) from None
    if param.kind == "array":
        return value
    if param.kind == "string":
        value = value.lower() if param.choices else value
    if param.choices and value not in param.choices:
        names = [str(choice).lower() for choice in param.choices]
        raise SceneError(f"{label} is not supported{allowed(str(value), names)}", given.where)
    if param.kind == "boolean" or param.kind == "string":
        return value
    if param.kind == IOR and isinstance(value, str):
        if value.lower() not in IORS:
            raise SceneError(f"{label} is unknown{allowed(value.lower(), IORS)}", given.where)
        value = IORS[value.lower()]
    if param.kind == COLOUR:
        value = value if isinstance(value, tuple) else (float(value),) * 3
    for number in value if isinstance(value, tuple) else (value,):
        good = param.low < number < param.high if param.open else param.low <= number <= param.high
        if number != number or number in (math.inf, -math.inf):
            raise SceneError(f"{label} must be finite", given.where)
        if not good:
            ends = "()" if param.open else "[]"
            raise SceneError(
                f"{label} is outside {ends[0]}{param.low:g}, {param.high:g}{ends[1]}", given.where
            )
    if param.kind == COLOUR and max(value) > float(np.finfo(np.float32).max):
        raise SceneError(f"{label} exceeds the float32 range", given.where)
    return float(value) if param.kind in ("float", IOR) else value


def located(node: Node, make: Callable[[], Any]) -> Any:
    """make(), with the node's place added to its SceneError."""
    try:
        return make()
    except SceneError as error:
        raise SceneError(str(error), node.where) from None
