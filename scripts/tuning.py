"""Writes docs/reference/tuning.md, what may be tuned in perception, from the constants: python scripts/tuning.py"""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
ROOM = ROOT / "src" / "tactophone" / "signal" / "perception"
PAGE = ROOT / "docs" / "reference" / "tuning.md"
HEAD = """# What may be tuned in perception

Every constant of `signal/perception` with a value of its own, from its docstring (`python scripts/tuning.py` writes
this page). None has a switch: those are settings (`tactophone settings`). Change one in its file, then run
`make room ROOM=perception`.
"""
UNITS = (
    ("dBFS", r"_DBFS$|\bdBFS\b"), ("dB", r"_DB$|\bdB\b|[Dd]ecibel"), ("ms", r"\bMilliseconds|\bin ms\b"),
    ("s", r"\b[Ss]econds\b|\bin s\b"), ("Hz", r"_HZ$|\bHz\b|[Hh]ertz"), ("windows", r"\b[Ww]indows\b"),
    ("steps", r"\b[Ss]teps\b"), ("share", r"\b[Ss]hare"),
)  # fmt: skip


def rows(path: Path) -> list[tuple[str, str, str, str]]:
    """Return name, value, unit and first sentence of each constant of a module."""
    body, found = ast.parse(path.read_text()).body, []
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        described = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        name, value = ast.unparse(target).strip("()"), ast.unparse(node.value)
        if not described or not re.fullmatch(r"[A-Z_0-9, ]+", name) or not re.search(r"\d", value) or len(value) > 40:
            continue
        words = " ".join(str(after.value.value).split())  # type: ignore[union-attr]
        ends = [match.end() for match in re.finditer(r"[.:;](?= [A-Z`]|$)", words)]
        whole = (words[:end] for end in ends if words[:end].count("(") == words[:end].count(")"))
        sentence = next(whole, words).rstrip(":;").replace("|", "\\|")
        unit = next((unit for unit, sign in UNITS if re.search(sign, name) or re.search(sign, sentence)), "")
        found.append((name, value.strip("()"), unit, sentence))
    return found


def page() -> str:
    parts = [HEAD]
    for path in sorted(ROOM.glob("*.py")):
        if table := rows(path):
            lines = [f"| `{name}` | {value} | {unit} | {words} |" for name, value, unit, words in table]
            parts.append(
                "\n".join([f"## `{path.name}`\n", "| name | value | unit | meaning |", "|---|---|---|---|", *lines])
            )
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page())
