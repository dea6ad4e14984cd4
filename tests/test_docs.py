"""The documentation builds, fetches nothing, and refers only to what exists."""

import importlib.util
import itertools
import json
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tactophone.cli import _parse, main
from tactophone.cli.verbs import all_verbs
from tests.entry_points import write_metadata
from tests.passthroughs import install_plugin

ROOT = Path(__file__).parent.parent
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` builds it."""
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--site-dir",
        str(folder),
    ]
    done = subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        env={"NO_MKDOCS_2_WARNING": "1"},
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_the_site_has_three_shelves_and_the_python_api(site: Path) -> None:
    assert {"guide", "reference", "research"} <= {path.name for path in site.iterdir()}
    assert "open_pipeline" in (site / "reference" / "api.html").read_text()


@pytest.mark.slow
def test_the_site_holds_the_page_that_listens(site: Path) -> None:
    assert (site / "browser" / "model.onnx").is_file()
    for page, link in (
        ("index.html", "guide/browser.html"),
        ("guide/browser.html", "../browser/index.html"),
    ):
        assert f'href="{link}"' in (site / page).read_text()


@pytest.mark.slow
def test_a_page_has_the_mark_the_palette_a_toggle_neighbours_and_copies_what_is_typed(
    site: Path,
) -> None:
    page = (site / "quickstart" / "lab.html").read_text()
    assert {"mark.svg", "palette.css"} <= {
        path.name for path in (site / "assets").iterdir()
    }
    assert (
        '[data-md-color-scheme="slate"]'
        in (site / "assets" / "palette.css").read_text()
    )
    for part in (
        "assets/mark.svg",
        "assets/palette.css",
        "Change to dark",
        'rel="prev"',
        'rel="next"',
    ):
        assert part in page
    assert 'data-copy="tactophone replay run.mcap"' in page  # neither prompt nor output
    assert "Edit this page" not in page  # nobody has said where the repository is


@pytest.mark.slow
def test_a_reader_of_the_site_fetches_nothing_from_elsewhere(site: Path) -> None:
    remote = re.compile(
        r"""<(?:script|link|img|iframe)[^>]*(?:src|href)=["']?(?:https?:)?//|@import|url\(["']?https?:"""
    )
    for page in site.rglob("*.html"):
        found = [
            match[0]
            for match in remote.finditer(page.read_text())
            if 'rel="canonical"' not in match[0]
        ]
        assert not found, page


def test_links_between_pages_of_the_repository_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text()):
            assert "://" in target or (page.parent / target).exists(), (
                f"{page.relative_to(ROOT)}: {target}"
            )


def test_files_and_tests_that_pages_name_exist() -> None:
    missing = []
    for page in PAGES:
        for name, _, test in re.findall(
            r"(?<![:/])\b((?:tests|benchmarks|examples|scripts)/[\w/-]+\.py)(::(\w+))?",
            page.read_text(),
        ):
            path = ROOT / name
            if not path.is_file() or (test and f"def {test}(" not in path.read_text()):
                missing.append(f"{page.relative_to(ROOT)}: {name} {test}")
    assert not missing, "\n".join(missing)


def test_python_files_that_pages_name_without_their_folder_exist() -> None:
    """A table once named `operator.py` long after the file had another name."""
    folders = (
        "packages",
        "benchmarks",
        "examples",
        "hardware",
        "integrations",
        "scripts",
    )
    known = {path.name for name in folders for path in (ROOT / name).rglob("*.py")}
    known |= {path.name for path in files_of_tests()} | {"conftest.py"}
    missing = [
        f"{page.relative_to(ROOT)}: {name}"
        for page in PAGES
        for name in re.findall(r"`(?:[\w./-]*/)?(\w+\.py)`", page.read_text())
        if name not in known
    ]
    assert not missing, "\n".join(missing)


def test_tests_that_pages_name_without_their_file_exist() -> None:
    known = {
        name
        for path in files_of_tests()
        for name in re.findall(r"def (test_\w+)", path.read_text())
    }
    named = {
        (page.name, name)
        for page in PAGES
        for name in re.findall(r"`(test_\w+)`", page.read_text())
    }
    assert len(named) > 20
    assert not {(page, name) for page, name in named if name not in known}


def files_of_tests() -> list[Path]:
    """Return the tests of the repository and of its packages."""
    folders = (
        ROOT / "tests",
        *ROOT.glob("packages/*/tests"),
        *ROOT.glob("integrations/*/tests"),
    )
    return [path for folder in folders for path in folder.rglob("*.py")]


def paper_points() -> list[dict[str, Any]]:
    return tomllib.loads((ROOT / "docs" / "reference" / "paper.toml").read_text())[
        "point"
    ]


def test_the_page_about_the_paper_is_what_its_points_make() -> None:
    spec = importlib.util.spec_from_file_location(
        "paper_page", ROOT / "scripts" / "paper_page.py"
    )
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    page = script.PAGE.read_text()
    assert script.written(page) == page, "run python scripts/paper_page.py"
    numbers = [point["number"] for point in paper_points()]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.parametrize(
    "point",
    [p for p in paper_points() if p.get("run")],
    ids=lambda point: str(point["number"]),
)
def test_each_cheap_command_of_the_page_about_the_paper_runs(
    point: dict[str, Any],
) -> None:
    for words in re.findall(r"`tactophone ([^`]+)`", point["command"]):
        assert main(shlex.split(words)) == 0


def test_quick_rows_of_the_page_about_the_paper_can_be_run() -> None:
    """`make paper-rows` runs them: each has a command, and no placeholder is left."""
    script = runpy.run_path(str(ROOT / "scripts" / "run_paper_rows.py"))
    points = script["quick_points"]()
    assert len(points) >= 20
    inputs = {name: Path("made") for name in ("DIR", "FILE", "HEIGHTS.npz")}
    for point in points:
        commands = script["commands_of"](point, inputs, Path("out"))
        assert commands, point["number"]
        words = [word for command in commands for word in command]
        left = [
            word for word in words if re.fullmatch(r"[A-Z][A-Z.-]+(npz|onnx|pt)?", word)
        ]
        assert not left, (point["number"], left)


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install the plug-in whose profiles some pages show."""
    install_plugin(tmp_path, monkeypatch)


@pytest.fixture
def guest_verbs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Register the verbs of the packages in integrations."""
    for project in (ROOT / "integrations").glob("*/pyproject.toml"):
        write_metadata(project.parent, tmp_path)
        monkeypatch.syspath_prepend(str(project.parent))
    monkeypatch.syspath_prepend(str(tmp_path))
    all_verbs.cache_clear()
    yield
    all_verbs.cache_clear()


def test_the_command_line_takes_each_command_that_shows_a_point_of_the_paper(
    plugin: None,
) -> None:
    page = (ROOT / "docs" / "reference" / "paper.md").read_text()
    commands = [found.split() for found in re.findall(r"`tactophone ([^`]+)`", page)]
    assert len(commands) > 40
    for words in commands:
        # A usage error would exit.
        assert _parse(words, words[0]).verb == words[0]


def commands_of(page: Path) -> list[list[str]]:
    """Return the words of each call of the program in the page's blocks of code, but
    for those with placeholders."""
    blocks = re.findall(
        r"^```(?:console)?\n(.*?)^```", page.read_text(), flags=re.MULTILINE | re.DOTALL
    )
    calls = re.findall(
        r"(?:^|\s)(?:[./\w]*/)?tactophone ([a-z][^#|&>()\n]+)",
        "\n".join(blocks).replace("\\\n", " "),
    )
    calls = [re.split(r"\s{2,}|;", call)[0] for call in calls]
    return [shlex.split(call) for call in calls if not re.search(r"\.\.\.|\[|{", call)]


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))],
    ids=lambda page: page.name,
)
def test_the_command_line_takes_each_command_that_a_page_shows(
    page: Path, plugin: None, guest_verbs: None
) -> None:
    for words in commands_of(page):
        assert _parse(words, words[0]).verb == words[0], words


def test_the_page_of_what_may_be_tuned_is_fresh() -> None:
    page = ROOT / "docs" / "reference" / "tuning.md"
    fresh = runpy.run_path(str(ROOT / "scripts" / "tuning.py"))["page"]()
    assert page.read_text() == fresh, "run python scripts/tuning.py"
    assert fresh.count("\n| `") > 100


def test_the_readme_begins_with_a_picture_and_two_commands() -> None:
    first_screen, _, _ = (ROOT / "README.md").read_text().partition("\n## ")
    assert "![" in first_screen
    assert "make demo" in first_screen
    assert "make test" in first_screen


def test_every_marked_figure_of_a_page_is_the_measured_one() -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "figures.py"))
    figures = script["values"]()
    marked: set[str] = set()
    for page in script["pages"]():
        text = page.read_text(encoding="utf-8")
        assert script["with_figures"](text, figures) == text, (
            f"{page.relative_to(ROOT)}: run python scripts/figures.py"
        )
        marked |= {mark["name"] for mark in script["MARKED"].finditer(text)}
    assert marked == figures.keys()


def test_no_page_states_a_figure_without_its_mark() -> None:
    """A figure copied by hand stays behind when it is measured again."""
    script = runpy.run_path(str(ROOT / "scripts" / "figures.py"))
    phrases = script["phrases"]()
    assert len(phrases) > 3
    unmarked = [
        f"{page.relative_to(ROOT)}: {found[0]!r} is {name}: mark it"
        for page in script["pages"]()
        for name, phrase in phrases.items()
        for found in phrase.finditer(script["MARKED"].sub("@", page.read_text()))
    ]
    assert not unmarked, "\n".join(unmarked)
    assert phrases["finetune.gain"].search("it gained 17 points of balanced accuracy")


def test_a_page_with_another_figure_would_be_found() -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "figures.py"))
    page = "right in <!--fig:a.b-->0.9<!--/--> of it"
    assert script["with_figures"](page, {"a.b": "0.8"}) == page.replace("0.9", "0.8")
    with pytest.raises(KeyError):
        script["with_figures"](page, {})


def test_the_readme_shows_the_default_models_scores() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for name in ("texture.right", "texture.strokes.rough", "stylus.real.right"):
        assert f"<!--fig:{name}-->" in readme


def test_the_code_of_the_readme_prints_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = (ROOT / "README.md").read_text()
    monkeypatch.chdir(tmp_path)
    words = [
        "simulate",
        "dataset",
        "sound",
        "--objects",
        "0",
        "--takes",
        "wiggle",
        "--seconds",
        "4",
        "--gain",
        "-6",
    ]
    assert main(words) == 0
    (tmp_path / "sound/00-lava-stone/held/wiggle.flac").rename(tmp_path / "finger.wav")
    capsys.readouterr()
    (code,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    exec(code, {"__name__": "readme"})
    printed = capsys.readouterr().out.strip()
    assert f"It prints `{printed}` for a simulated stroke" in readme


@pytest.mark.parametrize("page", ["safety", "threat-model"])
def test_every_promise_and_every_defence_names_what_holds_it_and_that_exists(
    page: str,
) -> None:
    texts = {path: path.read_text() for path in files_of_tests()}
    defined = set(re.findall(r"def (test_\w+)", "".join(texts.values())))
    lines = (ROOT / "docs/reference" / f"{page}.md").read_text().splitlines()
    heads = [
        number
        for number, line in enumerate(lines)
        if line.rstrip().endswith("| test |")
    ]
    assert heads
    for head in heads:
        for line in itertools.takewhile(
            lambda text: text.startswith("|"), lines[head + 2 :]
        ):
            named = re.findall(r"`([^`]+)`", line.rstrip("| ").rpartition(" | ")[2])
            files = [
                name.split("::")[0]
                for name in named
                if name.startswith(
                    ("tests/", "packages/", "benchmarks/", "integrations/")
                )
            ]
            tests = [
                name.rpartition("::")[2]
                for name in named
                if name.rpartition("::")[2].startswith("test_")
            ]
            assert files or tests, line
            for file in files:
                assert (ROOT / file.split()[0]).exists(), file
            for test in tests:
                known = (
                    test in defined
                    or any(path.name == test for path in texts)
                    or test.endswith("_when")
                )
                assert known, f"{test} in: {line}"


def test_every_picture_of_a_page_has_its_words_and_every_picture_is_shown() -> None:
    images = ROOT / "docs" / "images"
    pages = "\n".join(
        path.read_text("utf-8")
        for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    )
    unused = [
        path.name
        for path in images.iterdir()
        if path.suffix != ".json" and path.name not in pages
    ]
    assert unused == []
    drawn = json.loads((images / "words.json").read_text("utf-8"))
    assert drawn.keys() >= {"dashboard.png", "stone-box.png"}
    assert all((images / name).exists() for name in drawn)
