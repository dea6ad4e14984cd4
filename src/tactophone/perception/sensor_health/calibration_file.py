"""The calibration file: `tactophone calibrate` writes it, other commands read it."""

import dataclasses
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from tactophone.errors import ConfigError
from tactophone.perception.features.loudness import LoudnessRule
from tactophone.perception.sensor_health.faults import Reference

CLIPPED = 0.05
"""Share of clipped samples in a half second that is a fault once the gain was found good: a knob was turned."""

_TABLE = "calibration"


@dataclass(frozen=True, slots=True)
class Calibration:
    """Levels of a set-up (a finger, its microphones, their gain); one entry for each channel where several."""

    made: str
    source: str
    """`made` and `source`: date and time in ISO 8601, and the name of the source."""
    sample_rate: int
    """In Hz."""
    false_alarms_per_minute: float
    """Chosen: false contacts in a minute of silence."""
    threshold_dbfs: float
    """Level of the contact microphone from which there is contact, for :class:`ContactGate`."""
    window_dbfs: float
    """The same for a whole window of 256 ms, as in the paper: lower, as a level over a longer time varies less."""
    floor_dbfs: tuple[float, ...]
    hum_dbfs: tuple[float, ...]
    """`floor_dbfs` and `hum_dbfs`: level and hum in silence."""
    stroke_dbfs: tuple[float, ...]
    peak_dbfs: tuple[float, ...]
    """`stroke_dbfs` and `peak_dbfs`: median level and highest peak while stroked."""
    banded_dbfs: float = math.inf
    """``threshold_dbfs`` by the rule ``banded``; infinite in files of versions that did not measure it."""

    def threshold_for(self, rule: LoudnessRule) -> float | None:
        """Return the contact threshold for a model's rule, if it was measured."""
        if rule == "rms":
            return self.threshold_dbfs
        return self.banded_dbfs if rule == "banded" and math.isfinite(self.banded_dbfs) else None

    @property
    def channels(self) -> int:
        """1 or 2; channel 0 is contact."""
        return len(self.floor_dbfs)

    @property
    def reference(self) -> Reference:
        """The normal state that sensor faults are compared with."""
        levels = (self.floor_dbfs, self.stroke_dbfs)
        contrast_db = min(contact - air for contact, air in levels) if self.channels > 1 else 0.0
        return Reference(self.window_dbfs, self.floor_dbfs, self.hum_dbfs, CLIPPED, contrast_db)

    def write(self, path: Path) -> None:
        """Write the file; raises `ConfigError` if it cannot be written."""
        lines = [f"{name} = {_toml(value)}" for name, value in dataclasses.asdict(self).items()]
        try:
            path.write_text("\n".join((f"[{_TABLE}]", *lines, "")), encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}; give a folder that can be written to") from None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file; raises `ConfigError` if it is missing, or not a file of :meth:`write`."""
        again = "make one with `tactophone calibrate`"
        try:
            entries = tomllib.loads(path.read_text(encoding="utf-8"))[_TABLE]
            entries = {"banded_dbfs": math.inf, **entries}
            return cls(**{field.name: _fit(entries[field.name], field.type) for field in dataclasses.fields(cls)})
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}; {again}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"{path}: not a calibration file ({type(error).__name__}: {error}); {again}") from None


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _fit(value: Any, kind: Any) -> Any:
    return kind(value) if kind in (str, int, float) else tuple(float(entry) for entry in value)
