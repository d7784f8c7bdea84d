"""Many solves from one specification: sweeps, fits, orbits, states of rest, derivatives.

Each writes the key of the specification that asks for it, as a user would, and solves.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Optional, Union, cast

from ._searches import Fit, Orbit, Sensitivities, SteadyState
from ._solve import Progress, read, run
from ._specification import Source, text_of
from ._sweep import Sweep


#: Examples of how the arguments `over` and `collect` of a sweep are written, for error messages.
EXAMPLES = {"over": '{"m": [1, 2, 3]}', "collect": '{"peak": {"max": "abs(v)"}}'}


def document_of(spec: Source) -> dict[str, Any]:
    """The specification as a dict of its own."""
    if isinstance(spec, Mapping):
        return dict(spec)
    document = json.loads(text_of(spec))
    if not isinstance(document, dict):
        raise TypeError(f"a specification is an object, not a {type(document).__name__}")
    return document


def with_sweep(
    spec: Source,
    over: Optional[Mapping[Any, Any]] = None,
    collect: Optional[Mapping[str, Any]] = None,
    *,
    table: Any = None,
    design: Optional[str] = None,
    count: Optional[int] = None,
    seed: Optional[int] = None,
) -> dict[str, Any]:
    """The specification with a sweep; what is not given is as in a `sweep` that it has."""
    document = document_of(spec)
    asked = dict(document.get("sweep") or {})
    if isinstance(over, Mapping):
        asked.pop("table", None)
        asked["over"] = {_name(name): values for name, values in over.items()}
    if table is not None:
        asked.pop("over", None)
        asked["table"] = _table(table)
    for name, given in (("over", over), ("collect", collect)):
        if given is not None and not isinstance(given, Mapping):
            raise TypeError(f"`{name}` has an entry for each name, such as {EXAMPLES[name]}, not {given!r}")
    if collect is not None:
        asked["collect"] = {name: _reducer(reducer) for name, reducer in collect.items()}
    further = {"design": design, "count": count, "seed": seed}
    asked.update({key: value for key, value in further.items() if value is not None})
    return {**document, "sweep": asked}


def sweep(
    spec: Source,
    over: Optional[Mapping[Any, Any]] = None,
    collect: Optional[Mapping[str, Any]] = None,
    *,
    table: Any = None,
    design: Optional[str] = None,
    count: Optional[int] = None,
    seed: Optional[int] = None,
    threads: Optional[int] = None,
    progress: Progress = None,
) -> Sweep:
    """Solves a specification for many values of its numbers, on all cores: a table with one row a member.

    `over` has the values of each name: a list or an array, or a rule such as `{"linspace": [0, 1, 11]}`, `{"logspace": [1, 100, 5]}`,
    `{"uniform": [0, 1]}` or `{"normal": [1, 0.1]}`. Names are parameters (`m`), starts (`x.initial`), components (`R1`), or numbers of
    what has a name (`ball.mass`). `collect` has what is kept of each run: `{"peak": {"max": "abs(v)"}, "modes": "mode_word"}`;
    the final value of every state where it is not given. `design` is `grid`, `zip`, `random`, `sobol` or `latin_hypercube`, of
    `count` members for the last three. `table` has the values of all members, by column, in place of `over`.

    The rows do not depend on the number of threads; they are those of `dvi sweep`, to the byte. A member that fails is a row. Ctrl-C
    stops; the `KeyboardInterrupt` has the rows that are done as `result`.

    >>> spec = {"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}}, "time": {"end": 1}}
    >>> s = sweep(spec, over={"k": [1, 2, 3]}, collect={"end": {"final": "x"}})
    >>> s["k"], s["end"].round(4)
    (array([1., 2., 3.]), array([0.3679, 0.1353, 0.0498]))
    """
    document = with_sweep(spec, over, collect, table=table, design=design, count=count, seed=seed)
    return cast(Sweep, run(read(document), progress, threads))


def with_fit(
    spec: Source,
    data: Any = None,
    parameters: Any = None,
    *,
    sd: Any = None,
    loss: Optional[str] = None,
    starts: Optional[int] = None,
) -> dict[str, Any]:
    """The specification with a fit; what is not given is as in a `fit` that it has. Its end is that of the data where it has none."""
    document = document_of(spec)
    asked = dict(document.get("fit") or {})
    if data is not None:
        asked["data"] = _data(data)
    if sd is not None:
        asked["data"] = {**asked.get("data", {}), "sd": sd}
    if parameters is not None:
        asked["parameters"] = _parameters(parameters)
    further = {"loss": loss, "starts": starts}
    asked.update({key: value for key, value in further.items() if value is not None})
    times = asked.get("data", {}).get("t")
    if "time" not in document and times:
        document["time"] = {"end": max(times)}
    return {**document, "fit": asked}


def fit(
    spec: Source,
    data: Any = None,
    parameters: Any = None,
    *,
    sd: Any = None,
    loss: Optional[str] = None,
    starts: Optional[int] = None,
    progress: Progress = None,
) -> Fit:
    """Fits parameters and initial values to data, on derivatives that are exact through switches.

    `data` has the times `t`, the values of states and definitions by name, and their standard deviations as `sd`: a mapping, or a
    data frame of pandas, over `t` or with a column `t`. NaN is a value that was not measured. `parameters` is a list of names, or has for
    each name its bounds `(lower, upper)`, the value from which the search begins, or `{"initial": .., "lower": .., "upper": ..}`.
    `loss` is `squares` or `huber`; `starts` is from how many places the search begins.

    >>> spec = {"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}}}
    >>> data = {"t": [0.5, 1, 2], "x": [0.3679, 0.1353, 0.0183], "sd": 1e-4}
    >>> print(fit(spec, data, ["k"]).estimates["k"])
    2.00003 +- 0.00043
    """
    document = with_fit(spec, data, parameters, sd=sd, loss=loss, starts=starts)
    found = cast(Fit, run(read(document), progress))
    found.data = document["fit"]["data"]
    return found


def with_sensitivities(spec: Source, to: Any, of: Any = None) -> dict[str, Any]:
    """The specification with derivatives."""
    asked = {"to": _names(to)} if of is None else {"to": _names(to), "of": _names(of)}
    return {**document_of(spec), "sensitivities": asked}


def sensitivities(spec: Source, to: Any, of: Any = None, *, progress: Progress = None) -> Sensitivities:
    """Solves with the derivatives of the states `of`, of all where it is not given, by parameters and initial values
    `to`, such as `["m", "x.initial"]`: exact through switches and sliding, and held against a difference of runs.

    >>> spec = {"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}}, "time": {"end": 1}}
    >>> round(float(sensitivities(spec, "k").derivative("x", "k")[-1]), 6)
    -0.367879
    """
    return cast(Sensitivities, run(read(with_sensitivities(spec, to, of)), progress))


def with_period(spec: Source, period: Any) -> dict[str, Any]:
    """The specification of an orbit."""
    return {**document_of(spec), "periodic": {"period": getattr(period, "text", period)}}


def periodic(spec: Source, period: Union[str, float, Mapping[str, Any]], *, progress: Progress = None) -> Orbit:
    """Finds the orbit from which a problem comes back to itself after `period`: a number, an expression in the parameters such
    as `"1/f"`, or `{"free": 6.3, "phase": "v"}` where nothing drives it. It has its Floquet `multipliers`, and means and extremes
    `over_period`."""
    return cast(Orbit, run(read(with_period(spec, period)), progress))


def with_rest(spec: Source) -> dict[str, Any]:
    """The specification of a state of rest."""
    return {**document_of(spec), "steady_state": {}}


def steady_state(spec: Source, *, progress: Progress = None) -> SteadyState:
    """Finds where all rests; it has the `eigenvalues` on the active face."""
    return cast(SteadyState, run(read(with_rest(spec)), progress))


# --- conversion of the arguments of users to members of a specification


def _name(name: Any) -> str:
    return str(getattr(name, "text", name))


def _names(names: Any) -> list[str]:
    if isinstance(names, str) or hasattr(names, "text"):
        return [_name(names)]
    return [_name(name) for name in names]


def _reducer(reducer: Any) -> Any:
    """A reducer in which expressions of the builder may stand."""
    return {key: _plain(value) for key, value in reducer.items()} if isinstance(reducer, Mapping) else reducer


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    return getattr(value, "text", value)


def _columns(table: Any) -> dict[str, Any]:
    """The columns of a mapping or a data frame; a named index is a column."""
    if hasattr(table, "columns") and hasattr(table, "reset_index"):
        table = table.reset_index() if table.index.name is not None else table
        return {str(name): table[name] for name in table.columns}
    if isinstance(table, Mapping):
        return {_name(name): values for name, values in table.items()}
    raise TypeError(f"data are a mapping of columns or a data frame, not {type(table).__name__}")


def _list(values: Any) -> list[Any]:
    """A column as a list, without numbers that are not."""
    listed = values.tolist() if hasattr(values, "tolist") else list(values)
    return [None if isinstance(value, float) and math.isnan(value) else value for value in listed]


def _table(table: Any) -> dict[str, Any]:
    if isinstance(table, Mapping) and set(table) == {"columns", "rows"}:
        return dict(table)
    columns = {name: _list(values) for name, values in _columns(table).items()}
    lengths = {len(values) for values in columns.values()}
    if len(lengths) > 1:
        raise ValueError(f"the columns of a table have one length, not {sorted(lengths)}")
    return {"columns": list(columns), "rows": [list(row) for row in zip(*columns.values())]}


def _data(data: Any) -> dict[str, Any]:
    columns = _columns(data)
    if "t" not in columns:
        raise ValueError(f"data have the times as `t`, beside {', '.join(columns) or 'nothing'}")
    made: dict[str, Any] = {}
    for name, values in columns.items():
        if name == "sd" and isinstance(values, Mapping):
            made[name] = {_name(of): _spread(spread) for of, spread in values.items()}
        else:
            made[name] = _spread(values) if name == "sd" else _list(values)
    return made


def _spread(spread: Any) -> Any:
    return spread if isinstance(spread, (int, float)) else _list(spread) if hasattr(spread, "__len__") else float(spread)


def _parameters(parameters: Any) -> dict[str, Any]:
    if isinstance(parameters, Mapping):
        return {_name(name): _bounds(given) for name, given in parameters.items()}
    return {name: {} for name in _names(parameters)}


def _bounds(given: Any) -> dict[str, Any]:
    if given is None or isinstance(given, Mapping):
        return dict(given or {})
    if isinstance(given, (int, float)):
        return {"initial": given}
    try:
        lower, upper = given
    except (TypeError, ValueError):
        raise ValueError(f"a parameter has bounds (lower, upper), where to begin, or None, not {given!r}") from None
    ends = {"lower": lower, "upper": upper}
    return {key: end for key, end in ends.items() if end is not None and math.isfinite(end)}
