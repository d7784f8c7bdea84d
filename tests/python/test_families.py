"""Sweeps, fits, derivatives, orbits and states of rest, each against a closed form; tables to the byte of the program's."""

import json
import math
import os
import pickle
import signal
import subprocess
import threading

import numpy as np
import pytest
from conftest import ROOT
from test_solve import without_times

import dvi


@pytest.fixture
def decay():
    """x' = -k x from 1: x = exp(-k t)."""
    problem = {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}
    return {"problem": {"dvi": problem}, "time": {"end": 1}, "method": {"rtol": 1e-10}}


# --- sweeps


def test_a_sweep_has_what_the_closed_form_has(decay):
    k = np.linspace(0.5, 3, 6)
    reducers = {"end": {"final": "x"}, "mean": {"mean": "x"}, "work": {"integral": "k*x^2"}, "half": {"at": {"t": 0.5, "of": "x"}}}
    s = dvi.sweep(decay, {"k": k}, reducers)
    assert isinstance(s, dvi.Sweep) and s.status == "completed" and s.trusted and s.failed == 0
    assert (s["k"] == k).all() and s.rows == s.members == 6
    assert np.abs(s["end"] - np.exp(-k)).max() < 1e-9
    assert np.abs(s["mean"] - (1 - np.exp(-k)) / k).max() < 1e-9
    assert np.abs(s["work"] - (1 - np.exp(-2 * k)) / 2).max() < 1e-9
    assert np.abs(s["half"] - np.exp(-k / 2)).max() < 1e-9
    assert s.swept == ["k"] and s.collected == list(reducers)
    assert abs(s.summary["end"]["mean"] - np.exp(-k).mean()) < 1e-9


@pytest.mark.parametrize("extension", ["csv", "ndjson", "arrow", "svg", "json"])
def test_a_table_is_that_of_the_program_to_the_byte(extension, program, tmp_path):
    path, told, saved = ROOT / "api/examples/friction_belt_map.json", tmp_path / f"told.{extension}", tmp_path / f"saved.{extension}"
    subprocess.run([program, "sweep", "-o", told, path], check=True, capture_output=True)
    s = dvi.solve(path)
    assert isinstance(s, dvi.Sweep)
    s.save(saved)
    if extension == "json":
        told, saved = json.loads(told.read_bytes()), json.loads(saved.read_bytes())
        assert without_times(told) == without_times(saved)
    elif extension == "arrow":
        # The metadata of an Arrow schema have no order.
        pyarrow = pytest.importorskip("pyarrow")
        tables = [pyarrow.ipc.open_stream(path.read_bytes()).read_all() for path in (told, saved)]
        assert tables[0].equals(tables[1], check_metadata=True)
        assert tables[0].equals(s.to_arrow(), check_metadata=True)
    else:
        assert told.read_bytes() == saved.read_bytes()


def test_rows_do_not_depend_on_the_number_of_threads(decay):
    over = {"k": {"normal": [1, 0.2]}, "x.initial": {"uniform": [0, 1]}}
    tables = [dvi.sweep(decay, over, design="sobol", count=64, seed=3, threads=n).to_csv() for n in (1, 2, 5, None)]
    assert len(set(tables)) == 1
    with pytest.raises(ValueError, match="at least one"):
        dvi.sweep(decay, over, design="sobol", count=8, threads=0)


def test_columns_of_a_sweep_are_views_that_keep_it_alive(decay):
    s = dvi.sweep(decay, {"k": np.linspace(0, 1, 1000)})
    k = s["k"]
    assert k.ctypes.data == s["k"].ctypes.data and not k.flags.owndata and not k.flags.writeable
    assert s["member"].dtype == np.uint32 and s["trusted"].dtype == bool and s["trusted"].all()
    pyarrow = pytest.importorskip("pyarrow")
    table = s.to_arrow()
    assert isinstance(table, pyarrow.Table) and table.column("k").chunk(0).buffers()[1].address == k.ctypes.data
    del s
    assert k[-1] == 1 and table.column("k")[999].as_py() == 1


def test_a_grid_has_an_axis_for_each_name(decay):
    k, start = np.array([1.0, 2.0, 3.0]), np.array([1.0, -2.0])
    s = dvi.sweep(decay, {"k": k, "x.initial": start}, {"end": {"final": "x"}, "modes": "mode_word"})
    assert list(s.axes) == ["k", "x.initial"] and s.grid("end").shape == (3, 2)
    assert np.abs(s.grid("end") - np.exp(-k)[:, None] * start).max() < 1e-8
    assert s.grid("modes")[0, 0] == "free"
    xarray = pytest.importorskip("xarray")
    data = s.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert float(data["end"].sel({"k": 2.0, "x.initial": -2.0})) == s.grid("end")[1, 1]
    frame = s.to_pandas()
    assert frame.index.name == "member" and frame["end"].iloc[5] == s["end"][5]
    drawn = dvi.sweep(decay, {"k": {"uniform": [0, 1]}, "x.initial": {"uniform": [0, 1]}}, design="random", count=5)
    assert drawn.axes is None and drawn.to_xarray().sizes == {"member": 5}
    with pytest.raises(ValueError, match="no grid"):
        drawn.grid("x")


def test_trajectories_that_are_kept_are_arrays_over_their_times(decay, tmp_path):
    decay["output"] = {"times": {"count": 5}}
    decay["sweep"] = {"keep": "trajectories"}
    k, start = np.array([1.0, 2.0, 3.0]), np.array([1.0, -2.0])
    s = dvi.sweep(decay, {"k": k, "x.initial": start}, {"end": {"final": "x"}})
    x = s["trajectory.x"]
    assert (s.times == np.linspace(0, 1, 5)).all() and x.shape == (6, 5) and not x.flags.owndata and not x.flags.writeable
    assert np.abs(x - s["x.initial"][:, None] * np.exp(-s["k"][:, None] * s.times)).max() < 1e-8
    assert s.grid("trajectory.x").shape == (3, 2, 5) and (s.grid("trajectory.x")[2, 1] == x[5]).all()
    with pytest.raises(TypeError, match="trajectory.x"):
        s(0.5)
    pyarrow = pytest.importorskip("pyarrow")
    column = s.to_arrow().column("trajectory.x")
    assert column.type == pyarrow.list_(pyarrow.float64(), 5) and column[5].as_py() == x[5].tolist()
    saved = tmp_path / "saved.arrow"
    s.save(saved)
    assert pyarrow.ipc.open_stream(saved.read_bytes()).read_all().equals(s.to_arrow(), check_metadata=True)
    pytest.importorskip("xarray")
    data = s.to_xarray()
    assert data["trajectory.x"].dims == ("k", "x.initial", "t") and data["end"].dims == ("k", "x.initial")
    assert (s.to_pandas()["trajectory.x"].iloc[5] == x[5]).all()
    drawn = dvi.sweep(decay, {"k": {"uniform": [0, 1]}, "x.initial": {"uniform": [0, 1]}}, design="random", count=3)
    assert drawn.to_xarray()["trajectory.x"].dims == ("member", "t")
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    assert len(s.plot("trajectory.x").axes[0].lines) == 6


def test_counts_are_numbers_of_32_bits_however_a_table_packs_them(decay):
    s = dvi.sweep(decay, {"k": np.linspace(0, 400, 401)})
    assert (s["member"] == np.arange(401)).all() and not s["member"].flags.writeable
    rows = [line.split(",") for line in s.to_csv().decode().splitlines()]
    for name in ("member", "steps", "switches"):
        assert s[name].dtype == np.uint32 and s[name].tolist() == [int(row[rows[0].index(name)]) for row in rows[1:]]
    assert s.to_arrow().column("steps").to_pylist() == s["steps"].tolist()


def test_members_that_fail_are_rows(decay):
    decay["problem"]["dvi"]["states"]["x"]["rate"] = "k*x^2"
    decay["limits"] = {"steps": 2000}
    s = dvi.sweep(decay, {"k": [0.5, 2]}, {"end": {"final": "x"}, "when": {"time_of_first": "crossed"}})
    assert s.failed == 1 and list(s["error"])[0] is None and s["error"][1]
    assert abs(s["end"][0] - 2) < 1e-7 and np.isnan(s["end"][1]) and np.isnan(s["when"]).all()
    table = s.to_arrow()
    assert table.column("end").null_count == 1 and table.column("end")[1].as_py() is None
    assert "1 failed" in repr(s)


def test_values_of_members_come_in_a_table(decay):
    s = dvi.sweep(decay, table={"k": np.array([1.0, 2.0]), "x.initial": [1, 3]})
    assert np.abs(s["x"] - np.array([1, 3]) * np.exp([-1, -2])).max() < 1e-8
    pandas = pytest.importorskip("pandas")
    again = dvi.sweep(decay, table=pandas.DataFrame({"k": [1.0, 2.0], "x.initial": [1, 3]}))
    assert again.to_csv() == s.to_csv()
    with pytest.raises(ValueError, match="one length"):
        dvi.sweep(decay, table={"k": [1, 2], "x.initial": [1]})


def test_what_a_sweep_has_no_place_for_is_refused_with_its_place(decay):
    with pytest.raises(dvi.SpecificationError) as raised:
        dvi.sweep(decay, {"kk": [1, 2]})
    assert "kk" in str(raised.value) and raised.value.errors[0].pointer.startswith("/sweep")
    with pytest.raises(dvi.SpecificationError):
        dvi.sweep(decay)
    with pytest.raises(KeyError, match="did you mean 'end'"):
        dvi.sweep(decay, {"k": [1]}, {"end": {"final": "x"}})["edn"]
    with pytest.raises(TypeError, match="keeps no trajectories"):
        dvi.sweep(decay, {"k": [1]})(0.5)
    with pytest.raises(ValueError, match="no NaN"):
        dvi.sweep(decay, {"k": [1, math.nan]})


def test_the_builder_sweeps_with_its_own_expressions():
    p = dvi.Problem(k=2)
    x = p.state("x", 1)
    x.rate = -p.k * x
    s = p.sweep(1, {"k": [1, 2]}, {"square": {"final": x * x}}, rtol=1e-10)
    assert np.abs(s["square"] - np.exp([-2, -4])).max() < 1e-9


def test_a_sweep_of_the_specification_is_changed_where_it_is_asked_for():
    spec = dvi.example("friction_belt_map")
    s = dvi.sweep(spec, {"f": [1.0]})
    assert s.swept == ["f"] and "peak" in s.collected and s.rows == 1


def test_ctrl_c_keeps_the_rows_that_are_done(endless):
    endless["time"]["end"] = 1000
    endless["method"]["rtol"] = 1e-6
    threading.Timer(0.7, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt) as raised:
        dvi.sweep(endless, {"x.initial": {"uniform": [1, 2]}}, design="random", count=1_000_000)
    so_far = raised.value.result
    assert isinstance(so_far, dvi.Sweep) and 0 < so_far.rows < so_far.members == 1_000_000
    assert so_far.status == "stopped" and so_far.error["code"] == "cancelled"


def test_pictures_of_sweeps(decay):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    line = dvi.sweep(decay, {"k": [1, 2, 3]}, {"end": {"final": "x"}, "modes": "mode_word"})
    assert len(line.plot().axes) == 2 and "<svg" in line._repr_html_()
    grid = dvi.sweep(decay, {"k": [1, 2, 3], "x.initial": [1, 2]}, {"end": {"final": "x"}, "modes": "mode_word"})
    assert len(grid.plot().axes) == 4  # two maps and their colour bars
    cloud = dvi.sweep(decay, {"k": {"uniform": [0, 1]}}, design="latin_hypercube", count=8)
    assert len(cloud.plot("x").axes) == 1


def test_sweeps_are_pickled_and_read_back(decay):
    s = dvi.sweep(decay, {"k": [1, 2]})
    back = pickle.loads(pickle.dumps(s))
    assert isinstance(back, dvi.Sweep) and back.to_csv() == s.to_csv() and back.summary == s.summary
    assert isinstance(dvi.Result.from_json(s.to_json()), dvi.Sweep)


# --- fits


def test_a_straight_line_has_the_estimates_of_the_normal_equations():
    # Reference for the fit of x' = a with x(0) = b and unit weights: ordinary least squares.
    rng = np.random.default_rng(1)
    t = np.arange(1.0, 21.0)
    x = 0.7 + 0.3 * t + 0.1 * rng.standard_normal(20)
    spec = {"problem": {"dvi": {"parameters": {"a": 1}, "states": {"x": {"initial": 0, "rate": "a"}}}}}
    found = dvi.fit(spec, {"t": t, "x": x}, ["a", "x.initial"])
    design = np.stack([t, np.ones(20)], axis=1)
    exact, (rss,), *_ = np.linalg.lstsq(design, x, rcond=None)
    covariance = np.linalg.inv(design.T @ design) * rss / 18
    assert isinstance(found, dvi.Fit) and list(found.estimates) == ["a", "x.initial"]
    assert np.allclose([found.parameters["a"], found.parameters["x.initial"]], exact, rtol=1e-6)
    assert np.allclose(found.covariance, covariance, rtol=1e-4)
    assert np.allclose(found.estimates["a"].sd, math.sqrt(covariance[0, 0]), rtol=1e-4)
    assert abs(found.spread - math.sqrt(rss / 18)) < 1e-6 and found.observations == 20
    assert np.allclose(found.residuals["x"], x - design @ exact, atol=1e-6)
    correlation = covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1])
    assert abs(found.correlation[0, 1] - correlation) < 1e-4
    # The 97.5 % quantile of Student's t distribution with 18 degrees of freedom scales the
    # confidence interval.
    assert abs((found.estimates["a"].upper - exact[0]) / found.estimates["a"].sd - 2.10092) < 1e-3


def test_a_fit_of_the_program_is_that_of_python(program):
    path = ROOT / "api/examples/belt_fit.json"
    told = json.loads(subprocess.run([program, "solve", path], capture_output=True, check=False).stdout)
    found = dvi.solve(path)
    assert isinstance(found, dvi.Fit) and found.fit == told["fit"]
    spec = dvi.example("belt_fit")
    asked = spec.pop("fit")
    again = dvi.fit(spec, asked["data"], {name: (one["lower"], one["upper"]) for name, one in asked["parameters"].items()})
    assert again.fit == told["fit"]


def test_data_come_in_frames_with_gaps(decay):
    pandas = pytest.importorskip("pandas")
    t = np.linspace(0.1, 1, 10)
    x = np.exp(-2 * t)
    x[3] = np.nan
    frame = pandas.DataFrame({"x": x}, index=pandas.Index(t, name="t"))
    found = dvi.fit(decay, frame, {"k": (0.1, 10), "x.initial": 0.9}, sd=1e-3)
    assert abs(found.parameters["k"] - 2) < 1e-5 and found.observations == 9 and np.isnan(found.residuals["x"][3])
    assert abs(found.parameters["x.initial"] - 1) < 1e-5
    assert list(found.frame().columns) == ["estimate", "sd", "lower", "upper"]
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    assert len(found.plot("x").axes[0].lines) == 2 and "fitted" in repr(found)


def test_what_data_do_not_determine_has_no_error(decay):
    decay["problem"]["dvi"]["parameters"] = {"k": 1, "j": 1}
    decay["problem"]["dvi"]["states"]["x"]["rate"] = "-k*j*x"
    t = np.linspace(0.1, 1, 10)
    found = dvi.fit(decay, {"t": t, "x": np.exp(-2 * t), "sd": 0.01}, ["k", "j"])
    assert found.undetermined and found.estimates["k"].sd is None and np.isnan(found.covariance).all()


def test_data_without_times_are_refused(decay):
    with pytest.raises(ValueError, match="the times as `t`"):
        dvi.fit(decay, {"x": [1]}, ["k"])
    with pytest.raises(TypeError, match="mapping of columns"):
        dvi.fit(decay, [1, 2], ["k"])
    with pytest.raises(dvi.SpecificationError, match="there is no parameter"):
        dvi.fit(decay, {"t": [1], "x": [1]}, "q")


def test_the_builder_fits_up_to_the_end_of_the_data():
    p = dvi.Problem(k=1)
    x = p.state("x", 1)
    x.rate = -p.k * x
    t = [0.5, 1, 2, 4]
    found = p.fit({"t": t, x: np.exp(-0.5 * np.array(t)), "sd": 1e-4}, [p.k], rtol=1e-9)
    assert abs(found.parameters["k"] - 0.5) < 1e-6 and found.t[-1] == 4


# --- derivatives, periodic orbits, steady states


def test_derivatives_are_those_of_the_closed_form(decay):
    decay["output"] = {"times": {"count": 11}}
    r = dvi.sensitivities(decay, ["k", "x.initial"])
    assert isinstance(r, dvi.Sensitivities) and r.to == ["k", "x.initial"] and r.of == ["x"]
    assert np.abs(r.derivative("x", "k") + r.t * np.exp(-r.t)).max() < 1e-8
    assert r.jacobian.shape == (11, 1, 2) and np.abs(r.jacobian[:, 0, 1] - np.exp(-r.t)).max() < 1e-8
    p = dvi.Problem(k=1)
    x = p.state("x", 1)
    x.rate = -p.k * x
    built = p.sensitivities(1, p.k, x, rtol=1e-10)
    assert abs(built.derivative(x, p.k)[-1] + math.exp(-1)) < 1e-8


def test_a_gradient_is_that_of_the_closed_form(decay):
    # The solution is x = exp(-k t), and the integral of x^2 over the run is (1 - exp(-2 k t))/2k.
    assert dvi.solve(decay).gradient == {} and dvi.solve(decay).objective is None
    end, to = decay["time"]["end"], ["k", "x.initial"]
    decay["sensitivities"] = {"to": to, "mode": "adjoint", "objective": {"integral": "x^2"}}
    r, left = dvi.solve(decay), math.exp(-2 * end)
    assert list(r.gradient) == to and abs(r.objective - (1 - left) / 2) < 1e-8
    assert abs(r.gradient["k"] - (end * left - (1 - left) / 2)) < 1e-7
    assert abs(r.gradient["x.initial"] - (1 - left)) < 1e-7


def test_an_orbit_has_its_multipliers_and_means():
    # The periodic orbit is x = (sin t - cos t)/2; a deviation from it decays by the
    # factor exp(-2 pi) per period.
    spec = {"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "-x + sin(t)"}}}}, "method": {"rtol": 1e-9}}
    r = dvi.periodic(spec, "2*pi")
    assert isinstance(r, dvi.Orbit) and r.multipliers.dtype == complex and r.stable
    assert abs(r.multipliers[0] - math.exp(-2 * math.pi)) < 1e-7 and abs(r.period - 2 * math.pi) < 1e-14
    assert abs(r.start["x"] + 0.5) < 1e-8 and abs(r.over_period["x"]["rms"] - 0.5) < 1e-7
    assert "stable" in repr(r)


def test_a_free_period_is_found():
    # The period of the van der Pol oscillator with mu = 1 is
    # 6.6632868593231301896996820305 (Amore 2022).
    p = dvi.Problem()
    x, v = p.state("x", 2), p.state("v", 0)
    x.rate, v.rate = v, (1 - x**2) * v - x
    r = p.periodic({"free": 6.6, "phase": "v"}, rtol=1e-10)
    assert abs(r.period - 6.6632868593231302) < 1e-7


def test_a_state_of_rest_has_its_eigenvalues():
    p = dvi.Problem(g=9.81, k=10.0, c=2.0)
    x, v = p.state("x", 1), p.state("v", 0)
    x.rate, v.rate = v, p.g - p.k * x - p.c * v
    r = p.steady_state()
    assert isinstance(r, dvi.SteadyState) and abs(r.states["x"] - 0.981) < 1e-9 and r.stable
    assert np.abs(np.sort_complex(r.eigenvalues) - np.sort_complex(np.roots([1, 2, 10]))).max() < 1e-9


def test_every_family_is_solved_by_a_service_too(service, decay):
    client = dvi.Client(service)
    s = client.sweep(decay, {"k": [1, 2]}, {"end": {"final": "x"}})
    assert isinstance(s, dvi.Sweep) and s.to_csv() == dvi.sweep(decay, {"k": [1, 2]}, {"end": {"final": "x"}}).to_csv()
    data = {"t": [0.5, 1.0], "x": np.exp([-1.0, -2.0]), "sd": 0.01}
    assert abs(client.fit(decay, data, ["k"]).parameters["k"] - 2) < 1e-6
    assert isinstance(client.sensitivities(decay, "k"), dvi.Sensitivities)
    spec = {"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "-x + sin(t)"}}}}}
    assert abs(client.periodic(spec, "2*pi").start["x"] + 0.5) < 1e-5
    assert isinstance(client.steady_state({**spec, "problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "1 - x"}}}}}), dvi.SteadyState)


def test_what_is_looked_for_and_not_found_raises_with_what_there_is():
    spec = {"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "1"}}}}}
    with pytest.raises(dvi.SolveError) as raised:
        dvi.periodic(spec, 1.0)
    assert raised.value.code and raised.value.result.orbit is None
    assert isinstance(pickle.loads(pickle.dumps(raised.value)), dvi.SolveError)
