"""An answer: columns, events, evidence."""

from __future__ import annotations

import html
import json
import math
import os
import warnings
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _dvi

if TYPE_CHECKING:
    import pandas
    import pyarrow
    import xarray
    from matplotlib.figure import Figure

Floats = npt.NDArray[np.float64]

#: Numbers of panels and of event marks above which a plot becomes unreadable.
MOST_PANELS = 8
MOST_MARKS = 200


class UntrustedWarning(UserWarning):
    """The end was reached, and a check exceeds what the tolerances allow: the answer is not trusted."""


class SolveError(RuntimeError):
    """A solve that did not reach its end. `result` has the trajectory so far, `code` a stable word for why, `time` the time
    reached."""

    def __init__(self, result: Result) -> None:
        error = result.error or {}
        self.result = result
        self.code: str = error.get("code", result.status)
        self.time: float = error.get("time", math.nan)
        reached = f" at t = {self.time}" if len(result.t) else ""
        super().__init__(f"{self.code}{reached}: {error.get('message', '')}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.result,)


class Event(NamedTuple):
    """A switch of the active face, an impact, or what else happened."""

    t: float
    #: The kind of the event: `activated`, `deactivated`, `jumped`, `impact`, `lift_off`, `stick`, `slip` or
    #: `crossed`.
    kind: str
    #: The name of the variable or of the contact of the event, or the label of the `stop` condition that was met.
    of: str


class Verdict:
    """Whether an answer may be relied upon. It is true as its `trusted` is."""

    def __init__(self, verdict: dict[str, Any]) -> None:
        #: Whether no measurement speaks against the result.
        self.trusted: bool = verdict.get("trusted", False)
        #: The measurements that speak against the result, each with its permitted value.
        self.because: list[dict[str, Any]] = verdict.get("because", [])
        #: Remarks that users should know, though they do not speak against the result.
        self.caveats: list[dict[str, Any]] = verdict.get("caveats", [])

    def __bool__(self) -> bool:
        return self.trusted

    def __repr__(self) -> str:
        codes = [entry.get("code", "") for entry in (self.because or self.caveats)]
        told = (" because " if self.because else " with caveats ") + ", ".join(codes) if codes else ""
        return f"<{'trusted' if self.trusted else 'not trusted'}{told}>"


class Result:
    """The answer to a specification.

    `r.t` are the times and `r["x"]` the values of a field, as arrays of numpy that are views of the answer: they cannot be written
    to, and keep it alive. `r(t)` has the values at other times. Answers to a sweep, a fit and the like are `Sweep`, `Fit`, `Orbit`,
    `SteadyState` and `Sensitivities`, which are results with more to them.
    """

    _kinds: ClassVar[dict[str, type[Result]]] = {}

    def __init_subclass__(cls, kind: str, **further: Any) -> None:
        super().__init_subclass__(**further)
        Result._kinds[kind] = cls

    def __init__(self, answer: _dvi.Answer, specification: Optional[_dvi.Specification] = None) -> None:
        self._answer = answer
        self._specification = specification

    @staticmethod
    def by_kind(answer: _dvi.Answer, specification: Optional[_dvi.Specification] = None) -> Result:
        """The answer as what it is the answer of: a `Sweep`, a `Fit`, .."""
        return Result._kinds.get(answer.kind, Result)(answer, specification)

    @staticmethod
    def from_json(text: Union[str, bytes], label: Optional[str] = None) -> Result:
        """Reads an answer that the program or a service wrote."""
        return Result.by_kind(_dvi.Answer.from_json(text.encode() if isinstance(text, str) else text, label))

    def __reduce__(self) -> tuple[Any, ...]:
        # A pickled result omits its specification: the unpickled copy cannot compute values at other times.
        return Result.from_json, (self.to_json(), self.provenance.get("label"))

    def completed(self) -> Result:
        """This answer, if the end was reached; else raises `SolveError`. Warns where it is not trusted."""
        if self.status != "completed":
            raise SolveError(self)
        if not self.verdict:
            because = "\n".join(reason.get("message", "") for reason in self.verdict.because)
            warnings.warn(f"the answer is not trusted:\n{because}", UntrustedWarning, stacklevel=4)
        return self

    # --- the trajectory

    @property
    def t(self) -> Floats:
        """The times, increasing."""
        return self._answer.t

    def __getitem__(self, name: str) -> Floats:
        if not isinstance(name, str):
            name = getattr(name, "text", name)
        column: Optional[Floats] = self._answer.column(name)
        if column is None:
            raise self._unknown(name)
        return column

    def _unknown(self, name: object) -> KeyError:
        from difflib import get_close_matches

        near = get_close_matches(str(name), self.names, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return KeyError(f"there is no field {name!r} among {', '.join(self.names[:20])}{hint}")

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def names(self) -> list[str]:
        """The names of the fields, in order."""
        return self._answer.names

    def keys(self) -> list[str]:
        """The names of the fields, in order: `dict(r)` has all columns."""
        return self.names

    def __call__(self, t: Union[float, npt.ArrayLike]) -> dict[str, Any]:
        """The values of all fields at a time or at an array of times, by name.

        An answer of `solve(.., dense=True)` keeps its fields as functions of time: polynomials through their values in each step, which
        differ from them by a hundredth of `rtol` at most (`deviation`). Any other answer is solved once more when it is first asked,
        and kept so then: further calls cost no solve. Where a field jumps at a switch, as variables may, or is an integral, each call is a
        solve with these output times: `output.fields` without it costs none.
        """
        if self._specification is None:
            raise RuntimeError("an answer that was made elsewhere cannot be evaluated at other times; ask for output times")
        if self._answer.kind in ("orbit", "steady_state", "fit"):
            raise RuntimeError("what is looked for is reported at the times that the specification asks for: see `output.times`")
        times = np.asarray(t, dtype=float)
        if not np.isfinite(times).all():
            raise ValueError("times are finite numbers")
        asked, place = np.unique(times, return_inverse=True)
        if asked.size == 0:
            return {name: np.empty(times.shape) for name in self.names}
        found = self._functions.at(asked.tolist()) or self._solved_at(asked)
        columns = {name: column[place].reshape(times.shape) for name, column in zip(self.names, found)}
        return columns if times.ndim else {name: float(column) for name, column in columns.items()}

    @cached_property
    def _functions(self) -> _dvi.Answer:
        """The answer that keeps its fields as functions of time, where any does."""
        if self._answer.deviation is not None or self._specification is None:
            return self._answer
        return self._specification.solve(dense=True)

    def _solved_at(self, times: Floats) -> list[Floats]:
        """The fields at times, by a solve that reports them."""
        if self._specification is None:
            return []
        try:
            answer = self._specification.solve(None, times.tolist())
        except _dvi.Malformed as error:
            from ._specification import SpecificationError

            raise SpecificationError.of_json(json.loads(error.args[0])) from None
        found = Result(answer, self._specification)
        if len(found.t) < times.size:
            raise SolveError(found) if found.error else ValueError(f"the solve ended at t = {self.t[-1]}")
        rows = np.searchsorted(found.t, times)
        return [found[name][rows] for name in self.names]

    @property
    def deviation(self) -> Optional[float]:
        """By how much `r(t)` differs from the run at most, in parts of the largest values of the fields, where the answer keeps them as
        functions of time."""
        return self._answer.deviation

    # --- the evidence

    @cached_property
    def _evidence(self) -> dict[str, Any]:
        read: dict[str, Any] = json.loads(self._answer.evidence())
        return read

    @property
    def status(self) -> str:
        """`completed`, `stopped` or `failed`."""
        status: str = self._evidence["status"]
        return status

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the answer may be relied upon, and what speaks against it."""
        return Verdict(self._evidence.get("verdict", {}))

    @property
    def trusted(self) -> bool:
        """Whether the answer may be relied upon."""
        return self.verdict.trusted

    @cached_property
    def events(self) -> list[Event]:
        """Switches, impacts and what else happened, in order of time."""
        return [Event(event["t"], event["kind"], event["of"]) for event in self._evidence["trajectory"]["events"]]

    @property
    def diagnostics(self) -> dict[str, Any]:
        """What was done and measured."""
        return self._part("diagnostics") or {}

    def _part(self, name: str) -> Optional[dict[str, Any]]:
        return self._evidence.get(name)

    @property
    def provenance(self) -> dict[str, Any]:
        """What it is the answer to: the program and its version, the label, the type of the problem, the SHA-256 of the
        specification, the tolerances."""
        return self._part("provenance") or {}

    @property
    def error(self) -> Optional[dict[str, Any]]:
        """Why the end was not reached."""
        return self._part("error")

    @property
    def ended_by(self) -> Optional[dict[str, Any]]:
        """The monitor of `stop` that ended it."""
        return self._part("ended_by")

    @property
    def sensitivities(self) -> Optional[dict[str, Any]]:
        """How derivatives compare with a difference of runs; they are columns themselves."""
        return self._part("sensitivities")

    @property
    def orbit(self) -> Optional[dict[str, Any]]:
        """The orbit that was looked for."""
        return self._part("orbit")

    @property
    def steady_state(self) -> Optional[dict[str, Any]]:
        """The state of rest that was looked for."""
        return self._part("steady_state")

    @property
    def fit(self) -> Optional[dict[str, Any]]:
        """The parameters that were fitted."""
        return self._part("fit")

    @property
    def gradient(self) -> dict[str, float]:
        """The derivatives of the objective of adjoint mode, by the names of what it is differentiated by."""
        gradient: dict[str, float] = self._evidence.get("gradient") or {}
        return gradient

    @property
    def objective(self) -> Optional[float]:
        """The value of the objective of adjoint mode."""
        value: Optional[float] = self._evidence.get("objective")
        return value

    @property
    def event_slopes(self) -> list[dict[str, Any]]:
        """The derivatives of the times of events, of a motion with impacts."""
        slopes: list[dict[str, Any]] = self._evidence.get("event_slopes") or []
        return slopes

    @property
    def branch(self) -> Optional[dict[str, Any]]:
        """The branch of orbits or states of rest that was followed."""
        return self._part("branch")

    @property
    def study(self) -> Optional[dict[str, Any]]:
        """Error against run time."""
        return self._part("study")

    @property
    def evidence(self) -> dict[str, Any]:
        """All of the answer but its columns, as in JSON."""
        return self._evidence

    # --- conversion of the result to other formats

    def to_json(self) -> bytes:
        """The answer as the program writes it, to the byte, but for the wall-clock time."""
        return self._answer.written("json")

    def to_csv(self) -> bytes:
        """The trajectory as CSV, as the program writes it."""
        return self._answer.written("csv")

    def to_svg(self) -> str:
        """The trajectory as a picture, as the program draws it."""
        return self._answer.written("svg").decode()

    def save(self, path: Union[str, os.PathLike[str]]) -> None:
        """Writes the answer to a file, in the form that its extension asks for: `.json`, `.csv`, `.ndjson`, `.arrow` or `.svg`, as
        `dvi solve -o` does."""
        file = Path(path)
        file.write_bytes(self._answer.written(file.suffix.removeprefix(".").lower()))

    def __arrow_c_stream__(self, requested_schema: Optional[object] = None) -> object:
        return self._answer.__arrow_c_stream__(requested_schema)

    def to_arrow(self) -> pyarrow.Table:
        """The trajectory as a table of pyarrow, its columns in place. Other libraries of data frames take the result itself
        (`polars.DataFrame(r)`, `duckdb.sql`), by the PyCapsule interface of Arrow."""
        import pyarrow

        return pyarrow.table(self)

    def to_pandas(self) -> pandas.DataFrame:
        """The trajectory as a data frame over `t`."""
        import pandas

        return pandas.DataFrame({name: self[name] for name in self.names}, index=pandas.Index(self.t, name="t"))

    def to_xarray(self) -> xarray.Dataset:
        """The trajectory as a data set over `t`; its attributes have the status and whether it is trusted."""
        import xarray

        attributes = {"status": self.status, "trusted": int(self.trusted)}
        return xarray.Dataset({name: ("t", self[name]) for name in self.names}, coords={"t": self.t}, attrs=attributes)

    def plot(self, *names: str, axes: Any = None, events: bool = True) -> Figure:
        """Draws fields over time, one panel each, with matplotlib; without names the first eight. Events are dashed lines."""
        import matplotlib.pyplot as plt

        chosen = [getattr(name, "text", name) for name in names] or self.names[:MOST_PANELS]
        if axes is None:
            height = 1.0 + 1.6 * len(chosen)
            figure, axes = plt.subplots(len(chosen), 1, sharex=True, squeeze=False, figsize=(8, height), layout="constrained")
            axes = list(axes[:, 0])
        else:
            axes = list(np.atleast_1d(axes).ravel())
            figure = axes[0].figure
        marks = sorted({event.t for event in self.events}) if events else []
        if len(marks) > MOST_MARKS:
            marks = []
        for k, name in enumerate(chosen):
            panel = axes[min(k, len(axes) - 1)]
            panel.plot(self.t, self[name], color=f"C{k % 10}", label=name)
            panel.set_ylabel(name)
            if k < len(axes):
                for mark in marks:
                    panel.axvline(mark, color="0.6", linewidth=0.6, linestyle="--", zorder=0)
        axes[-1].set_xlabel("t")
        return figure

    def _lines(self) -> list[tuple[str, str]]:
        """Five lines of evidence."""
        diagnostics = self.diagnostics
        steps = diagnostics.get("steps", {})
        verdict = "trusted" if self.trusted else "not trusted"
        told = self.verdict.because or self.verdict.caveats
        why = "; ".join(entry.get("message", "") for entry in told[:3])
        checks = diagnostics.get("checks", {})
        worst = sorted(
            (
                (abs(value["value"]) / value["allowed"], name)
                for name, value in checks.items()
                if isinstance(value, dict) and value.get("allowed") and value.get("value") is not None
            ),
            reverse=True,
        )
        if worst:
            measured = f"{len(checks)} checks, the nearest to its limit {worst[0][1]} at {100 * worst[0][0]:.2g} % of it"
        else:
            measured = "no checks"
        end = f"t = {self.t[-1]:g}" if len(self.t) else "no time"
        reached = f"{self.status} at {end}, {len(self.t)} times of {len(self)} fields, {len(self.events)} events"
        method = (
            f"{diagnostics.get('method', 'unknown method')}, {steps.get('accepted', 0)} steps, "
            f"{steps.get('rejected', 0)} rejected, {diagnostics.get('wall_seconds', math.nan):.3g} s"
        )
        unique = str(diagnostics.get("uniqueness", "not known"))
        if diagnostics.get("because"):
            unique += f": {diagnostics['because']}"
        return [
            ("verdict", verdict + (f": {why}" if why else "")),
            ("run", reached),
            ("method", method),
            ("uniqueness", unique),
            ("measured", measured),
        ]

    def __repr__(self) -> str:
        return f"<dvi.{type(self).__name__}\n" + "\n".join(f"  {key:<11} {value}" for key, value in self._lines()) + ">"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{key}</th><td style='text-align:left'>{html.escape(value)}</td></tr>"
            for key, value in self._lines()
        )
        return f"<div>{self.to_svg()}<table>{rows}</table></div>"
