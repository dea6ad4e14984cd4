import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from paper_tables import (
    FINE_TUNED,
    GATES,
    IN_CONTACT,
    IN_CONTACT_DAYS,
    IN_CONTACT_TEST,
    PAPER_ONE,
    TABLE_SHARES,
    TWO_COLUMNS,
    TableRow,
    as_felt,
    by_gate,
    contact_share,
    file_method,
    loud_segments,
    paper_parts,
    predict_held_out,
    shipped_predictor,
    table_one,
    table_two,
    training_key,
    training_takes,
)
from tactophone.cli.output import out, show
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Dataset, Recording, Segment
from tactophone.core.types import Touch
from tactophone_lab.benchmark.folds import Cache
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.bootstrap import Estimate
from tactophone_lab.evaluation.predict import TakePredictions
from tests.surfaces import DURATION, TOUCHED, scrape, surfaces

RATE = 16_000


def authors(root: Path) -> Dataset:
    """The authors' layout: four objects to train on, two to test, and a day's two
    runs."""
    places = [
        ("opus/stereo/00_wiggle", 1),
        ("opus/stereo/01_wiggle", 1),
        ("opus/stereo/02_wiggle", 0),
        ("opus/stereo/03_wiggle", 0),
        ("opus/stereo/22_wiggle", 1),
        ("opus/stereo/21_wiggle", 0),
        ("finals_recordings/day_1_rough", 1),
        ("finals_recordings/day_1_smooth", 0),
    ]
    for seed, (place, rough) in enumerate(places):
        path = root / f"{place}.wav"
        path.parent.mkdir(parents=True, exist_ok=True)
        soundfile.write(
            path, 4 * scrape(rough=bool(rough), seed=seed), RATE, subtype="FLOAT"
        )
    return open_dataset(root)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return authors(tmp_path_factory.mktemp("authors"))


@pytest.fixture(scope="module")
def predictions(dataset: Dataset) -> dict[str, list[TakePredictions]]:
    return predict_held_out(dataset, ["texture"], Cache(dataset.root / "cache"))


def test_contact_is_labelled_by_the_authors_threshold_where_there_are_no_segments(
    dataset: Dataset,
) -> None:
    rough = next(take for take in dataset.recordings if take.label is Touch.ROUGH)
    before, touch = loud_segments(rough)
    assert (before.contact, touch.label) == (False, Touch.ROUGH)
    # A window of 256 ms is loud before it lies within the touch wholly, and until it
    # has nearly left it.
    assert TOUCHED[0] <= touch.start < TOUCHED[0] + 0.256
    assert TOUCHED[1] < touch.end < DURATION
    assert before.end <= touch.start


@pytest.mark.slow
def test_table_one_stands_beside_the_papers_own(
    predictions: dict[str, list[TakePredictions]],
) -> None:
    lines = {line.name: line.values for line in table_one(predictions)}
    assert list(lines) == [
        "paper's own, competition",
        "texture, competition",
        "paper's own, test",
        "texture, test",
    ]
    assert lines["paper's own, test"]["rough_as_rough"].value == 0.240
    shares = [lines["texture, test"][name].value for name in TABLE_SHARES]
    assert sum(shares) == pytest.approx(1)
    assert sum(PAPER_ONE["test"]) == pytest.approx(1, abs=0.005)


def test_table_two_has_each_class_and_day(
    predictions: dict[str, list[TakePredictions]],
) -> None:
    lines = {line.name: line.values for line in table_two(predictions)}
    assert tuple(lines["texture"]) == (
        *TWO_COLUMNS,
        IN_CONTACT_DAYS,
        IN_CONTACT_TEST,
    )
    assert math.isnan(lines["texture"]["rough day 2"].value)
    assert lines["texture"]["rough day 1"].value > 0.8
    assert lines["texture"]["test smooth"].value > 0.8
    assert lines["paper's own, fine-tuned"]["test smooth"].value == 0.999


def test_intervals_are_of_takes_and_of_pieces_of_a_run(
    predictions: dict[str, list[TakePredictions]],
) -> None:
    (take,) = (
        take
        for take in predictions["texture"]
        if take.recording.path.stem == "day_1_rough"
    )
    time = np.arange(0.0, 30.0, 0.01)
    wrong = (time > 10) & (time < 15)
    probabilities = np.where(wrong[:, None], (0, 1, 0), (0, 0, 1)).astype(np.float32)
    recording = replace(take.recording, segments=(Segment(0.0, 30.0, "rough"),))
    run = TakePredictions(recording, time, probabilities, np.full(len(time), True))
    score = table_two({"texture": [run]})[-1].values["rough day 1"]
    assert score.low < score.value == pytest.approx(5 / 6, abs=0.01)
    assert score.high == 1
    # A take of a test object is drawn whole, so that one has no interval.
    alone = replace(
        run, recording=replace(recording, session="", properties={"split": "test"})
    )
    score = table_two({"texture": [alone]})[-1].values["test rough"]
    assert math.isnan(score.low)


def test_both_gates_print_the_share_of_windows_in_contact(
    dataset: Dataset, predictions: dict[str, list[TakePredictions]]
) -> None:
    tables = {
        gate: table_one(gated)
        for gate, gated in by_gate(predictions, dataset.recordings).items()
    }
    assert list(tables) == list(GATES)
    authors_share, papers_share = (
        next(
            line.values[IN_CONTACT].value
            for line in lines
            if line.name == "texture, test"
        )
        for lines in tables.values()
    )
    # The scrapes are quieter than -26 dBFS: nothing is scored there, and the cells say
    # so.
    assert 0 == papers_share < authors_share < 1
    marked = [
        replace(take, segments=(Segment(0.0, 1.0, "rough"),))
        for take in dataset.recordings
    ]
    assert list(by_gate(predictions, marked)) == ["contact as labelled"]


def test_each_column_group_states_the_share_in_contact_of_its_own_takes(
    predictions: dict[str, list[TakePredictions]],
) -> None:
    """A share pooled over days and test objects once stood beside scores of the days
    alone."""
    row = table_two(predictions)[-1].values
    for column, part in ((IN_CONTACT_DAYS, "competition"), (IN_CONTACT_TEST, "test")):
        own = [
            take
            for take in predictions["texture"]
            if take.recording.known("split") == part
        ]
        assert row[column].value == contact_share(own).value


def test_what_is_rendered_is_scored_as_it_is_felt() -> None:
    felt = np.array([Touch.NONE, Touch.SMOOTH, Touch.ROUGH], np.int8)
    unsure = np.full((3, 3), 1 / 3, np.float32)
    take = TakePredictions(
        Recording(Path("a.wav"), "a", Touch.ROUGH),
        np.arange(3.0),
        unsure,
        np.full(3, True),
        felt,
    )
    assert as_felt(take).probabilities[:, 2].tolist() == [0, 0, 1]


def test_a_row_of_a_shipped_model_says_what_it_is() -> None:
    assert shipped_predictor("shipped:texture")[0] == "texture, as shipped"
    assert shipped_predictor("rendered:paper")[0] == "paper, as rendered"


@pytest.mark.parametrize("where", ["resample.py", "recipe_options.py"])
def test_a_change_of_resampler_or_options_trains_anew(
    where: str, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recipe = (
        Path(__file__).parents[2]
        / "examples"
        / "recipes"
        / "tables"
        / "fast-general.toml"
    )
    method = file_method(recipe, tmp_path, print)
    before = training_key(method, dataset.recordings)
    read = Path.read_bytes

    def changed(path: Path) -> bytes:
        return read(path) + (b"\nCHANGED = 1\n" if path.name == where else b"")

    monkeypatch.setattr(Path, "read_bytes", changed)
    assert training_key(method, dataset.recordings) != before


def test_fine_tuned_trains_on_fewer_objects_and_a_stone_of_the_competition() -> None:
    def take(number: int, label: Touch, side: str) -> Recording:
        properties = {"split": side}
        return Recording(
            Path(f"{number}.wav"), f"object {number:02}", label, properties=properties
        )

    takes = tuple(take(number, Touch(1 + number % 2), "train") for number in range(20))
    takes += (take(20, Touch.ROUGH, ""), take(21, Touch.SMOOTH, "test"))
    sample = replace(take(0, Touch.SMOOTH, ""), surface="competition", session="sample")
    takes += (sample,)
    assert len(training_takes(takes, "paper/general")[0]) == 20
    chosen, with_kin = training_takes(takes, FINE_TUNED)
    assert {recording.surface for recording in chosen} == {
        "competition",
        *(f"object {number}" for number in range(10, 21)),
    }
    assert with_kin


def test_other_layouts_have_no_such_tables(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="authors' layout"):
        predict_held_out(surfaces(tmp_path), ["texture"], Cache(tmp_path / "cache"))


@pytest.mark.long
def test_a_recipe_file_is_a_row_and_its_training_is_cached(
    dataset: Dataset, tmp_path: Path
) -> None:
    recipes = Path(__file__).parents[2] / "examples" / "recipes" / "tables"
    assert len(list(recipes.glob("*.toml"))) == 9
    files = []
    for name in ("paper-fine-tuned", "authors-general"):
        small = (
            (recipes / f"{name}.toml")
            .read_text()
            .replace("hop = 1\n", "hop = 21\nepochs = 1\nbatch_size = 200\n")
        )
        (tmp_path / f"{name}.toml").write_text(small)
        files.append(str(tmp_path / f"{name}.toml"))
    cache, trained = Cache(tmp_path / "cache"), []
    found = predict_held_out(dataset, files, cache, report=trained.append)
    names = ["paper-fine-tuned", "authors-general"]
    assert list(found) == [name for name in trained if ":" not in name] == names
    kept = {
        path: path.stat().st_mtime_ns
        for path in (tmp_path / "cache").rglob("*")
        if path.is_file()
    }
    assert kept
    again = predict_held_out(dataset, files, cache)
    assert {
        path: path.stat().st_mtime_ns
        for path in (tmp_path / "cache").rglob("*")
        if path.is_file()
    } == kept
    for name in names:
        assert np.array_equal(
            found[name][0].probabilities, again[name][0].probabilities
        )
    assert [row.name for row in table_two(found)][-2:] == names
    # Other takes to test with need no other model.
    for path in (tmp_path / "cache").glob("*.npz"):
        path.unlink()
    predict_held_out(dataset, files, cache)
    models = {
        path: path.stat().st_mtime_ns for path in (tmp_path / "cache").glob("*.onnx")
    }
    assert len(models) == 2
    assert models.items() <= kept.items()


def test_the_papers_tables_show_whole_figures_in_80_characters(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    out.cache_clear()  # the console of an earlier test may be wider
    score = Estimate(0.723, 0.614, 1.0)
    shares = {
        **dict.fromkeys(TWO_COLUMNS, score),
        IN_CONTACT_DAYS: Estimate(0.642, math.nan, math.nan),
        IN_CONTACT_TEST: Estimate(0.127, math.nan, math.nan),
    }
    rows = [TableRow("paper/fine-tuned (tuned on their stones)", shares)]
    show(rows, paper_parts("Table II", rows), as_json=False)
    shown = capsys.readouterr().out
    assert shown.count("0.723") == shown.count(".61-1.00") == len(TWO_COLUMNS)
    assert shown.count("0.642") == shown.count("0.127") == 1
    assert "paper/fine-tuned" in shown
    assert max(map(len, shown.splitlines())) <= 80
