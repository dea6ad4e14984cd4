"""Writes docs/reference/tuning.md, what may be tuned in perception, from the constants:
python scripts/tuning.py"""

import argparse
import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
SIGNAL = ROOT / "packages" / "tactophone" / "src" / "tactophone" / "signal"
ROOM = SIGNAL / "perception"
PAGE = ROOT / "docs" / "reference" / "tuning.md"
HEAD = """# What may be tuned in perception

Every constant of `signal/perception`, and of `signal/silences.py` beside it, with a
value of its own, from its docstring (`python scripts/tuning.py` writes this page). None
has a switch: those are settings (`tactophone settings`). Change one in its file, then
run `make room ROOM=perception`.
"""
UNITS = (
    ("dBFS", r"_DBFS\b"),
    ("dB", r"_DB\b"),
    ("share", r"_SHARE\b"),
)
"""By the names of a constant; then by how its sentence begins, or by what stands after
*in* or in brackets."""

FIRST_WORDS = {
    "Seconds": "s",
    "Milliseconds": "ms",
    "Hz": "Hz",
    "Share": "share",
    "Quantile": "share",
    "Steps": "steps",
    "Windows": "windows",
    "Levels": "levels",
    "Samples": "samples",
    "Bytes": "bytes",
    "Hops": "hops",
}
STATED = r"\bin (dB/s|dBFS|dB|Hz|ms|s)\b|\((dB|Hz|ms|s)\)"


def unit_of(names: str, sentence: str) -> str:
    """Return the unit of a constant, or of several that have the same; empty where
    nothing states one."""
    parts = names.split(", ")
    for unit, sign in UNITS:
        if all(re.search(sign, name) for name in parts):
            return unit
    if len(parts) > 1 and any(
        re.search(sign, name) for _, sign in UNITS for name in parts
    ):
        return ""
    if (word := sentence.partition(" ")[0].strip(";,.")) in FIRST_WORDS:
        each = "/s" * sentence.startswith(f"{word} a second")
        return "" if len(parts) > 1 and ";" in sentence else FIRST_WORDS[word] + each
    stated = re.search(STATED, sentence)
    return (stated[1] or stated[2]) if stated else ""


def rows(path: Path) -> list[tuple[str, str, str, str]]:
    """Return name, value, unit and first sentence of each constant of a module."""
    body, found = ast.parse(path.read_text()).body, []
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        described = isinstance(after, ast.Expr) and isinstance(
            after.value, ast.Constant
        )
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
        name, value = (
            ast.unparse(target).strip("()"),
            ", ".join(map(ast.unparse, values)),
        )
        if (
            not described
            or not re.fullmatch(r"[A-Z_0-9, ]+", name)
            or not re.search(r"\d", value)
            or len(value) > 40
        ):
            continue
        words = " ".join(str(after.value.value).split())  # type: ignore[union-attr]
        ends = [match.end() for match in re.finditer(r"[.:;](?= [A-Z`]|$)", words)]
        whole = (
            words[:end]
            for end in ends
            if words[:end].count("(") == words[:end].count(")")
        )
        sentence = next(whole, words).rstrip(":;").replace("|", "\\|")
        found.append((name, value, unit_of(name, sentence), sentence))
    return found


def page() -> str:
    parts = [HEAD]
    for path in [SIGNAL / "silences.py", *sorted(ROOM.glob("*.py"))]:
        if table := rows(path):
            lines = [
                f"| `{name}` | {value} | {unit} | {words} |"
                for name, value, unit, words in table
            ]
            parts.append(
                "\n".join(
                    [
                        f"## `{path.name}`\n",
                        "| name | value | unit | meaning |",
                        "|---|---|---|---|",
                        *lines,
                    ]
                )
            )
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    PAGE.write_text(page())


if __name__ == "__main__":
    main()
