"""Runs notebooks from top to bottom; fails if a cell fails. It writes nothing."""

import sys

import nbformat
from nbclient import NotebookClient

for name in sys.argv[1:]:
    notebook = nbformat.read(name, as_version=4)
    nbformat.validate(notebook)
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    print(f"{name}: {sum(cell.cell_type == 'code' for cell in notebook.cells)} cells ran")
