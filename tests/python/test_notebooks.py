"""Each notebook runs from its first cell to its last."""

import pytest
from conftest import ROOT

NOTEBOOKS = sorted((ROOT / "api/python/notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs(path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    shown = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("text/html" in output.get("data", {}) for output in shown), "no result is shown"
    assert any("image/png" in output.get("data", {}) for output in shown), "nothing is drawn"


def test_there_are_three():
    assert [path.stem for path in NOTEBOOKS] == ["converter", "friction", "traffic"]
