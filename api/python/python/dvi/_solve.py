"""Solves in this process."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable
from typing import Any, Optional, Union

from . import _dvi
from ._result import Result
from ._specification import Source, SpecificationError, text_of

#: A function that is called with the completed fraction and the number of steps; True shows a progress bar of tqdm.
Progress = Union[bool, Callable[[float, int], Any], None]


def read(source: Source) -> _dvi.Specification:
    """The specification, read and checked."""
    try:
        return _dvi.Specification(text_of(source))
    except _dvi.Malformed as error:
        raise SpecificationError.of_json(json.loads(error.args[0])) from None


def solve(spec: Source, *, dense: bool = False, progress: Progress = None) -> Result:
    """Solves a specification in this process.

    `spec` is a dict, JSON text, the path of a file, or a `Problem`. Python's lock is free meanwhile, so that threads solve side by
    side; Ctrl-C stops the solve, and the `KeyboardInterrupt` has the trajectory so far as `result`. `progress=True` shows a bar
    where tqdm is installed; a function is called with the fraction done and the steps made. With `dense=True` the answer keeps its
    fields as functions of time, so that `result(t)` costs no solve; its steps are then those of a run with output times within them.

    Raises `SpecificationError` with all that is wrong with the specification, and `SolveError` with the trajectory so far where
    the end was not reached. An answer that is not trusted warns (`UntrustedWarning`), and says why in `verdict`.
    """
    return run(read(spec), progress, dense=dense)


def run(
    specification: _dvi.Specification, progress: Progress, threads: Optional[int] = None, dense: bool = False
) -> Result:
    """Solves it; `threads` share the members of a sweep."""
    if threads is not None and threads < 1:
        raise ValueError("there is at least one thread")
    shown = _Bar(specification.label) if progress is True else None
    try:
        answer = specification.solve(shown or (progress if callable(progress) else None), threads=threads, dense=dense)
    except KeyboardInterrupt as interrupt:
        if isinstance(so_far := getattr(interrupt, "answer", None), _dvi.Answer):
            interrupt.result = Result.by_kind(so_far, specification)  # type: ignore[attr-defined]
        raise
    finally:
        if shown:
            shown.close()
    return Result.by_kind(answer, specification).completed()


class _Bar:
    """A bar of tqdm, if that is installed."""

    def __init__(self, label: Optional[str]) -> None:
        try:
            from tqdm.auto import tqdm
        except ImportError:
            warnings.warn("progress=True shows nothing: tqdm is not installed", stacklevel=4)
            self._bar = None
            return
        self._bar = tqdm(total=100.0, desc=label, unit="%", file=sys.stderr, bar_format="{l_bar}{bar}| {elapsed}")

    def __call__(self, fraction: float, steps: int) -> None:
        if self._bar is not None:
            self._bar.n = round(100.0 * fraction, 1)
            self._bar.set_postfix_str(f"{steps} steps")

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def check(spec: Source) -> dict[str, Any]:
    """What a specification comes to, without a solve: sizes, index, uniqueness, and what a solve would build.

    Raises `SpecificationError` with all that is wrong with it.
    """
    found: dict[str, Any] = json.loads(read(spec).summary())
    return found


def schema() -> dict[str, Any]:
    """The JSON Schema of specifications."""
    read_: dict[str, Any] = json.loads(_dvi.schema())
    return read_


def catalogue() -> dict[str, Any]:
    """What there is to choose from: methods, solvers and limits."""
    read_: dict[str, Any] = json.loads(_dvi.catalogue())
    return read_


def examples() -> list[str]:
    """The names of the specifications that come with the package."""
    return [name for name, _ in _dvi.examples()]


def example(name: str) -> dict[str, Any]:
    """A specification that comes with the package."""
    found = dict(_dvi.examples())
    if name not in found:
        raise KeyError(f"there is no example {name!r}; dvi.examples() lists them")
    read_: dict[str, Any] = json.loads(found[name])
    return read_
