"""Makes small data sets on disk, in each of the three layouts."""

from pathlib import Path

import numpy as np
import soundfile

SAMPLE_RATE = 4000


def write_sound(
    path: Path,
    *,
    channels: int = 2,
    seconds: float = 0.5,
    level: float = 0.1,
    seed: int = 0,
) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    noise = np.random.default_rng(seed).uniform(
        -level, level, (int(seconds * SAMPLE_RATE), channels)
    )
    soundfile.write(path, noise, SAMPLE_RATE)
    return path


def write_text(path: Path, *lines: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def audiofolder(root: Path, *, surfaces: int = 4, takes: int = 2) -> Path:
    """Two-channel recordings; surfaces with an even number are rough."""
    lines = ["file_name,surface,label,channels,take,scenario,pressure"]
    for surface in range(surfaces):
        for take in range(takes):
            name = f"audio/{surface:02}_{take}.flac"
            write_sound(
                root / name,
                seed=10 * surface + take,
                level=0.3 if surface % 2 == 0 else 0.05,
            )
            label = "rough" if surface % 2 == 0 else "smooth"
            scenario = "table" if take else "hand"
            lines.append(
                f"{name},stone {surface:02},{label},contact|air,{take},{scenario},light"
            )
    write_text(root / "metadata.csv", *lines)
    return root


def authors(root: Path) -> Path:
    for name in (
        "00_long_light",
        "00_wiggle",
        "02_short_loud",
        "22_long_medium",
        "21_wiggle",
    ):
        write_sound(root / "opus" / "stereo" / f"{name}.wav")
    for name in ("day_1_smooth", "day_2_rough"):
        write_sound(root / "finals_recordings" / f"{name}.wav")
    return root
