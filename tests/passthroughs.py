"""Every way to feel the sound itself: the built-in one, and what the plug-in in
examples/plugins adds."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from examples.plugins.tactophone_passthroughs.tactophone_passthroughs import (
    MedianFrequency,
    PitchShift,
)
from tactophone.core.plugins import PASSTHROUGHS
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import Passthrough

ALL_PASSTHROUGHS: dict[str, Callable[[Limits | None], Passthrough]] = {
    "direct": Passthrough,
    "pitch": PitchShift,
    "median-frequency": MedianFrequency,
}

PLUGIN = Path(__file__).parents[1] / "examples" / "plugins" / "tactophone_passthroughs"


def install_plugin(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *more_entries: str
) -> None:
    """Install the plug-in for a test, with the metadata in ``folder`` that pip would
    write, and more entry points such as ``"name = module:object"``."""
    project = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]
    entries = [
        f"{name} = {target}"
        for name, target in project["entry-points"][PASSTHROUGHS].items()
    ]
    metadata = folder / "tactophone_passthroughs-0.1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: tactophone-passthroughs\nVersion: 0.1.0\n"
    )
    lines = "\n".join([f"[{PASSTHROUGHS}]", *entries, *more_entries, ""])
    (metadata / "entry_points.txt").write_text(lines)
    monkeypatch.syspath_prepend(str(PLUGIN))
    monkeypatch.syspath_prepend(str(folder))
