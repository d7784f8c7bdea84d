"""The crate of the binding is built as the house is, and its types are what they say."""

import importlib.util
import pathlib
import subprocess
import sys

import pytest
from conftest import ROOT

import dvi

tomllib = pytest.importorskip("tomllib")


def read(path):
    return tomllib.loads((ROOT / path).read_text())


def test_the_version_is_that_of_the_house():
    assert dvi.__version__ == read("Cargo.toml")["workspace"]["package"]["version"]


def test_types_hold(tmp_path):
    if importlib.util.find_spec("mypy") is None:
        pytest.skip("mypy is not installed")
    # Runs in an empty folder: in the folder of the installed packages, mypy would take
    # its own modules for ours.
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "-p", "dvi"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout


def test_doctests_pass():
    import doctest

    failed, tried = doctest.testmod(dvi)
    for module in ("dvi._problem", "dvi._families"):
        also = doctest.testmod(sys.modules[module])
        failed, tried = failed + also.failed, tried + also.attempted
    assert failed == 0 and tried > 10
