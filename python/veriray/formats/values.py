"""Parameters of a node, checked against `plugins` and converted."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import SceneError
from ..numeric import check_matrix
from . import spectra
from .node import Node, Value, allowed, shorten
from .plugins import COLOUR, GREY, IOR, IORS, PLUGINS, REQUIRED, Param, Plugin, mesh_attribute
from .report import Listed, Report

_DEFAULTS: dict[str, dict[str, Any]] = {}  # of the plugins met without a parameter


def check(node: Node, report: Report | None = None, *, every: bool = False) -> dict[str, Any]:
    """A node's parameters, converted and complete with defaults; None for absent ones.

    report: takes the notes on parameters without effect. every: it takes all faults, instead of the
    first being raised.
    """
    if not node.values and node.plugin in _DEFAULTS:
        return dict(_DEFAULTS[node.plugin])
    report = Report() if report is None else report
    plugin = PLUGINS[node.plugin]
    result: dict[str, Any] = {}
    faulty = node.faulty
    absent = [name for name in plugin.params if name not in node.values]
    for name in (*node.values, *absent):
        try:
            if name in plugin.params:
                result[name] = _given(node, name, plugin.params[name], report)
            elif not mesh_attribute(node, name):
                _without_effect(node, name, plugin, report)
        except SceneError as error:
            if not every:
                raise
            report.add(error)
            faulty = True
    if faulty:
        raise Listed("")
    result = {name: result[name] for name in plugin.params if name in result}
    if not node.values and not node.faulty:
        _DEFAULTS[node.plugin] = dict(result)
    return result


def _without_effect(node: Node, name: str, plugin: Plugin, report: Report) -> None:
    """Notes a parameter that changes no light; raises SceneError for any other."""
    value = node.values[name]
    if name in plugin.unsupported:
        raise SceneError(f'{node}: "{name}": {plugin.unsupported[name]}', value.where)
    if name in report.used:
        return
    reason = plugin.noted.get(name, plugin.lenient)
    if not reason:
        raise SceneError(
            f'{node}: unknown parameter "{name}" = {shorten(value.value)}'
            + allowed(name, plugin.params),
            value.where,
        )
    report.note(f'{node}: "{name}" = {shorten(value.value)} has no effect: {reason}', value.where)


def _given(node: Node, name: str, param: Param, report: Report) -> Any:
    """A parameter or its default."""
    if name in node.values:
        value = _parameter(node, name, param, report)
        given = node.values[name]
        plain = value.lower() if isinstance(value, str) else value
        if param.note and plain != param.default:
            report.note(f'{node}: "{name}" = {shorten(given.value)}: {param.note}', given.where)
        return value
    if param.default is REQUIRED:
        if node.faulty:
            raise Listed("")
        raise SceneError(f'{node}: "{name}" ({param.kind}) is missing', node.where)
    if param.kind == IOR:
        return IORS[param.default]
    colour = param.kind == COLOUR and param.default is not None
    return (param.default,) * 3 if colour else param.default


def _parameter(node: Node, name: str, param: Param, report: Report) -> Any:
    given = node.values[name]
    value, good = given.value, given.kind in param.accepted
    if param.kind == "array" and good:
        return value
    if param.kind == "transform" and good:
        try:
            return check_matrix(f'{node}: "{name}"', value)
        except SceneError as error:
            raise SceneError(str(error), given.where) from None
    label = f'{node}: "{name}" = {shorten(value)}'  # slow for a matrix
    if not good:
        raise SceneError(f"{label} is of type {given.kind}, expected {param.kind}", given.where)
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
    if given.kind == "spectrum":
        share = param.high == 1.0  # the albedo of a sunsky's ground too
        emitter = PLUGINS[node.plugin].category == "emitter" and not share
        shown = f'{node}: "{name}"'
        value = spectra.to_rgb(value, emitter, share, shown, given.where, report.warn)
    if param.kind == GREY and isinstance(value, tuple):
        if len(set(value)) > 1:
            told = f"{label}: one number counts, the mean of these, as in Mitsuba"
            report.note(told, given.where)
            value = (sum(value) / 3,)
        value = value[0]
    if param.kind == COLOUR:
        value = value if isinstance(value, tuple) else (float(value),) * 3
        value = _taken(value, param, given, label, report)
    if param.beyond == "near" and isinstance(value, (int, float)) and math.isfinite(value):
        near = min(max(value, param.low), param.high)
        if near != value:
            report.warn(f"{label} is rendered as {near:g}, the nearest in range", given.where)
        value = near
    if param.default == math.inf == value:
        return math.inf
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
    return float(value) if param.kind in ("float", IOR, GREY) else value


def _taken(
    value: tuple[float, ...], param: Param, given: Value, label: str, report: Report
) -> tuple[float, ...]:
    """A colour with what Mitsuba takes and veriray cannot: shares of light outside [0, 1] unless
    given as rgb, and negative light. The nearest number that can be rendered stands for these, with
    a warning. Of a metal's index only the square counts, as in Mitsuba."""
    if param.beyond == "sign":
        if min(value) < 0:
            value = tuple(abs(x) for x in value)
            report.warn(
                f"{label}: only its square counts; rendered as {shorten(value)}", given.where
            )
        return value
    if param.beyond == "share" and given.kind == "rgb" or not param.beyond:
        return value
    taken = tuple(min(max(x, param.low), param.high) for x in value)
    if taken != value and all(math.isfinite(x) for x in value):
        energy = "negative light" if min(value) < 0 else "more light leaving than arriving"
        report.warn(
            f"{label} means {energy}; rendered as {shorten(taken)}: the picture is not Mitsuba's",
            given.where,
        )
        return taken
    return value


def located(node: Node, make: Callable[[], Any]) -> Any:
    """make(), with the node's place added to its SceneError."""
    try:
        return make()
    except SceneError as error:
        raise SceneError(str(error), node.where) from None
