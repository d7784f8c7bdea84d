"""What the READMEs show runs as it stands."""

import re

import pytest
from conftest import ROOT


@pytest.mark.parametrize("path", ["README.md", "api/python/README.md"])
def test_the_python_of_a_readme_runs(path):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / path).read_text(), re.DOTALL)
    assert blocks
    # The Python blocks of the README run one after the other, as a reader would type them.
    names = {}
    for block in blocks:
        exec(compile(block, path, "exec"), names)
