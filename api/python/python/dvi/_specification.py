"""From what a user hands over to the text of a specification, and what may be wrong with it."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Optional, Union

from . import _dvi

if TYPE_CHECKING:
    from ._problem import Problem

#: What `solve` takes as a specification: a dict, JSON text, the path of a file, or a `Problem`.
Source = Union[str, bytes, "os.PathLike[str]", Mapping[str, Any], "Problem"]


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a specification."""

    #: The JSON pointer (RFC 6901) to the faulty value; "" is the whole document.
    pointer: str
    #: A stable code for programs, such as `unknown_key`.
    code: str
    #: A description of the fault.
    detail: str
    #: What would be valid.
    expected: Optional[str] = None
    #: The valid name that is nearest to an unknown name.
    did_you_mean: Optional[str] = None

    def __str__(self) -> str:
        place = self.pointer or "(the whole document)"
        detail = self.detail.replace("\n", "\n    ")
        text = f"{place}: {detail} [{self.code}]"
        if self.expected:
            text += f"\n  expected: {self.expected}"
        if self.did_you_mean:
            text += f"\n  did you mean {self.did_you_mean}?"
        return text


class SpecificationError(ValueError):
    """A specification with errors: all of them, in `errors`."""

    errors: list[Fault]

    def __init__(self, errors: list[Fault]) -> None:
        self.errors = errors
        count = "1 error" if len(errors) == 1 else f"{len(errors)} errors"
        super().__init__(f"{count} in the specification\n" + "\n".join(str(error) for error in errors))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.errors,)

    @classmethod
    def of_json(cls, listed: Any) -> SpecificationError:
        keys = ("pointer", "code", "detail", "expected", "did_you_mean")
        return cls([Fault(**{key: one.get(key) for key in keys}) for one in listed])


def text_of(source: Source) -> bytes:
    """The JSON text of a specification. A string that begins with `{` or `<` is text, any other is the path of a file; either may be JSON, a
    robot in URDF or MJCF, or, as a file or as bytes, a SPICE deck."""
    from ._problem import Problem

    if isinstance(source, Problem):
        return source.to_json().encode()
    if isinstance(source, Mapping):
        return dumps(source).encode()
    if isinstance(source, (bytes, bytearray, memoryview)):
        return _dvi.document_of(bytes(source))
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith(("{", "<")):
        return _dvi.document_of(source.encode())
    if isinstance(source, (str, os.PathLike)):
        with open(source, "rb") as file:
            return _dvi.document_of(file.read())
    kind = type(source).__name__
    raise TypeError(f"a specification is a dict, JSON text, the path of a file or a dvi.Problem, not {kind}")


def dumps(value: Any, indent: Optional[int] = None) -> str:
    """JSON of dicts and lists in which numbers of numpy, arrays and expressions may stand."""
    try:
        return json.dumps(value, default=_plain, allow_nan=False, indent=indent, ensure_ascii=False)
    except ValueError as error:
        if "JSON compliant" in str(error):
            raise ValueError("a specification has no NaN and no infinity: leave an absent bound out, or write null") from None
        raise


def _plain(value: Any) -> Any:
    from ._expression import Expression

    if isinstance(value, Expression):
        return value.text
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (tuple, set, range)):
        return list(value)
    raise TypeError(f"{value!r} ({type(value).__name__}) has no place in a specification")
