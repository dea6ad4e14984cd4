"""Sound that plays in the room while the simulated finger touches, such as a voice:
both microphones hear it.

The air microphone hears it directly; to the contact microphone it comes through the
air and the mounting, and is far fainter. How much fainter nobody has measured on a
fingertip, so the coupling is assumed (docs/research/contact.md, Sound from the air),
and the same at all frequencies.
"""

import functools
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactophone.core.errors import ConfigError
from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.recordings.values import Recording
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.signal.perception.resample import Resampler
from tactophone_lab.simulation.room_sound_levels import BARE_DISC_DB, VOICE_DBFS


@dataclass(frozen=True, slots=True)
class RoomSound:
    """A sound in the room, and how both microphones hear it.

    - ``path``: a WAV or FLAC file, whose first channel is played over and over.
    - ``level_dbfs``: of its loudest second, at the air microphone.
    - ``isolation_db``: dB by which the contact microphone hears it fainter.

    Reading it raises `DatasetError` if the file is missing or no sound, and
    `ConfigError` if it is silent.
    """

    path: Path
    level_dbfs: float = VOICE_DBFS
    isolation_db: float = BARE_DISC_DB

    @property
    def fingerprint(self) -> str:
        """A hash of all that a recording depends on."""
        digest = hashlib.sha256(self.path.read_bytes()).hexdigest()
        return f"{digest} {self.level_dbfs} {self.isolation_db}"

    def check(self) -> None:
        """Raise what reading the file raises."""
        _played(self.path)

    def heard(self, size: int, rng: np.random.Generator) -> FloatArray:
        """Return so many samples at 48 kHz of both microphones, ``(samples, 2)``, from
        a random moment of the sound on."""
        sound = _played(self.path)
        sound = np.roll(sound, -int(rng.integers(len(sound))))
        pair = np.zeros((size, 2), np.float32)
        pair[:, AIR] = np.resize(sound, size) * 10 ** (self.level_dbfs / 20)
        pair[:, CONTACT] = pair[:, AIR] * 10 ** (-self.isolation_db / 20)
        return pair


@functools.lru_cache(maxsize=4)
def _played(path: Path) -> FloatArray:
    """Return a file's first channel at 48 kHz, with an RMS of 1 in its loudest
    second."""
    block = Recording(path, path.stem).read(channels=1)
    resampler = Resampler(block.sample_rate, LIVE_SAMPLE_RATE, channels=1)
    sound = np.concatenate([resampler.push(block.samples), resampler.flush()])[:, 0]
    second = min(len(sound), LIVE_SAMPLE_RATE)
    power = np.cumsum(np.insert(np.square(sound, dtype=np.float64), 0, 0.0))
    loudest = float((power[second:] - power[:-second]).max()) if second else 0.0
    if loudest <= 0:
        raise ConfigError(f"{path}: silent, so nothing of it can be heard")
    return np.asarray(sound / np.sqrt(loudest / second), np.float32)
