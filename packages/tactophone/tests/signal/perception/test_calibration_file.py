import dataclasses
from pathlib import Path

import pytest

from tactophone.core.errors import ConfigError
from tactophone.signal.perception.calibration import Calibration

CALIBRATION = Calibration(
    made="2026-01-02T03:04:05",
    source='JACK "system:capture_1"',
    sample_rate=48_000,
    false_alarms_per_minute=1.0,
    threshold_dbfs=-23.5,
    window_dbfs=-26.25,
    floor_dbfs=(-28.0, -60.5),
    hum_dbfs=(-31.0, -77.0),
    stroke_dbfs=(-12.0, -30.0),
    peak_dbfs=(-6.0, -12.0),
    banded_dbfs=-24.5,
)


def test_a_written_file_reads_back_equal(tmp_path: Path) -> None:
    CALIBRATION.write(tmp_path / "finger.toml")
    assert Calibration.read(tmp_path / "finger.toml") == CALIBRATION


def test_the_reference_holds_the_levels_of_the_set_up() -> None:
    reference = CALIBRATION.reference
    assert (reference.threshold_dbfs, reference.floor_dbfs) == (-26.25, (-28.0, -60.5))
    assert reference.contrast_db == 18.0


def test_one_channel_has_a_reference_too() -> None:
    lone = dataclasses.replace(CALIBRATION, floor_dbfs=(-28.0,), hum_dbfs=(-31.0,))
    assert lone.channels == len(lone.reference.floor_dbfs) == 1


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[calibration]\nmade = 3\n",
        "not toml at all",
        "[calibration]\nthreshold_dbfs = 'loud'\n",
    ],
)
def test_an_invalid_file_is_refused_with_the_next_step(
    tmp_path: Path, text: str
) -> None:
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(ConfigError, match="tactophone check"):
        Calibration.read(tmp_path / "bad.toml")


@pytest.mark.parametrize("value", ["-1e308", "nan", "inf", "-inf"])
@pytest.mark.parametrize(
    "entry",
    ["threshold_dbfs", "window_dbfs", "banded_dbfs", "margin_db", "floor_dbfs"],
)
def test_a_number_that_no_set_up_has_is_refused(
    tmp_path: Path, entry: str, value: str
) -> None:
    """With a margin of -1e308 dB, noise alone vibrated."""
    if (entry, value) == ("banded_dbfs", "inf"):
        return  # what was not measured
    path = tmp_path / "finger.toml"
    CALIBRATION.write(path)
    lines = path.read_text().splitlines()
    wrong = f"[{value}, {value}]" if entry == "floor_dbfs" else value
    kept = [line for line in lines if not line.startswith(f"{entry} ")]
    path.write_text("\n".join([*kept, f"{entry} = {wrong}"]))
    with pytest.raises(ConfigError, match=entry):
        Calibration.read(path)


def test_a_file_with_other_things_in_it_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    CALIBRATION.write(path)
    path.write_text(path.read_text() + "# " + 20_000 * "x")
    with pytest.raises(ConfigError, match="but at most 16384 are read"):
        Calibration.read(path)


def test_levels_of_one_channel_beside_those_of_two_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    dataclasses.replace(CALIBRATION, hum_dbfs=(-31.0,)).write(path)
    with pytest.raises(ConfigError, match="one channel and of two"):
        Calibration.read(path)


def test_a_missing_file_and_a_bad_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        Calibration.read(tmp_path / "none.toml")
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="folder"):
        CALIBRATION.write(tmp_path / "file" / "finger.toml")
