from pathlib import Path

import pytest

from tactophone import DatasetError, Touch
from tactophone.core.recordings.values import Dataset, Recording
from tactophone_lab.datasets.splits import kin_of, split, with_kin


def dataset(
    *, surfaces: int = 6, scenarios: tuple[str, ...] = ("hand", "box")
) -> Dataset:
    made = (
        Recording(
            Path(f"{s}_{scenario}.wav"),
            f"stone {s}",
            Touch(1 + s % 2),
            scenario=scenario,
        )
        for s in range(surfaces)
        for scenario in scenarios
    )
    return Dataset("made", Path("made"), (*made, Recording(Path("x.wav"), "unknown")))


@pytest.mark.parametrize(
    "name", ["leave-one-kin-out", "leave-one-surface-out", "3-fold"]
)
def test_no_surface_is_on_both_sides_and_each_is_tested_once(name: str) -> None:
    folds = split(dataset(), name)
    for fold in folds:
        assert not {recording.surface for recording in fold.train} & {
            recording.surface for recording in fold.test
        }
    tested = [recording.path for fold in folds for recording in fold.test]
    assert len(tested) == len(set(tested)) == 12


def test_folds_spread_the_labels_evenly() -> None:
    for fold in split(dataset(), "3-fold"):
        assert {recording.label for recording in fold.test} == {
            Touch.SMOOTH,
            Touch.ROUGH,
        }


def test_folds_depend_on_names_alone() -> None:
    made = dataset()
    turned = Dataset(made.name, made.root, made.recordings[::-1])
    assert [set(fold.test) for fold in split(made, "3-fold")] == [
        set(fold.test) for fold in split(turned, "3-fold")
    ]


@pytest.mark.parametrize("name", ["leave-one-kin-out", "2-fold", "3-fold"])
def test_kin_stay_together(name: str, tmp_path: Path) -> None:
    versions = (
        Recording(Path(f"{place}.wav"), surface, label)
        for place, (surface, label) in enumerate(
            (f"{thing}{version}", label)
            for thing, label in (
                ("Tile", Touch.ROUGH),
                ("Plate", Touch.SMOOTH),
                ("Mesh", Touch.ROUGH),
            )
            for version in ("", "Version2", " v3")
        )
    )
    by_name = Dataset("versions", tmp_path, tuple(versions))
    for fold in split(by_name, name):
        assert not {kin_of(take) for take in fold.train} & {
            kin_of(take) for take in fold.test
        }
    (tmp_path / "kin.csv").write_text("surface,kin\nTile,hard\nPlate,hard\n")
    by_file = with_kin(by_name, tmp_path / "kin.csv")
    assert {kin_of(take) for take in by_file.recordings} == {
        "hard",
        "Tile",
        "Plate",
        "Mesh",
    }


def test_a_kin_file_must_fit(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="cannot be read"):
        with_kin(dataset(), tmp_path / "absent.csv")
    (tmp_path / "kin.csv").write_text("surface,kin\nmoon,dust\n")
    with pytest.raises(DatasetError, match="names none of the surfaces"):
        with_kin(dataset(), tmp_path / "kin.csv")


def test_any_key_may_be_left_out() -> None:
    folds = split(dataset(), "leave-one-scenario-out")
    assert [fold.name for fold in folds] == ["scenario box", "scenario hand"]
    assert {recording.scenario for recording in folds[0].test} == {"box"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("by-window", "take one of leave-one-kin-out, leave-one-surface-out"),
        ("leave-one-session-out", "every recording has session ''"),
        ("7-fold", "7 folds of 6 surfaces"),
        ("predefined", "no split of its own"),
    ],
)
def test_a_split_that_cannot_be_made_says_why(name: str, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        split(dataset(), name)


def test_a_predefined_split_that_leaks_is_refused() -> None:
    leaky = tuple(
        Recording(Path(f"{part}.wav"), "slate", Touch.ROUGH, properties={"split": part})
        for part in ("train", "test")
    )
    with pytest.raises(DatasetError, match="slate in both train and test"):
        split(Dataset("leaky", Path("leaky"), leaky), "predefined")
