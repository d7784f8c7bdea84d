"""Differential variational inequalities, solved with evidence.

    M x' = f(t,x) + B(t,x) z,    z in K,    <G(t,x,z), z~ - z> >= 0  for all z~ in K

One form covers impacts and Coulomb friction, ideal diodes and switches, relays and sliding modes, queues, and stiff
differential-algebraic equations.

>>> import dvi
>>> p = dvi.Problem(m=1, k=1, f=1, v_belt=0.5)
>>> x, v = p.state("x", 4), p.state("v", 0)
>>> F = p.box("F", -p.f, p.f, inequality=-(v - p.v_belt))
>>> x.rate = v; v.rate = (-p.k*x - F)/p.m
>>> r = p.solve(20, rtol=1e-8)
>>> r.verdict.trusted
True

`solve` takes a builder, a `dict`, JSON text or the path of a file; `Client(url).solve` has a service solve the same. A `Result`
has its columns as numpy arrays (`r.t`, `r["x"]`), its events, its diagnostics and its verdict. `sweep`, `fit`, `periodic`,
`steady_state` and `sensitivities` take the same, and give results with more to them.
"""

from ._client import Client, Job, ServiceError
from ._dvi import __version__
from ._expression import (
    Expression,
    acos,
    asin,
    atan,
    atan2,
    cbrt,
    ceil,
    cos,
    cosh,
    exp,
    expression,
    floor,
    heaviside,
    ln,
    log10,
    maximum,
    minimum,
    mod,
    pulse,
    pwm,
    round_,
    sawtooth,
    sign,
    sin,
    sinh,
    sqrt,
    sum_,
    t,
    tan,
    tanh,
    triangle,
    where,
)
from ._families import fit, periodic, sensitivities, steady_state, sweep
from ._problem import Definition, Integral, Parameter, Problem, State, Table, Variable
from ._result import Event, Result, SolveError, UntrustedWarning, Verdict
from ._searches import Estimate, Fit, Orbit, Sensitivities, SteadyState
from ._solve import catalogue, check, example, examples, schema, solve
from ._specification import Fault, SpecificationError
from ._sweep import Sweep

__all__ = [
    "Client", "Definition", "Estimate", "Event", "Expression", "Fault", "Fit", "Integral", "Job", "Orbit", "Parameter",
    "Problem", "Result", "Sensitivities", "ServiceError", "SolveError", "SpecificationError", "State", "SteadyState",
    "Sweep", "Table", "UntrustedWarning", "Variable", "Verdict", "__version__", "acos", "asin", "atan", "atan2",
    "catalogue", "cbrt", "ceil", "check", "cos", "cosh", "example", "examples", "exp", "expression", "fit", "floor",
    "heaviside", "ln", "log10", "maximum", "minimum", "mod", "periodic", "pulse", "pwm", "round_", "sawtooth", "schema",
    "sensitivities", "sign", "sin", "sinh", "solve", "sqrt", "steady_state", "sum_", "sweep", "t", "tan", "tanh",
    "triangle", "where",
]
