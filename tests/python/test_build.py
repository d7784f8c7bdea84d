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


def test_the_profiles_are_those_of_the_house():
    house, binding = read("Cargo.toml")["profile"], read("api/python/Cargo.toml")["profile"]
    locked = {package["name"] for package in read("api/python/Cargo.lock")["package"]}
    of_house, of_binding = house["release"].pop("package"), binding["release"].pop("package")
    assert binding == house
    for name, settings in of_binding.items():
        assert of_house[name] == settings, name
    # Packages of the service alone are in the lock of neither.
    assert {name for name in of_house if name in locked} - {"dvi-service", "clap_builder"} == set(of_binding)


def test_the_versions_are_those_of_the_house():
    house = {(package["name"], package["version"]) for package in read("Cargo.lock")["package"]}
    names = {name for name, _ in house}
    binding = [(package["name"], package["version"]) for package in read("api/python/Cargo.lock")["package"]]
    numerics = ("faer", "nalgebra", "gemm", "clarabel", "parry", "realfft", "rustfft", "serde")
    strange = [one for one in binding if one[0].startswith(numerics) and one[0] in names and one not in house]
    assert strange == []


def test_the_version_is_that_of_the_house():
    assert dvi.__version__ == read("Cargo.toml")["workspace"]["package"]["version"]


def test_types_hold(tmp_path):
    if importlib.util.find_spec("mypy") is None:
        pytest.skip("mypy is not installed")
    # Not beside the installed packages, where mypy takes its own for ours.
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "-p", "dvi"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout


def test_doctests_pass():
    import doctest

    failed, tried = doctest.testmod(dvi)
    for module in ("dvi._problem", "dvi._families"):
        also = doctest.testmod(sys.modules[module])
        failed, tried = failed + also.failed, tried + also.attempted
    assert failed == 0 and tried > 10
