"""Expressions: operators of Python that build the text which a user would write."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable
from typing import Any, Union

#: Precedence of the outermost operation of an expression's text: sums, products, powers, and atoms, which need no
#: brackets.
SUM, PRODUCT, POWER, ATOM = range(4)

Operand = Union["Expression", float, int, str]


class Expression:
    """A term of the language of specifications. `text` is what stands in the specification."""

    #: Functions of numpy applied to expressions are handled by `__array_ufunc__`; arrays leave arithmetic operators
    #: to expressions.
    __slots__ = ("binds", "text")

    def __init__(self, text: str, binds: int = ATOM) -> None:
        self.text = text
        self.binds = binds

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<{self.text}>"

    # --- operators

    def __add__(self, other: Operand) -> Expression:
        return _sum(self, "+", other)

    def __radd__(self, other: Operand) -> Expression:
        return _sum(other, "+", self)

    def __sub__(self, other: Operand) -> Expression:
        return _sum(self, "-", other)

    def __rsub__(self, other: Operand) -> Expression:
        return _sum(other, "-", self)

    def __mul__(self, other: Operand) -> Expression:
        return _product(self, "*", other)

    def __rmul__(self, other: Operand) -> Expression:
        return _product(other, "*", self)

    def __truediv__(self, other: Operand) -> Expression:
        return _product(self, "/", other)

    def __rtruediv__(self, other: Operand) -> Expression:
        return _product(other, "/", self)

    def __pow__(self, other: Operand) -> Expression:
        return _power(self, other)

    def __rpow__(self, other: Operand) -> Expression:
        return _power(other, self)

    def __mod__(self, other: Operand) -> Expression:
        return mod(self, other)

    def __rmod__(self, other: Operand) -> Expression:
        return mod(other, self)

    def __neg__(self) -> Expression:
        # The unary minus has the precedence of a product: (-k)*x and -(k*x) are the same
        # number.
        return Expression("-" + _within(self, PRODUCT, first=False), PRODUCT)

    def __pos__(self) -> Expression:
        return self

    def __abs__(self) -> Expression:
        return call("abs", self)

    # --- operations without a meaning for expressions

    def _no_comparison(self, other: object) -> Any:
        raise TypeError(
            "expressions are not compared: of an inequality write the left side alone, >= 0 is understood; "
            "a choice is dvi.where(condition, a, b) with the condition as text, such as \"t >= 1\""
        )

    __lt__ = __le__ = __gt__ = __ge__ = _no_comparison

    def __bool__(self) -> bool:
        raise TypeError("an expression has no value before the problem is solved: `if`, `and` and `or` cannot look at it")

    def __float__(self) -> float:
        raise TypeError(f"`{self.text}` has no value before the problem is solved; functions are those of dvi: dvi.sin, not math.sin")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **settings: Any) -> Any:
        """Functions and operators of numpy, of expressions and numbers."""
        make = _UFUNCS.get(ufunc.__name__)
        if make is None or method != "__call__" or settings:
            return NotImplemented
        if any(getattr(operand, "shape", ()) for operand in inputs):
            raise TypeError("an expression is no array: write the elements one by one, or a vector as \"x[1..n]\"")
        return make(*inputs)


def expression(value: Operand) -> Expression:
    """An expression of a number, a text as it stands, or an expression."""
    if isinstance(value, Expression):
        return value
    if isinstance(value, str):
        # The precedence of a text from the user is unknown: unless it is a name or a number, it is put in brackets
        # wherever it stands within another expression.
        atom = value.isidentifier() or value.replace(".", "", 1).isdigit()
        return Expression(value, ATOM if atom else -1)
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        if hasattr(value, "item") and getattr(value, "size", 0) == 1:
            return expression(value.item())
        hint = "; a parameter with a name of the builder's own is p[\"name\"]" if callable(value) else ""
        raise TypeError(f"{value!r} is no expression: a number, a text or a term is{hint}")
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} is no value of an expression")
    text = repr(int(value)) if isinstance(value, numbers.Integral) else repr(number)
    return Expression(text, PRODUCT if text.startswith("-") else ATOM)


def _within(value: Operand, least: int, first: bool) -> str:
    """The text of an operand, in brackets where it binds less tightly, or begins with a sign behind an operator."""
    term = expression(value)
    needs = term.binds < least or (not first and term.text.startswith("-"))
    return f"({term.text})" if needs else term.text


def _sum(left: Operand, sign: str, right: Operand) -> Expression:
    if not _is_operand(left) or not _is_operand(right):
        return NotImplemented  # type: ignore[no-any-return]
    return Expression(f"{_within(left, SUM, True)} {sign} {_within(right, PRODUCT, False)}", SUM)


def _product(left: Operand, sign: str, right: Operand) -> Expression:
    if not _is_operand(left) or not _is_operand(right):
        return NotImplemented  # type: ignore[no-any-return]
    return Expression(f"{_within(left, PRODUCT, True)}{sign}{_within(right, POWER, False)}", PRODUCT)


def _power(left: Operand, right: Operand) -> Expression:
    if not _is_operand(left) or not _is_operand(right):
        return NotImplemented  # type: ignore[no-any-return]
    return Expression(f"{_within(left, ATOM, False)}^{_within(right, ATOM, False)}", POWER)


def _is_operand(value: object) -> bool:
    if isinstance(value, (Expression, str, numbers.Real)):
        return True
    return hasattr(value, "item") and getattr(value, "size", 0) == 1


def call(name: str, *arguments: Operand) -> Expression:
    """A call of a function of the language."""
    return Expression(f"{name}({', '.join(expression(argument).text for argument in arguments)})")


def _function(name: str, meaning: str) -> Callable[..., Expression]:
    def function(*arguments: Operand) -> Expression:
        return call(name, *arguments)

    function.__name__ = function.__qualname__ = name
    function.__doc__ = meaning
    return function


#: The time t, the independent variable.
t = Expression("t")

sin = _function("sin", "The sine; angles are in radians.")
cos = _function("cos", "The cosine.")
tan = _function("tan", "The tangent.")
asin = _function("asin", "The inverse sine.")
acos = _function("acos", "The inverse cosine.")
atan = _function("atan", "The inverse tangent.")
atan2 = _function("atan2", "The angle of the point (second argument, first argument).")
sinh = _function("sinh", "The hyperbolic sine.")
cosh = _function("cosh", "The hyperbolic cosine.")
tanh = _function("tanh", "The hyperbolic tangent.")
exp = _function("exp", "The exponential.")
ln = _function("ln", "The natural logarithm.")
log10 = _function("log10", "The logarithm to the base ten.")
sqrt = _function("sqrt", "The square root.")
cbrt = _function("cbrt", "The cubic root.")
sign = _function("sign", "The sign: a jump, which a variable in [-1, 1] solves exactly.")
minimum = _function("min", "The least of two or more.")
maximum = _function("max", "The largest of two or more.")
heaviside = _function("heaviside", "One above zero, zero below.")
floor = _function("floor", "Rounded down; of time and parameters.")
ceil = _function("ceil", "Rounded up; of time and parameters.")
round_ = _function("round", "Rounded; of time and parameters.")
mod = _function("mod", "The remainder; of time and parameters.")
pwm = _function("pwm", "pwm(t, period, duty): one for the first part of each period, then zero.")
sawtooth = _function("sawtooth", "sawtooth(t, period): from zero to one over each period.")
triangle = _function("triangle", "triangle(t, period): up and down over each period.")
pulse = _function("pulse", "pulse(t, start, width): one from `start` on for `width`, else zero.")


def where(condition: str, then: Operand, otherwise: Operand) -> Expression:
    """`if(condition, then, otherwise)`: the condition is text in time and parameters, such as `"t >= t_on"`."""
    return Expression(f"if({condition}, {expression(then).text}, {expression(otherwise).text})")


def sum_(term: Operand, index: str, start: Operand, end: Operand) -> Expression:
    """`sum(term for index in start..end)`, of the elements of vectors."""
    bounds = f"{_within(start, ATOM, True)}..{_within(end, ATOM, True)}"
    return Expression(f"sum({expression(term).text} for {index} in {bounds})")


_UFUNCS: dict[str, Callable[..., Expression]] = {
    "add": lambda a, b: _sum(a, "+", b),
    "subtract": lambda a, b: _sum(a, "-", b),
    "multiply": lambda a, b: _product(a, "*", b),
    "divide": lambda a, b: _product(a, "/", b),
    "power": _power,
    "float_power": _power,
    "negative": lambda a: -expression(a),
    "positive": expression,
    "absolute": lambda a: call("abs", a),
    "fabs": lambda a: call("abs", a),
    "square": lambda a: _power(a, 2),
    "remainder": mod,
    "sin": sin, "cos": cos, "tan": tan, "arcsin": asin, "arccos": acos, "arctan": atan, "arctan2": atan2,
    "sinh": sinh, "cosh": cosh, "tanh": tanh, "exp": exp, "log": ln, "log10": log10, "sqrt": sqrt, "cbrt": cbrt,
    "sign": sign, "minimum": minimum, "maximum": maximum, "floor": floor, "ceil": ceil, "rint": round_,
}
