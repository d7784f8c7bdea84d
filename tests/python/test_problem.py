"""The builder writes what a user would write."""

import json
import math
import random

import numpy as np
import pytest

import dvi


def test_the_text_is_that_of_a_user():
    p = dvi.Problem(m=1, k=1, f=1, v_belt=0.5)
    x, v = p.state("x", 4), p.state("v", 0)
    F = p.box("F", -p.f, p.f, inequality=-(v - p.v_belt))
    x.rate = v
    v.rate = (-p.k * x - F) / p.m
    assert json.loads(p.to_json(20, rtol=1e-8)) == {
        "problem": {
            "dvi": {
                "parameters": {"m": 1, "k": 1, "f": 1, "v_belt": 0.5},
                "states": {"x": {"initial": 4, "rate": "v"}, "v": {"initial": 0, "rate": "(-k*x - F)/m"}},
                "variables": {"F": {"inequality": "-(v - v_belt)"}},
                "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}],
            }
        },
        "time": {"end": 20},
        "method": {"rtol": 1e-08},
    }


def test_brackets_stand_where_they_are_needed():
    p = dvi.Problem(a=1, b=2, c=3)
    a, b, c = p.a, p.b, p.c
    written = {
        "a - (b - c)": a - (b - c),
        "a - b - c": a - b - c,
        "a/(b*c)": a / (b * c),
        "a/b*c": a / b * c,
        "(a + b)*c": (a + b) * c,
        "-(a + b)": -(a + b),
        "a*(-b)": a * -b,
        "a - (-b)": a - -b,
        "(-a)^2": (-a) ** 2,
        "-a^2": -(a**2),
        "(a^b)^c": (a**b) ** c,
        "a^(b^c)": a**b**c,
        "2^a": 2**a,
        "(-1.0)^a": (-1.0) ** a,
        "abs(a - b)": abs(a - b),
        "sin(a)*cos(b)": dvi.sin(a) * np.cos(b),
        "2.0*a": np.float64(2) * a,
        "mod(a, b)": a % b,
        "(a + 1)*b": dvi.expression("a + 1") * b,
        "sum(k*x[k] for k in 1..(n - 1))": dvi.sum_("k*x[k]", "k", 1, dvi.expression("n") - 1),
    }
    assert {text: made.text for text, made in written.items()} == {text: text for text in written}


def value_in_python(text):
    return eval(text.replace("^", "**"), {"sin": math.sin, "cos": math.cos, "abs": abs})


@pytest.mark.parametrize("seed", range(20))
def test_random_terms_have_the_value_that_python_gives_them(seed):
    draw = random.Random(seed)
    numbers = {"a": 1.25, "b": -0.75, "c": 2.5}
    p = dvi.Problem(**numbers)

    def term(depth):
        if depth == 0 or draw.random() < 0.1:
            name = draw.choice("abc")
            return getattr(p, name), numbers[name]
        left, right = term(depth - 1), term(depth - 1)
        kind = draw.choice("+-*/n2s")
        if kind == "n":
            return -left[0], -left[1]
        if kind == "2":
            return left[0] ** 2, left[1] ** 2
        if kind == "s":
            return dvi.sin(left[0]), math.sin(left[1])
        if kind == "/":
            if right[1] == 0.0:
                return left
            return left[0] / right[0], left[1] / right[1]
        made = {"+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y}[kind]
        return made(left[0], right[0]), made(left[1], right[1])

    made, value = term(5)
    p.state("x", made, rate=0)
    found = p.solve(1, times=2)["x"][0]
    assert math.isclose(found, value, rel_tol=1e-12, abs_tol=1e-300), made.text


def test_what_python_would_do_in_silence_is_refused():
    p = dvi.Problem(a=1)
    x = p.state("x", 0)
    with pytest.raises(TypeError, match="left side alone"):
        x >= 0
    with pytest.raises(TypeError, match="no value before"):
        if x:
            pass
    with pytest.raises(TypeError, match="dvi.sin"):
        math.sin(x)
    with pytest.raises(TypeError, match="no array"):
        x + np.array([1.0, 2.0])
    with pytest.raises(ValueError, match="already"):
        p.state("x", 1)
    with pytest.raises(AttributeError, match="no parameter 'b'"):
        p.b
    with pytest.raises(ValueError):
        x + math.inf


def test_a_parameter_may_have_a_name_of_the_builder():
    p = dvi.Problem(stop=2, mass=4)
    x = p.state("x", 1)
    with pytest.raises(TypeError):
        x / p.stop
    with pytest.raises(TypeError, match="the builder's own"):
        dvi.sin(p.stop)
    x.rate = -p["stop"] * x / p["mass"]
    assert x.rate == "-stop*x/mass" and abs(p.solve(1, rtol=1e-9)["x"][-1] - math.exp(-0.5)) < 1e-8
    with pytest.raises(KeyError, match="no parameter"):
        p["x"]


def test_a_mass_matrix_stands_before_the_rates():
    p = dvi.Problem()
    x, y = p.state("x", 1), p.state("y", 1)
    x.rate, y.rate = -x, -y
    p.mass_matrix = np.array([[2.0, 0.0], [0.0, 4.0]])
    r = p.solve(1, rtol=1e-9)
    assert abs(r["x"][-1] - math.exp(-0.5)) < 1e-8 and abs(r["y"][-1] - math.exp(-0.25)) < 1e-8


def test_what_is_left_out_is_an_error_of_the_specification():
    p = dvi.Problem()
    p.state("x", 0)
    with pytest.raises(dvi.SpecificationError) as raised:
        p.solve(1)
    assert [(error.pointer, error.code) for error in raised.value.errors] == [("/problem/dvi/states/x", "missing_key")]


def test_sets_definitions_integrals_tables_and_stops_reach_the_solver():
    p = dvi.Problem("a ramp")
    ramp = p.table("ramp", [0, 1, 2], [0, 1, 0])
    x = p.state("x", 0, rate=ramp(dvi.t))
    p.define("twice", 2 * x)
    p.integral("area", x)
    p.stop(x - 0.25, label="quarter", record=True)
    r = p.solve(2, fields=["x", "twice", "area"], rtol=1e-9)
    assert abs(r["x"][-1] - 1.0) < 1e-8 and abs(r["twice"][-1] - 2.0) < 1e-8
    assert abs(r["area"][-1] - 1.0) < 1e-7
    (event,) = [event for event in r.events if event.kind == "crossed"]
    # The state x = t^2/2 reaches the level 1/4 of the stop condition at t = 1/sqrt(2).
    assert event.of == "quarter" and abs(event.t - math.sqrt(0.5)) < 1e-7


def test_a_vector_is_one_member():
    p = dvi.Problem(n=3)
    x = p.state("x[1..n]", 1, rate="-i*x[i]")
    p.define("total", dvi.sum_(x["k"], "k", 1, p.n))
    r = p.solve(1, rtol=1e-9, fields=["x[3]", "total"])
    assert abs(r["x[3]"][-1] - math.exp(-3)) < 1e-8
    assert abs(r["total"][-1] - sum(math.exp(-k) for k in (1, 2, 3))) < 1e-8
    assert x[2].text == "x[2]"


def test_variables_of_a_block_come_together():
    p = dvi.Problem(mu=1)
    v, w = p.state("v", 3), p.state("w", 4)
    F, G = p.ball(["F", "G"], p.mu, inequality=[-v, -w])
    v.rate, w.rate = -F, -G
    r = p.solve(4, rtol=1e-9)
    # Coulomb friction in the plane: the speed decreases from 5 at the rate mu, and the
    # direction is constant.
    assert abs(r["v"][-1] - 0.6) < 1e-7 and abs(r["w"][-1] - 0.8) < 1e-7
    with pytest.raises(ValueError, match="as many inequalities"):
        p.box(["a", "b"], 0, 1, inequality=[v])
