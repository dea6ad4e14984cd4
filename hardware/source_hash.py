"""A hash by which the parts on disk are known to be those that the source makes."""

import ast
import hashlib
from pathlib import Path

SOURCES = ("dimensions", "fingertip")
"""Modules from which the parts are made."""


def source_hash() -> str:
    """Hash the code that the parts are made from; its layout, comments and docstrings
    do not count."""
    here = Path(__file__).parent
    code = []
    for name in SOURCES:
        tree = ast.parse((here / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                node.body = [each for each in node.body if not _is_words(each)]
        code.append(ast.unparse(tree))
    return hashlib.sha256("\n".join(code).encode()).hexdigest()


def _is_words(statement: ast.stmt) -> bool:
    """Return whether a statement is a docstring."""
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
