"""The answer to a sweep: a table with one row a member."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np
import numpy.typing as npt

from ._result import MOST_PANELS, Floats, Result

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

#: The value that marks a missing entry in a column of counts.
MISSING = 0xFFFFFFFF


class Sweep(Result, kind="sweep"):
    """The table of a sweep.

    `s["m"]` is a column as an array of numpy: numbers and truths are views of the table, NaN where a number is missing; words, such
    as those of `mode_word` and `error`, are an array of objects, None where there is none. `s.names` lists the columns: `member`, what
    was swept, what was collected, and how each member ended. Where `keep` of the sweep is `trajectories`, `s["trajectory.x"]` is an
    array with a row a member and a column for each of `s.times`.
    """

    def __getitem__(self, name: Any) -> Any:
        name = getattr(name, "text", name)
        column = self._answer.column(name) if isinstance(name, str) else None
        if column is None:
            raise self._unknown(name)
        if isinstance(column, list):
            return np.array(column, dtype=object)
        if column.dtype == np.uint32 and (column == MISSING).any():
            return np.where(column == MISSING, np.nan, column)
        return column

    def __call__(self, t: Union[float, npt.ArrayLike]) -> dict[str, Any]:
        if self.times.size:
            raise TypeError("the trajectories of a sweep are columns such as s['trajectory.x'], a row a member, at s.times")
        raise TypeError("a sweep keeps no trajectories: solve the member that you want, or collect {'at': {'t': .., 'of': ..}}")

    def _columns(self) -> list[tuple[str, Any]]:
        return [(name, self[name]) for name in self.names]

    def _head(self, name: str) -> Any:
        return self._evidence["table"][name]

    @property
    def rows(self) -> int:
        """The number of rows: fewer than `members` where the sweep was stopped."""
        return len(self._answer.column("member"))

    @property
    def members(self) -> int:
        """The number of members that were asked for."""
        members: int = self._head("members")
        return members

    @property
    def failed(self) -> int:
        """The number of members that failed; each has its `error`."""
        failed: int = self._head("failed")
        return failed

    @property
    def swept(self) -> list[str]:
        """The names that were swept."""
        names: list[str] = self._head("swept")
        return names

    @property
    def collected(self) -> list[str]:
        """The names that were collected."""
        names: list[str] = self._head("collected")
        return names

    @cached_property
    def times(self) -> Floats:
        """The times of the trajectories that were kept; empty where none were."""
        return np.array(self._evidence["table"].get("times", []), dtype=float)

    @property
    def summary(self) -> dict[str, dict[str, Any]]:
        """Of each number that was collected its count, mean, standard deviation, extremes and quantiles."""
        return self._part("summary") or {}

    @property
    def provenance(self) -> dict[str, Any]:
        """The program and its version, the instructions of the machine, and the SHA-256 of the specification."""
        return {key: self._head(key) for key in ("program", "features", "digest")}

    @cached_property
    def axes(self) -> Optional[dict[str, Floats]]:
        """The points of each name where all combinations of them are the members, as of a grid; else None."""
        axes = {name: self[name][np.sort(np.unique(self[name], return_index=True)[1])] for name in self.swept}
        if not axes or np.prod([len(points) for points in axes.values()]) != self.rows:
            return None
        grid = np.meshgrid(*axes.values(), indexing="ij")
        same = all(np.array_equal(points.ravel(), self[name]) for points, name in zip(grid, axes))
        return axes if same else None

    def grid(self, name: str) -> Any:
        """A column as an array with an axis for each name that was swept, in the order of `axes`; behind them one for `times`, where
        it is a column of trajectories."""
        if self.axes is None:
            raise ValueError("the members are no grid: take the column itself")
        column = self[name]
        return column.reshape([len(points) for points in self.axes.values()] + list(column.shape[1:]))

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a data frame over `member`; of a column of trajectories each cell is an array."""
        import pandas

        columns = {name: column if column.ndim == 1 else list(column) for name, column in self._columns() if name != "member"}
        return pandas.DataFrame(columns, index=pandas.Index(self["member"], name="member"))

    def to_xarray(self) -> xarray.Dataset:
        """The table as a data set: over the names that were swept where the members are a grid of them, else over `member`; trajectories
        over their times `t` as well."""
        import xarray

        attributes = {"status": self.status, "trusted": int(self.trusted), "failed": self.failed}
        times: dict[str, Any] = {"t": self.times} if self.times.size else {}
        if self.axes is None:
            left_out = ("member", *self.swept)
            columns = {name: (["member", *times][: column.ndim], column) for name, column in self._columns() if name not in left_out}
            coordinates: dict[str, Any] = {name: ("member", self[name]) for name in self.swept}
            return xarray.Dataset(columns, coords={"member": self["member"], **coordinates, **times}, attrs=attributes)
        grids = {name: self.grid(name) for name in self.names if name not in self.swept}
        placed = {name: ([*self.swept, *times][: grid.ndim], grid) for name, grid in grids.items()}
        return xarray.Dataset(placed, coords={**self.axes, **times}, attrs=attributes)

    def plot(self, *names: str, axes: Any = None, events: bool = True) -> Figure:
        """Draws what was collected, a panel each: lines over one name, maps over two, else points over the first. Trajectories are drawn
        over time, a line a member."""
        import matplotlib.pyplot as plt

        chosen = [getattr(name, "text", name) for name in names] or self.collected[:MOST_PANELS]
        if axes is None:
            size = (8, 1.0 + 2.4 * len(chosen))
            figure, axes = plt.subplots(len(chosen), 1, squeeze=False, figsize=size, layout="constrained")
            axes = list(axes[:, 0])
        else:
            axes = list(np.atleast_1d(axes).ravel())
            figure = axes[0].figure
        points = self.axes
        for k, name in enumerate(chosen):
            panel = axes[min(k, len(axes) - 1)]
            if self[name].ndim == 2:
                panel.plot(self.times, self[name].T, color=f"C{k % 10}", linewidth=0.8)
                panel.set(xlabel="t", ylabel=name)
                continue
            values, words = _numbered(self[name])
            over = self.swept[0]
            if points is not None and len(points) == 2:
                first, second = points.values()
                shape = (len(first), len(second))
                drawn = panel.pcolormesh(second, first, np.ma.masked_invalid(values.reshape(shape)), shading="nearest")
                bar = figure.colorbar(drawn, ax=panel, label=name)
                if words:
                    bar.set_ticks(list(range(len(words))), labels=words)
                panel.set(xlabel=self.swept[1], ylabel=over)
                continue
            order = np.argsort(self[over], kind="stable")
            style = "-" if points is not None and len(points) == 1 else "."
            panel.plot(self[over][order], values[order], style, color=f"C{k % 10}", label=name)
            if words:
                panel.set_yticks(range(len(words)), words)
            panel.set(xlabel=over, ylabel=name)
        return figure

    def _lines(self) -> list[tuple[str, str]]:
        """Five lines of evidence."""
        _, _, method, _, measured = super()._lines()
        done = f"{self.status}, {self.rows} of {self.members} members, {self.failed} failed"
        over = f"{', '.join(self.swept)}: collected {', '.join(self.collected)}"
        return [super()._lines()[0], ("run", done), ("swept", over), method, measured]


def _numbered(column: Any) -> tuple[Floats, list[str]]:
    """A column as numbers; of words their places among them, and the words."""
    if column.dtype != object:
        return np.asarray(column, dtype=float), []
    words = sorted({word for word in column if word is not None})
    places = {word: float(k) for k, word in enumerate(words)}
    return np.array([places.get(word, np.nan) for word in column]), words
