"""Runs the notebook in examples/; it prints what it shows to those who only read it.

Store what it prints anew with ``RENEW=1 python -m pytest tests/test_notebook.py``.
"""

import os
from pathlib import Path

import nbclient
import nbformat
import pytest

NOTEBOOK = Path(__file__).parent.parent / "examples" / "recording_to_model.ipynb"


def printed(notebook: nbformat.NotebookNode) -> list[str]:
    """Return what each cell of code prints."""
    return [
        "".join(
            output["text"]
            for output in cell.outputs
            if output["output_type"] == "stream" and output["name"] == "stdout"
        )
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


@pytest.mark.long
def test_the_notebook_prints_what_it_shows(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    shown = printed(notebook)
    client = nbclient.NotebookClient(
        notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    if os.environ.get("RENEW"):
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)  # the time of day of each cell
        nbformat.write(notebook, NOTEBOOK)
    else:
        assert printed(notebook) == shown
