"""Answers to what is looked for: fits, orbits, states of rest, and derivatives."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Optional

import numpy as np
import numpy.typing as npt

from ._result import Floats, Result

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


class Estimate(NamedTuple):
    """A parameter as the data have it."""

    #: The most likely value of the parameter.
    estimate: float
    #: The standard error of the parameter; None if the data do not determine it, or if a bound is active.
    sd: Optional[float] = None
    #: The ends of the 95 % confidence interval of the parameter, within its bounds.
    lower: Optional[float] = None
    upper: Optional[float] = None

    def __float__(self) -> float:
        return self.estimate

    def __str__(self) -> str:
        return f"{self.estimate:.6g}" if self.sd is None else f"{self.estimate:.6g} +- {self.sd:.2g}"


class Fit(Result, kind="fit"):
    """Parameters that were fitted to data. The trajectory is the fitted one."""

    #: The data given to `dvi.fit`; None if the data are not known.
    data: Optional[dict[str, Any]] = None

    @property
    def _fit(self) -> dict[str, Any]:
        found: dict[str, Any] = self._evidence["fit"]
        return found

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """The estimates by name, in the order of `covariance`."""
        return {name: Estimate(**self._fit["parameters"][name]) for name in self._fit["names"]}

    @property
    def parameters(self) -> dict[str, float]:
        """The most likely values by name."""
        return {name: found.estimate for name, found in self.estimates.items()}

    @cached_property
    def covariance(self) -> Floats:
        """The covariance of the estimates; NaN where the data do not determine one."""
        return _floats(self._fit["covariance"])

    @property
    def correlation(self) -> Floats:
        """The correlation of the estimates."""
        sd = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(sd, sd))

    @cached_property
    def residuals(self) -> dict[str, Floats]:
        """The data less the fitted values at the times of the data; NaN where nothing was measured."""
        return {name: _floats(values) for name, values in self._fit["residuals"].items()}

    @property
    def loss(self) -> float:
        """The sum of the loss over all residuals, in standard deviations where `sd` was given."""
        return float(self._fit["loss"])

    @property
    def spread(self) -> float:
        """The root of the mean of squared residuals over the degrees of freedom: about 1 where `sd` is given and right, else the
        standard deviation of the data."""
        return float(self._fit["spread"])

    @property
    def observations(self) -> int:
        """The number of values that were fitted."""
        return int(self._fit["observations"])

    @property
    def singular_values(self) -> Floats:
        """Of the Jacobian by relative changes of the parameters: the inverse of one is the standard error of a combination."""
        return _floats(self._fit["singular_values"])

    @property
    def undetermined(self) -> list[dict[str, float]]:
        """The combinations of relative changes that the data do not determine."""
        found: list[dict[str, float]] = self._fit["undetermined"]
        return found

    @property
    def starts(self) -> list[dict[str, Any]]:
        """From where the search began and where it came to, in order."""
        found: list[dict[str, Any]] = self._fit["starts"]
        return found

    def frame(self) -> pandas.DataFrame:
        """The estimates as a data frame over their names."""
        import pandas

        return pandas.DataFrame.from_dict(self.estimates, orient="index", columns=Estimate._fields)

    def plot(self, *names: str, axes: Any = None, events: bool = True) -> Figure:
        """Draws fields over time, one panel each; of those that were measured the data as well."""
        figure = super().plot(*names, axes=axes, events=events)
        for panel in figure.axes:
            name = panel.get_ylabel()
            if self.data is not None and name in self.data:
                panel.plot(self.data["t"], _floats(self.data[name]), ".", color="0.3", label="data")
        return figure

    def _lines(self) -> list[tuple[str, str]]:
        found = "; ".join(f"{name} = {estimate}" for name, estimate in self.estimates.items())
        return [*super()._lines(), ("fitted", found)]


class Orbit(Result, kind="orbit"):
    """A periodic orbit; the trajectory is once along it."""

    @property
    def _found(self) -> dict[str, Any]:
        found: dict[str, Any] = self._evidence["orbit"]
        return found

    @property
    def period(self) -> float:
        """Its period."""
        return float(self._found["period"])

    @property
    def start(self) -> dict[str, float]:
        """The states where it begins, by name."""
        start: dict[str, float] = self._found["start"]
        return start

    @property
    def multipliers(self) -> npt.NDArray[np.complex128]:
        """The Floquet multipliers, by falling modulus."""
        return _complex(self._found["multipliers"])

    @property
    def stable(self) -> Optional[bool]:
        """Whether what is near comes nearer; None where that is not known."""
        return self._found.get("stable")

    @property
    def over_period(self) -> dict[str, dict[str, Optional[float]]]:
        """Mean, root mean square, least and largest value of each field over the period; None where an impulse leaves one undefined."""
        found: dict[str, dict[str, Optional[float]]] = self._found["over_period"]
        return found

    def _lines(self) -> list[tuple[str, str]]:
        largest = f", largest multiplier {abs(self.multipliers[0]):.4g}" if len(self.multipliers) else ""
        return [*super()._lines(), ("orbit", f"period {self.period:.10g}, {_stability(self.stable)}{largest}")]


class SteadyState(Result, kind="steady_state"):
    """A state of rest; the trajectory is a short run from it."""

    @property
    def _found(self) -> dict[str, Any]:
        found: dict[str, Any] = self._evidence["steady_state"]
        return found

    @property
    def states(self) -> dict[str, float]:
        """The states, by name."""
        found: dict[str, float] = self._found["states"]
        return found

    @property
    def variables(self) -> dict[str, float]:
        """The variables, by name."""
        found: dict[str, float] = self._found["variables"]
        return found

    @property
    def eigenvalues(self) -> npt.NDArray[np.complex128]:
        """The eigenvalues of the equations there, by falling real part."""
        return _complex(self._found["eigenvalues"])

    @property
    def stable(self) -> Optional[bool]:
        """Whether what is near comes nearer; None where that is not known."""
        return self._found.get("stable")

    def _lines(self) -> list[tuple[str, str]]:
        states = ", ".join(f"{name} = {value:.6g}" for name, value in list(self.states.items())[:6])
        return [*super()._lines(), ("rest", f"{_stability(self.stable)}: {states}")]


class Sensitivities(Result, kind="sensitivities"):
    """A run with the derivatives of its states: `r["dx/dm"]`, or `r.derivative("x", "m")`."""

    @cached_property
    def _pairs(self) -> list[tuple[str, str]]:
        pairs = (name.removeprefix("d").split("/d", 1) for name in self.names if name.startswith("d") and "/d" in name)
        return [(of, by) for of, by in pairs]

    @property
    def of(self) -> list[str]:
        """The states that are differentiated, of those that are reported."""
        return list(dict.fromkeys(of for of, _ in self._pairs))

    @property
    def to(self) -> list[str]:
        """What they are differentiated by."""
        return list(dict.fromkeys(by for _, by in self._pairs))

    def derivative(self, of: Any, by: Any) -> Floats:
        """The derivative of a state by a parameter or an initial value such as `x.initial`, over time."""
        return self[f"d{getattr(of, 'text', of)}/d{getattr(by, 'text', by)}"]

    @property
    def jacobian(self) -> Floats:
        """All derivatives: times, states `of`, parameters `to`."""
        columns = [[self[f"d{of}/d{by}"] for by in self.to] for of in self.of]
        return np.moveaxis(np.array(columns).reshape(len(self.of), len(self.to), len(self.t)), -1, 0)


def _floats(values: Any) -> Floats:
    """Numbers; NaN where there is none."""
    return np.array(values, dtype=float)


def _complex(pairs: Any) -> npt.NDArray[np.complex128]:
    return np.array([complex(re, im) for re, im in pairs], dtype=complex)


def _stability(stable: Optional[bool]) -> str:
    return {True: "stable", False: "unstable"}.get(stable, "stability not known")  # type: ignore[arg-type]
