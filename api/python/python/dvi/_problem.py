"""A builder of specifications of the general form: it writes what a user would write, and checks nothing itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Optional, Union

from ._expression import Expression, Operand, call, expression
from ._result import Result
from ._specification import dumps

if TYPE_CHECKING:
    from ._searches import Fit, Orbit, Sensitivities, SteadyState
    from ._sweep import Sweep

Names = Union[str, Sequence[str]]
#: Output times: "steps", a number of times, a list of times, or an object as in JSON, such as {"every": 0.1}.
Times = Union[str, int, Sequence[float], Mapping[str, float], None]


class _Named(Expression):
    """A name that others can be built with. Of a vector, declared as "x[1..n]", `x[k]` is an element."""

    __slots__ = ("name", "problem")

    def __init__(self, name: str, problem: Problem) -> None:
        super().__init__(name)
        self.name = name
        self.problem = problem

    def __getitem__(self, index: Any) -> Expression:
        places = index if isinstance(index, tuple) else (index,)
        base = self.name.partition("[")[0]
        return Expression(f"{base}[{', '.join(str(place) for place in places)}]")


class Parameter(_Named):
    """A constant by name."""

    __slots__ = ()


class Definition(_Named):
    """An expression by name, which can be reported as a column."""

    __slots__ = ()


class Integral(_Named):
    """An integral over time, a further column."""

    __slots__ = ()


class State(_Named):
    """A state: its `rate` is to be set before the problem is solved."""

    __slots__ = ()

    @property
    def rate(self) -> Optional[str]:
        """Its rate, as text."""
        rate: Optional[str] = self.problem._states[self.name].get("rate")
        return rate

    @rate.setter
    def rate(self, rate: Operand) -> None:
        self.problem._states[self.name]["rate"] = _written(rate)

    @property
    def initial(self) -> Any:
        """Its value at the start."""
        return self.problem._states[self.name]["initial"]

    @initial.setter
    def initial(self, initial: Any) -> None:
        self.problem._states[self.name]["initial"] = _written(initial)


class Variable(_Named):
    """A variable: its `inequality` is the component of G paired with it, of which >= 0 is understood."""

    __slots__ = ()

    @property
    def inequality(self) -> Optional[str]:
        """The component of G paired with it, as text."""
        inequality: Optional[str] = self.problem._variables[self.name].get("inequality")
        return inequality

    @inequality.setter
    def inequality(self, inequality: Operand) -> None:
        self.problem._variables[self.name]["inequality"] = _written(inequality)


class Table:
    """A function given by points, to be called: `load(t)`."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, argument: Operand) -> Expression:
        return call(self.name, argument)


class Problem:
    """A differential variational inequality in the making.

    The arguments are parameters, which are attributes then: `Problem(m=1).m`; where a name is one of the builder's own,
    `Problem(stop=1)["stop"]`. `label` is the user's own words for it.

    >>> p = Problem(m=1, k=1, f=1, v_belt=0.5)
    >>> x, v = p.state("x", 4), p.state("v", 0)
    >>> F = p.box("F", -p.f, p.f, inequality=-(v - p.v_belt))
    >>> x.rate = v; v.rate = (-p.k*x - F)/p.m
    >>> v.rate
    '(-k*x - F)/m'
    """

    def __init__(self, label: Optional[str] = None, **parameters: Any) -> None:
        self.label = label
        self._parameters: dict[str, Any] = {}
        self._tables: dict[str, Any] = {}
        self._definitions: dict[str, Any] = {}
        self._integrals: dict[str, Any] = {}
        self._states: dict[str, dict[str, Any]] = {}
        self._variables: dict[str, dict[str, Any]] = {}
        self._set: list[dict[str, Any]] = []
        self._stop: list[dict[str, Any]] = []
        #: The mass matrix M, a list of rows; None is the identity.
        self.mass_matrix: Any = None
        #: Further keys of the specification, such as `sensitivities` or `study`, merged into it as they stand.
        self.further: dict[str, Any] = {}
        for name, value in parameters.items():
            self.parameter(name, value)

    def __getitem__(self, name: str) -> Parameter:
        """A parameter whose name is one of the builder's own: `p["mass"]`, `p["stop"]`."""
        if name in self._parameters:
            return Parameter(name, self)
        raise KeyError(f"there is no parameter {name!r} among {', '.join(self._parameters) or 'none'}")

    def __getattr__(self, name: str) -> Parameter:
        parameters = self.__dict__.get("_parameters", {})
        if name in parameters:
            return Parameter(name, self)
        raise AttributeError(f"there is no parameter {name!r} among {', '.join(parameters) or 'none'}")

    # --- the parts of a problem

    def parameter(self, name: str, value: Any) -> Parameter:
        """A constant: a number, an expression in other parameters, or a list for a vector."""
        _fresh(name, self._parameters, "parameter")
        self._parameters[name] = _written(value)
        return Parameter(name, self)

    def table(self, name: str, x: Sequence[float], y: Sequence[float], interpolation: str = "linear") -> Table:
        """A function given by points: `linear`, `pchip` or `previous`."""
        _fresh(name, self._tables, "table")
        self._tables[name] = {"x": list(x), "y": list(y), "interpolation": interpolation}
        return Table(name)

    def define(self, name: str, value: Operand) -> Definition:
        """An expression by name, which can be reported as a column."""
        _fresh(name, self._definitions, "definition")
        self._definitions[name] = _written(value)
        return Definition(name, self)

    def integral(self, name: str, value: Operand) -> Integral:
        """The integral of an expression over time, a further column."""
        _fresh(name, self._integrals, "integral")
        self._integrals[name] = _written(value)
        return Integral(name, self)

    def state(self, name: str, initial: Any, rate: Optional[Operand] = None) -> State:
        """A state and its value at the start. Its rate may be set later."""
        _fresh(name, self._states, "state")
        self._states[name] = {"initial": _written(initial)}
        state = State(name, self)
        if rate is not None:
            state.rate = rate
        return state

    def free(self, name: Names, equation: Any = None) -> Any:
        """Variables without bounds, whose G is zero: `equation`."""
        return self._block("free", name, equation)

    def nonnegative(self, name: Names, inequality: Any = None) -> Any:
        """Variables z >= 0 with G >= 0, one of the two zero."""
        return self._block("nonnegative", name, inequality)

    def nonpositive(self, name: Names, inequality: Any = None) -> Any:
        """Variables z <= 0 with G <= 0, one of the two zero."""
        return self._block("nonpositive", name, inequality)

    def box(self, name: Names, lower: Optional[Operand] = None, upper: Optional[Operand] = None, *, inequality: Any = None) -> Any:
        """Variables between bounds: G is zero inside, nonnegative at the lower, nonpositive at the upper."""
        return self._block("box", name, inequality, lower=lower, upper=upper)

    def ball(self, names: Sequence[str], radius: Operand, *, inequality: Any = None) -> Any:
        """Variables whose Euclidean norm is at most `radius`."""
        return self._block("ball", names, inequality, radius=radius)

    def second_order_cone(self, names: Sequence[str], inequality: Any = None) -> Any:
        """Variables of which the first is at least the Euclidean norm of the others."""
        return self._block("second_order_cone", names, inequality)

    def simplex(self, names: Sequence[str], inequality: Any = None) -> Any:
        """Nonnegative variables whose sum is one."""
        return self._block("simplex", names, inequality)

    def polyhedron(self, names: Sequence[str], A: Any, b: Any, *, inequality: Any = None) -> Any:
        """Variables with A z <= b."""
        return self._block("polyhedron", names, inequality, A=A, b=b)

    def stop(self, when: Operand, *, direction: Optional[str] = None, label: Optional[str] = None, record: bool = False) -> None:
        """Ends the run where `when` changes its sign; with `record` only tells it as an event. Directions are `either`,
        `rising` and `falling`."""
        entry: dict[str, Any] = {"when": _written(when)}
        entry.update({"direction": direction} if direction else {})
        entry.update({"label": label} if label else {})
        entry.update({"record": True} if record else {})
        self._stop.append(entry)

    def _block(self, kind: str, names: Names, inequality: Any, **shape: Any) -> Any:
        alone = isinstance(names, str)
        members = [names] if isinstance(names, str) else list(names)
        inequalities = [inequality] if alone or inequality is None else list(inequality)
        if inequality is None:
            inequalities = [None] * len(members)
        if len(inequalities) != len(members):
            raise ValueError(f"{len(members)} variables have as many inequalities, not {len(inequalities)}")
        for name, one in zip(members, inequalities):
            _fresh(name, self._variables, "variable")
            self._variables[name] = {} if one is None else {"inequality": _written(one)}
        if shape:
            bounds = {key: _written(value) for key, value in shape.items() if value is not None}
            self._set.append({kind: {"of": members, **bounds}})
        else:
            self._set.append({kind: members})
        variables = [Variable(name, self) for name in members]
        return variables[0] if alone else variables

    # --- conversion to a specification, and solves

    def to_dict(
        self,
        end: Optional[float] = None,
        *,
        start: Optional[float] = None,
        times: Times = None,
        fields: Optional[Sequence[Any]] = None,
        limits: Optional[Mapping[str, Any]] = None,
        **method: Any,
    ) -> dict[str, Any]:
        """The specification. What is no argument of its own is a key of `method`, such as `rtol=1e-8`."""
        problem: dict[str, Any] = {
            "parameters": self._parameters,
            "tables": self._tables,
            "definitions": self._definitions,
            "integrals": self._integrals,
            "states": self._states,
            "variables": self._variables,
            "set": self._set,
            "mass": _written(self.mass_matrix),
        }
        problem = {key: value for key, value in problem.items() if key == "states" or (value is not None and len(value) > 0)}
        document: dict[str, Any] = {"problem": {"dvi": problem}}
        if self.label is not None:
            document["label"] = self.label
        if end is not None:
            document["time"] = {"end": end} if start is None else {"start": start, "end": end}
        if method:
            document["method"] = method
        output: dict[str, Any] = {}
        if times is not None:
            output["times"] = {"count": times} if isinstance(times, int) else times
        if fields is not None:
            output["fields"] = [getattr(field, "text", field) for field in fields]
        if output:
            document["output"] = output
        if limits:
            document["limits"] = dict(limits)
        if self._stop:
            document["stop"] = self._stop
        document.update(self.further)
        return document

    def to_json(self, end: Optional[float] = None, *, indent: Optional[int] = 1, **settings: Any) -> str:
        """The specification as text; the arguments are those of `to_dict`."""
        return dumps(self.to_dict(end, **settings), indent)

    def solve(self, end: float, *, dense: bool = False, progress: Any = None, **settings: Any) -> Result:
        """Solves it up to `end`; the other arguments are those of `to_dict` and of `dvi.solve`."""
        from ._solve import solve

        return solve(self.to_dict(end, **settings), dense=dense, progress=progress)

    def check(self, end: float, **settings: Any) -> dict[str, Any]:
        """What it comes to, without a solve."""
        from ._solve import check

        return check(self.to_dict(end, **settings))

    def sweep(
        self,
        end: float,
        over: Optional[Mapping[Any, Any]] = None,
        collect: Optional[Mapping[str, Any]] = None,
        *,
        table: Any = None,
        design: Optional[str] = None,
        count: Optional[int] = None,
        seed: Optional[int] = None,
        threads: Optional[int] = None,
        progress: Any = None,
        **settings: Any,
    ) -> Sweep:
        """Solves it up to `end` for many values of its numbers; the other arguments are those of `dvi.sweep` and `to_dict`."""
        from ._families import sweep

        document = self.to_dict(end, **settings)
        design_ = {"table": table, "design": design, "count": count, "seed": seed}
        return sweep(document, over, collect, **design_, threads=threads, progress=progress)

    def fit(
        self,
        data: Any,
        parameters: Any,
        *,
        end: Optional[float] = None,
        sd: Any = None,
        loss: Optional[str] = None,
        starts: Optional[int] = None,
        progress: Any = None,
        **settings: Any,
    ) -> Fit:
        """Fits parameters to data, with runs up to `end`, or to the last time of the data; the other arguments are those of
        `dvi.fit` and `to_dict`."""
        from ._families import fit

        document = self.to_dict(end, **settings)
        return fit(document, data, parameters, sd=sd, loss=loss, starts=starts, progress=progress)

    def sensitivities(self, end: float, to: Any, of: Any = None, *, progress: Any = None, **settings: Any) -> Sensitivities:
        """Solves it up to `end` with derivatives of states by parameters and initial values."""
        from ._families import sensitivities

        return sensitivities(self.to_dict(end, **settings), to, of, progress=progress)

    def periodic(self, period: Any, *, progress: Any = None, **settings: Any) -> Orbit:
        """Finds the orbit of a period."""
        from ._families import periodic

        return periodic(self.to_dict(**settings), _written(period), progress=progress)

    def steady_state(self, *, progress: Any = None, **settings: Any) -> SteadyState:
        """Finds where all rests."""
        from ._families import steady_state

        return steady_state(self.to_dict(**settings), progress=progress)

    def __repr__(self) -> str:
        return f"<dvi.Problem, states {', '.join(self._states) or 'none'}, variables {', '.join(self._variables) or 'none'}>"


def _fresh(name: str, names: Mapping[str, Any], kind: str) -> None:
    """A name twice would replace what stands there in silence."""
    if not isinstance(name, str):
        raise TypeError(f"the name of a {kind} is a text, not {type(name).__name__}")
    if name in names:
        raise ValueError(f"there is a {kind} {name!r} already")


def _written(value: Any) -> Any:
    """What stands in the specification: texts of expressions, numbers as they are."""
    if isinstance(value, Expression):
        return value.text
    if isinstance(value, (str, int, float)) or value is None:
        return value
    if isinstance(value, Mapping):
        return {key: _written(one) for key, one in value.items()}
    if hasattr(value, "tolist"):
        return _written(value.tolist())
    if isinstance(value, Sequence):
        return [_written(one) for one in value]
    return expression(value).text
