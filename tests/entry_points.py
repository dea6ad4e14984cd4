"""Registers another package for a test, without pip."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path


def write_metadata(
    project: Path,
    folder: Path,
    more: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write into ``folder`` what pip would note about a project's entry points.

    ``more`` adds lines such as ``"name = module:object"`` to a group. With ``folder``
    in ``sys.path``, `importlib.metadata` finds them.
    """
    described = tomllib.loads((project / "pyproject.toml").read_text())["project"]
    name, version = described["name"], described["version"]
    metadata = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    )
    lines: list[str] = []
    for group, points in described.get("entry-points", {}).items():
        lines.append(f"[{group}]")
        lines += [f"{name} = {target}" for name, target in points.items()]
        lines += (more or {}).get(group, ())
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
