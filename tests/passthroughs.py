"""Every way to feel the sound itself: the built-in one, and what the plug-in in
examples/plugins adds."""

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
from tests.entry_points import write_metadata

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
    write_metadata(PLUGIN, folder, {PASSTHROUGHS: more_entries})
    monkeypatch.syspath_prepend(str(PLUGIN))
    monkeypatch.syspath_prepend(str(folder))
