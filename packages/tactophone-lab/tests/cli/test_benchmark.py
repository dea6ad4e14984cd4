import json
from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.core.recordings.metadata import write_metadata
from tests.surfaces import surfaces


@pytest.fixture
def data(tmp_path: Path) -> str:
    folder = tmp_path / "scrapes"
    folder.mkdir()
    write_metadata(folder, surfaces(folder).recordings)
    return str(folder)


@pytest.mark.slow
def test_prints_a_table_and_writes_json_and_a_report(
    data: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "benchmark",
        "--data",
        data,
        "--methods",
        "level,texture",
        "--splits",
        "2-fold",
        "--workers",
        "1",
        "--out",
        str(tmp_path / "out"),
        "--cache",
        str(tmp_path / "cache"),
    ]
    assert main(command) == 0
    table = capsys.readouterr().out
    assert "scrapes (as recorded), 2-fold" in table
    assert "permuted labels" in table
    assert "perceptual" in table
    assert "texture" in table
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [result["method"] for result in results["datasets"][0]["results"]] == [
        "level",
        "texture",
    ]
    assert (
        (tmp_path / "out" / "report.md")
        .read_text()
        .startswith("# Tactophone benchmark")
    )


def test_impossible_options_end_in_one_line(
    data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["benchmark", "--data", data, "--methods", "guesswork"]) == 1
    assert main(["benchmark", "--data", data, "--workers", "0"]) == 1
    errors = capsys.readouterr().err
    assert "no method guesswork" in errors
    assert "must be 1 to 256" in errors


@pytest.mark.slow
def test_sweeps_every_combination_and_ranks_by_what_is_felt(
    data: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folds = ["--data", data, "--split", "2-fold", "--json"]
    folds += ["--cache", str(tmp_path / "cache")]
    choices = ["--vary", "recipe=level,texture", "--vary", "channels=1,2"]
    assert main(["evaluate", *folds, *choices, "--workers", "1"]) == 0
    found = capsys.readouterr()
    assert "ranked by the balanced accuracy of what is felt" in found.err
    rows = json.loads(found.out)
    assert len(rows) == 4
    assert [row["score"] for row in rows] == sorted(
        (row["score"] for row in rows), reverse=True
    )
    assert rows[0]["settings"].startswith("recipe texture")
    scores = {row["settings"]: row["score"] for row in rows}
    for recipe in ("level", "texture"):
        assert main(["evaluate", *folds, "--recipe", recipe]) == 0
        report = json.loads(capsys.readouterr().out)[recipe]
        felt = report["rendered"]["balanced_accuracy"]["value"]
        assert scores[f"recipe {recipe}, channels 2"] == felt


@pytest.mark.parametrize(
    "text", ["recipe", "colour=red", "hop=many", "recipe=guesswork"]
)
def test_a_setting_without_a_meaning_is_refused(
    text: str, data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", "--data", data, "--vary", text]) == 1
    assert text.rsplit("=", maxsplit=1)[-1] in capsys.readouterr().err


@pytest.mark.realtime
def test_a_ray_cluster_with_another_working_directory_gets_relative_paths(
    data: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    ray = pytest.importorskip("ray")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/note.txt").write_text("a worker begins here")
    monkeypatch.chdir(Path(data).parent)
    command = [
        "--data",
        Path(data).name,
        "--workers",
        "1",
        "--ray",
        "--cache",
        str(tmp_path / "cache"),
    ]
    ray.init(
        num_cpus=1,
        include_dashboard=False,
        runtime_env={"working_dir": str(tmp_path / "elsewhere")},
    )
    try:
        split = ["--splits", "2-fold", "--out", str(tmp_path / "out")]
        assert main(["benchmark", *command, "--methods", "level", *split]) == 0
        assert (
            main(["evaluate", *command, "--vary", "recipe=level", "--split", "2-fold"])
            == 0
        )
        monkeypatch.setattr(
            "tactophone_lab.benchmark.folds._absolute", lambda fold: fold
        )
        capsys.readouterr()
        assert main(["benchmark", *command, "--methods", "texture", *split]) == 1
    finally:
        ray.shutdown()
    error = capsys.readouterr().err
    assert "does not see" in error
    assert "Traceback" not in error


@pytest.mark.realtime
def test_a_ray_cluster_has_the_results_of_this_process(
    data: str, tmp_path: Path
) -> None:
    ray = pytest.importorskip("ray")
    command = [
        "benchmark",
        "--data",
        data,
        "--methods",
        "level,texture",
        "--splits",
        "2-fold",
        "--workers",
        "1",
    ]
    try:
        for name, place in (("here", []), ("ray", ["--ray"])):
            assert (
                main(
                    [
                        *command,
                        *place,
                        "--out",
                        str(tmp_path / name),
                        "--cache",
                        str(tmp_path / f"{name}-cache"),
                    ]
                )
                == 0
            )
        assert (
            main(
                [
                    "evaluate",
                    "--data",
                    data,
                    "--vary",
                    "recipe=level,texture",
                    "--split",
                    "2-fold",
                    "--workers",
                    "1",
                    "--ray",
                    "--cache",
                    str(tmp_path / "sweep-cache"),
                ]
            )
            == 0
        )
    finally:
        ray.shutdown()
    here, there = (
        json.loads((tmp_path / name / "results.json").read_text())["datasets"]
        for name in ("here", "ray")
    )
    assert here == there


def test_what_is_varied_is_a_table_best_first(
    data: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "evaluate",
        "--data",
        data,
        "--recipe",
        "level",
        "--split",
        "2-fold",
        "--workers",
        "1",
    ]
    assert (
        main([*command, "--vary", "recipe=level", "--cache", str(tmp_path / "cache")])
        == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:3] == ["settings", "balanced", "accuracy"]
    assert lines[1].startswith("recipe level")
