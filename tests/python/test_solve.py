"""Solves in this process: the digits of the program, numpy without copies, errors, threads and Ctrl-C."""

import json
import math
import os
import signal
import subprocess
import threading
import time

import numpy as np
import pytest
from conftest import EXAMPLES, ROOT

import dvi


def without_times(evidence):
    """Evidence without what the clock says."""
    if isinstance(evidence, dict):
        return {key: without_times(value) for key, value in evidence.items() if "seconds" not in key and key != "picture"}
    return [without_times(entry) for entry in evidence] if isinstance(evidence, list) else evidence


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::dvi.UntrustedWarning")
def test_every_example_has_the_digits_of_the_program(path, program):
    told = json.loads(subprocess.run([program, "solve", path], capture_output=True, check=False).stdout)
    found = dvi.solve(path)
    columns = told["table"]["columns"] if isinstance(found, dvi.Sweep) else told["trajectory"]["fields"]
    assert found.names == list(columns)
    assert found.t.tobytes() == np.array(told["trajectory"]["t"], dtype=float).tobytes()
    for name, values in told["trajectory"]["fields"].items():
        assert found[name].tobytes() == np.array(values, dtype=float).tobytes(), name
    assert [event._asdict() for event in found.events] == told["trajectory"]["events"]
    assert without_times(json.loads(found.to_json())) == without_times(told)


def test_a_specification_is_a_dict_a_text_a_path_or_a_builder(belt, tmp_path):
    path = tmp_path / "belt.json"
    path.write_text(json.dumps(belt))
    p = dvi.Problem(m=1, c=0.1, k=1, f=1, v_belt=0.5)
    x, v = p.state("x", 4), p.state("v", 0)
    F = p.box("F", -p.f, p.f, inequality=-(v - p.v_belt))
    x.rate = v
    v.rate = (-p.c * v - p.k * x - F) / p.m
    end = belt["time"]["end"]
    answers = [dvi.solve(spec) for spec in (belt, json.dumps(belt), json.dumps(belt).encode(), path, str(path))]
    built = p.solve(end, **belt.get("method", {}))
    for answer in answers[1:] + ([built] if "output" not in belt else []):
        assert answer["x"].tobytes() == answers[0]["x"].tobytes()


def test_a_decay_is_exact_to_its_tolerance():
    p = dvi.Problem(k=2)
    x = p.state("x", 1)
    x.rate = -p.k * x
    r = p.solve(1, rtol=1e-10)
    assert abs(r["x"][-1] - math.exp(-2)) < 1e-9
    assert r.trusted and r.verdict and r.status == "completed"


def test_columns_are_views_that_keep_the_answer_alive_and_cannot_be_written(belt):
    r = dvi.solve(belt)
    x = r["x"]
    assert x is not r["x"] and x.ctypes.data == r["x"].ctypes.data and not x.flags.owndata
    with pytest.raises(ValueError):
        x[0] = 1.0
    with pytest.raises(ValueError):
        x.flags.writeable = True
    values = x.copy()
    del r
    assert (x == values).all()


def test_ten_million_numbers_are_handed_over_without_a_copy():
    spec = {
        "problem": {"dvi": {"states": {f"x{k}": {"initial": k, "rate": "0"} for k in range(10)}}},
        "time": {"end": 1},
        "output": {"times": {"count": 1_000_000}},
    }
    r = dvi.solve(spec)
    began = r["x3"].ctypes.data
    assert len(r.t) == 1_000_000 and len(r.names) == 10
    assert r["x3"].ctypes.data == began and not r["x3"].flags.owndata
    pyarrow = pytest.importorskip("pyarrow")
    assert isinstance(table := r.to_arrow(), pyarrow.Table)
    assert table.column("x3").chunk(0).buffers()[1].address == began


def test_an_arrow_table_outlives_the_answer(belt):
    pytest.importorskip("pyarrow")
    r = dvi.solve(belt)
    values, table = r["x"].copy(), r.to_arrow()
    del r
    assert table.column_names[:2] == ["t", "x"]
    assert table.column("x").to_numpy().tobytes() == values.tobytes()
    assert table.schema.metadata[b"dvi.trusted"] == b"true"


def test_data_frames_and_data_sets_have_the_times_for_index(belt):
    r = dvi.solve(belt)
    pytest.importorskip("pandas")
    frame = r.to_pandas()
    assert frame.index.name == "t" and list(frame.columns) == r.names and frame["x"].iloc[-1] == r["x"][-1]
    pytest.importorskip("xarray")
    data = r.to_xarray()
    assert float(data["v"].isel(t=-1)) == r["v"][-1] and data.attrs["trusted"] == 1


def test_a_picture_and_five_lines_of_evidence(belt):
    r = dvi.solve({**belt, "label": "<belt & block>"})
    shown = r._repr_html_()
    assert shown.count("<tr>") == 5 and "<svg" in shown and "trusted" in shown
    assert "<belt" not in shown and len(repr(r).splitlines()) == 6
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    assert len(r.plot().axes) == len(r.names)
    assert len(r.plot("x", "v").axes) == 2


def test_all_errors_of_a_specification_come_at_once_each_with_its_place():
    spec = {"problem": {"dvi": {"states": {"x": {"inital": 1, "rate": "-y"}}}}, "time": {"end": -1}}
    with pytest.raises(dvi.SpecificationError) as raised:
        dvi.solve(spec)
    errors = {error.pointer: error for error in raised.value.errors}
    assert errors["/problem/dvi/states/x/inital"].did_you_mean == "initial"
    assert errors["/problem/dvi/states/x/rate"].code == "unknown_name"
    assert errors["/time/end"].expected
    assert "did you mean initial?" in str(raised.value)
    import pickle

    assert pickle.loads(pickle.dumps(raised.value)).errors == raised.value.errors


@pytest.mark.parametrize("spec", ["{", "[]", b"\xff", "{}", {"problem": None}, {}, '{"problem": 1e999}'])
def test_what_is_no_specification_is_refused_in_words(spec, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((dvi.SpecificationError, FileNotFoundError)):
        dvi.solve(spec)


def test_what_json_cannot_hold_is_refused_in_words(belt):
    belt["time"]["end"] = math.nan
    with pytest.raises(ValueError, match="no NaN"):
        dvi.solve(belt)
    belt["time"]["end"] = object()
    with pytest.raises(TypeError, match="no place in a specification"):
        dvi.solve(belt)
    with pytest.raises(TypeError, match="dict, JSON text"):
        dvi.solve(5)


def test_numbers_of_numpy_stand_in_specifications(belt):
    want = dvi.solve(belt)["x"][-1]
    belt["time"]["end"] = np.float64(belt["time"]["end"])
    belt["problem"]["dvi"]["states"]["x"]["initial"] = np.array(4)
    assert dvi.solve(belt)["x"][-1] == want


def test_a_failed_solve_has_the_trajectory_so_far():
    spec = {"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "x^2"}}}}, "time": {"end": 2}}
    with pytest.raises(dvi.SolveError) as raised:
        dvi.solve(spec)
    error = raised.value
    assert 0.99 < error.time <= 1.01 and error.code and error.result["x"][-1] > 100
    assert error.result.status == "failed"


def test_a_limit_of_steps_stops_with_the_trajectory_so_far(endless):
    with pytest.raises(dvi.SolveError) as raised:
        dvi.solve({**endless, "limits": {"steps": 50}})
    assert raised.value.code == "steps" and raised.value.result.status == "stopped" and len(raised.value.result.t) == 51


def test_the_wall_clock_limit_holds(endless):
    with pytest.raises(dvi.SolveError) as raised:
        dvi.solve({**endless, "limits": {"wall_seconds": 0.2}, "output": {"times": {"count": 2}}})
    assert raised.value.code == "wall_time"


def test_ctrl_c_ends_a_solve_and_keeps_what_there_is(endless):
    endless["output"] = {"times": {"count": 2_000_000}}
    sent = []

    def interrupt():
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.5, interrupt)
    timer.start()
    with pytest.raises(KeyboardInterrupt) as raised:
        dvi.solve(endless)
    # A solve that ignores Ctrl-C would run for minutes; a benchmark measures the delay
    # more closely.
    assert time.monotonic() - sent[0] < 30
    assert raised.value.result.status == "stopped" and raised.value.result.error["code"] == "cancelled"


def test_a_report_of_progress_that_raises_ends_the_solve(endless):
    seen = []

    def progress(fraction, steps):
        seen.append((fraction, steps))
        if len(seen) == 3:
            raise LookupError("enough")

    endless["output"] = {"times": {"count": 2}}
    with pytest.raises(LookupError, match="enough"):
        dvi.solve(endless, progress=progress)
    assert len(seen) == 3 and seen[0][1] <= seen[2][1]


def test_other_threads_of_python_run_while_one_solves(endless):
    endless.update({"output": {"times": {"count": 2}}, "limits": {"wall_seconds": 1.0}})
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    with pytest.raises(dvi.SolveError):
        dvi.solve(endless)
    done.set()
    thread.join()
    # If the solve held Python's global interpreter lock, the counter of the other thread would
    # reach only a handful.
    assert counted[0] > 50


def test_values_at_other_times_are_those_of_the_solution():
    p = dvi.Problem()
    x, v = p.state("x", 1), p.state("v", 0)
    x.rate, v.rate = v, -x
    r = p.solve(5, rtol=1e-9)
    times = np.array([[0.0, 1.234], [4.9, 0.1]])
    found = r(times)
    assert found["x"].shape == times.shape
    assert np.abs(found["x"] - np.cos(times)).max() < 1e-7
    assert abs(r(2.5)["v"] + math.sin(2.5)) < 1e-7
    with pytest.raises(dvi.SpecificationError, match="outside"):
        r(6.0)


class Counting:
    """A specification that counts its solves."""

    def __init__(self, specification):
        self.specification, self.solves = specification, 0

    def solve(self, *arguments, **named):
        self.solves += 1
        return self.specification.solve(*arguments, **named)


def test_asking_again_at_other_times_costs_no_solve(belt):
    # The output omits the friction force F, which jumps when the mass begins to stick:
    # its values at other times would need a new solve.
    belt["output"] = {"fields": ["x", "v"]}
    for dense, solves in ((True, 0), (False, 1)):
        r = dvi.solve(belt, dense=dense)
        r._specification = counting = Counting(r._specification)
        times = np.linspace(0, belt["time"]["end"], 1001)
        found = r(times)
        assert (r(times[::-1])["x"][::-1] == found["x"]).all() and r(1.25)["v"] == r([1.25])["v"][0]
        assert counting.solves == solves
        # The values at the requested times agree with those of a run that has them as
        # output times.
        exact = dvi.solve({**belt, "output": {"times": times.tolist(), "fields": ["x", "v"]}})
        for name in r.names:
            scale = np.abs(exact[name]).max()
            switch = np.min(np.abs(times[:, None] - [event.t for event in r.events]), axis=1) < 1e-6
            assert np.abs(found[name] - exact[name])[~switch].max() < 1e-5 * scale, name
    assert dvi.solve(belt, dense=True).deviation <= 1e-8 and dvi.solve(belt).deviation is None


def test_dense_answers_are_as_exact_as_the_run():
    p = dvi.Problem(k=2)
    x = p.state("x", 1)
    x.rate = -p.k * x
    p.define("square", x * x)
    r = p.solve(3, rtol=1e-9, dense=True, fields=["x", "square"])
    t = np.linspace(0, 3, 2000)
    assert np.abs(r(t)["x"] - np.exp(-2 * t)).max() < 1e-8
    assert np.abs(r(t)["square"] - np.exp(-4 * t)).max() < 1e-8 and r.deviation < 1e-11


def test_integrals_and_jumps_within_steps_are_solved_for():
    p = dvi.Problem()
    x = p.state("x", 1)
    x.rate = -x
    p.integral("area", x)
    r = p.solve(2, rtol=1e-9, dense=True)
    assert r.deviation is None and abs(r(1.0)["area"] - (1 - math.exp(-1))) < 1e-8
    ball = dvi.example("bouncing_ball")
    height = dvi.solve(ball)(0.1)
    assert all(math.isfinite(value) for value in height.values())


def test_events_are_named_tuples_in_order_of_time(belt):
    events = dvi.solve(belt).events
    assert events and [event.t for event in events] == sorted(event.t for event in events)
    assert {event.kind for event in events} <= {"activated", "deactivated"} and events[0].of == "F"


def test_an_orbit_is_found():
    spec = {"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "-x + sin(t)"}}}}}
    orbit = dvi.periodic(spec, "2*pi").orbit
    # The periodic orbit is x = (sin t - cos t)/2; a deviation from it decays by the
    # factor exp(-2 pi) per period.
    (multiplier,) = orbit["multipliers"]
    size = math.hypot(*multiplier) if isinstance(multiplier, list) else abs(multiplier if not isinstance(multiplier, dict) else complex(multiplier["re"], multiplier["im"]))
    assert abs(size - math.exp(-2 * math.pi)) < 1e-5


def test_checking_solves_nothing(belt):
    found = dvi.check(belt)
    assert found["states"] == 2 and found["variables"] == 1 and found["uniqueness"]


def test_examples_schema_and_catalogue_come_with_the_package():
    assert len(dvi.examples()) == len(EXAMPLES) and dvi.example("relay")["problem"]
    assert dvi.schema()["title"] and dvi.catalogue()
    with pytest.raises(KeyError, match="dvi.examples"):
        dvi.example("nothing")


def test_results_are_pickled_with_all_they_hold(belt):
    import pickle

    r = dvi.solve({**belt, "label": "kept"})
    back = pickle.loads(pickle.dumps(r))
    assert back["x"].tobytes() == r["x"].tobytes() and back.evidence == r.evidence and "kept" in back.to_svg()


def test_an_answer_says_what_it_is_the_answer_to(belt):
    import hashlib

    text = json.dumps({**belt, "label": "traced"})
    provenance = dvi.solve(text).provenance
    assert provenance["digest"] == hashlib.sha256(text.encode()).hexdigest()
    assert provenance["program"] == f"dvi {dvi.__version__}" and provenance["label"] == "traced"


def test_a_deck_is_solved_as_a_file(tmp_path):
    deck = tmp_path / "rc.cir"
    deck.write_text("An RC circuit\nV1 in 0 5\nR1 in out 1k\nC1 out 0 1u IC=0\n.tran 1u 5m uic\n.end\n")
    r = dvi.solve(deck)
    assert abs(r["v(out)"][-1] - 5 * (1 - math.exp(-5))) < 1e-5 and r.provenance["label"] == "An RC circuit"


def test_a_robot_is_solved_as_a_file_and_as_text():
    path = ROOT / "tests/systems/robots/models/double_pendulum.urdf"
    r = dvi.solve(path)
    assert r.provenance["label"] == "double_pendulum" and "elbow.coordinate" in r
    assert r["lower.z"].tobytes() == dvi.solve(path.read_text())["lower.z"].tobytes()
    # The pendulum hangs at rest and stays there.
    assert abs(r["lower.z"][-1] + 0.8) < 1e-9
    scene = {"robot": {"urdf": path.read_text(), "pose": {"shoulder": 0.3}}}
    s = dvi.sweep({"problem": {"rigid_bodies": scene}, "time": {"end": 0.1}, "method": {"step": 1e-3}}, {"shoulder.position": [0.1, 0.2]}, {"x": {"initial": "lower.x"}})
    assert np.abs(s["x"] + 0.8 * np.sin([0.1, 0.2])).max() < 1e-12
    with pytest.raises(dvi.SpecificationError, match="line 1, column 1"):
        dvi.solve("<robot/>")


def test_a_misspelt_field_is_named_with_its_neighbour(belt):
    r = dvi.solve(belt)
    with pytest.raises(KeyError, match="there is no field 'X'"):
        r["X"]
    assert "x" in r and list(r) == r.names and set(dict(r)) == set(r.names)
