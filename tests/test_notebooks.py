"""Every notebook runs from top to bottom and says what it should."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
SAYS = {
    "tour": [
        "49 good, 17 fair, 6 poor: 91.7% satisfactory",
        "mainly lateral-stretch",
        "72 of 72 targets met by the surrogate",
        "fair, 0 poor",
    ]
}


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_runs(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the notebook machinery, not ours
        import nbclient
        import nbformat

        notebook = nbformat.read(path, as_version=4)
        nbclient.NotebookClient(
            notebook, timeout=300, resources={"metadata": {"path": NOTEBOOKS}}
        ).execute()
    said = "\n".join(
        output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", [])
    )
    for words in SAYS[path.stem]:
        assert words in said
