"""The wheel as a user gets it: installed without extras in a fresh environment, where
every verb must answer."""

import re
import subprocess
import sys
import tomllib
import venv
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

import tactophone
import tactophone_lab.version
from tactophone.cli.verbs import all_verbs
from tactophone.core.extras import REQUIREMENT_OF_MODULE
from tests.folders import audiofolder

ROOT = Path(__file__).parent.parent
INSTALL = re.compile(r"'tactophone(?:-lab)?\[([a-z,]+)\]'")

WORDS = {
    "demo": ["--out", "demo"],
    "pair": ["init", "--identity", "identity"],
    "play": [],
    "loopback": ["--source", "finger", "--actuator", "none", "--duration", "1"],
    "send": ["--peer", "127.0.0.1"],
    "call": [],
    "answer": ["3-escapade-peachy"],
    "receive": ["--actuator", "none", "--duration", "1"],
    "try": ["--duration", "1"],
    "listen": ["--site", "site"],
    "replay": ["run.mcap"],
    "feel": ["finger.wav"],
    "model": ["show", "paper"],
    "check": ["--source", "finger", "--yes"],
    "import-model": ["general.pt"],
    "report": ["--out", "report.txt"],
    "latency": ["--dummy"],
    "status": [],
    "stop": ["nobody"],
    "mute": ["nobody"],
    "arm": ["nobody"],
    "devices": [],
    "settings": [],
    "setup": ["--source", "finger"],
    "record": ["brick", "--label", "rough", "--source", "finger", "--yes"],
    "simulate": ["dataset", "set"],
    "train": ["set", "--out", "new.onnx"],
    "finetune": ["paper", "set", "--general", "set", "--out", "new.onnx"],
    "set-threshold": ["paper", "--data", "set", "--false-bumps", "1"],
    "evaluate": ["paper", "--data", "set"],
    "benchmark": ["--data", "set"],
    "roughness": ["heights.npy", "--pixel", "1e-5"],
    "dataset": ["check", "set"],
    "bench": ["--source", "finger"],
    "fetch": ["cluster", "set", "converted"],
}
"""Arguments with which each verb gets past parsing."""

WORKING = {
    "feel",
    "model",
    "status",
    "devices",
    "report",
    "settings",
    "evaluate",
    "roughness",
    "dataset",
}
"""Verbs that succeed with the core alone."""


PACKAGES = ("tactophone", "tactophone-lab")


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The wheel of each package."""
    folder = tmp_path_factory.mktemp("wheels")
    pip = [sys.executable, "-m", "pip", "--quiet", "wheel", "--no-deps"]
    sources = [ROOT / "packages" / name for name in PACKAGES]
    subprocess.run([*pip, "--wheel-dir", folder, *sources], check=True)
    return {
        name: next(folder.glob(f"{name.replace('-', '_')}-*.whl")) for name in PACKAGES
    }


def installed(folder: Path, *wheels: Path) -> Path:
    """Return ``tactophone`` in a fresh environment with these wheels and what they
    always need."""
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--quiet", "--python", python]
    subprocess.run([*pip, "install", *wheels], check=True)
    return python.with_name("tactophone")


@pytest.fixture(scope="module")
def program(wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both packages, without extras."""
    return installed(tmp_path_factory.mktemp("both"), *wheels.values())


@pytest.fixture(scope="module")
def telephone(
    wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The telephone alone, without extras."""
    return installed(tmp_path_factory.mktemp("telephone"), wheels["tactophone"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with a recording of noise and a small data set."""
    folder = tmp_path_factory.mktemp("work")
    audiofolder(folder / "set")
    soundfile.write(
        folder / "finger.wav",
        np.random.default_rng(0).normal(scale=0.1, size=(24_000, 2)),
        48_000,
    )
    np.save(
        folder / "heights.npy", np.random.default_rng(0).normal(scale=1e-6, size=1000)
    )
    return folder


HELP = """
import sys
from tactophone.cli import main

for verb in sys.argv[1:]:
    try:
        ended = main([verb, "--help"])
    except SystemExit as error:
        ended = error.code
    if ended:
        sys.exit(f"{verb}: {ended}")
"""


@pytest.mark.package
def test_without_extras_each_verb_has_its_help(program: Path) -> None:
    """In one process: a start for each would take longer than all of them."""
    python = program.with_name("python")
    helped = subprocess.run(
        [python, "-c", HELP, *all_verbs()], capture_output=True, text=True, check=False
    )
    assert helped.returncode == 0, helped.stderr
    assert helped.stdout.count("usage: ") == len(all_verbs())


@pytest.mark.package
@pytest.mark.parametrize("verb", all_verbs())
def test_without_extras_each_verb_works_or_names_the_extra(
    program: Path, folder: Path, verb: str
) -> None:
    done = subprocess.run(
        [program, verb, *WORDS[verb]],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == (0 if verb in WORKING else 1), done.stderr
    if needed := all_verbs()[verb].extras:
        assert len(done.stderr.splitlines()) == 1, done.stderr
        named = {
            name for found in INSTALL.findall(done.stderr) for name in found.split(",")
        }
        assert set(needed) <= named


@pytest.mark.package
def test_the_telephone_alone_feels_a_recording(telephone: Path, folder: Path) -> None:
    out = folder / "felt"
    words = ["feel", "finger.wav", "--out", out]
    done = subprocess.run(
        [telephone, *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert list(out.rglob("*.wav"))
    for words in (["train", "set"], ["check", "--source", "finger", "--yes"]):
        done = subprocess.run(
            [telephone, *words], cwd=folder, capture_output=True, text=True
        )
        assert done.returncode == 1
        assert "pip install './packages/tactophone-lab[sim]'" in done.stderr


def test_feeling_loads_nothing_of_the_laboratory() -> None:
    code = (
        "import sys, tactophone.app.feel, tactophone.app.runs, tactophone.app.replay\n"
        "print([name for name in sys.modules if name.startswith('tactophone_lab')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def projects() -> dict[str, dict[str, Any]]:
    """Return the ``pyproject.toml`` of each package."""
    return {
        name: tomllib.loads((ROOT / "packages" / name / "pyproject.toml").read_text())
        for name in PACKAGES
    }


def test_both_packages_have_one_version() -> None:
    assert tactophone.__version__ == tactophone_lab.version.__version__
    (needed,) = projects()["tactophone-lab"]["project"]["dependencies"]
    assert needed == f"tactophone=={tactophone.__version__}"


@pytest.mark.package
def test_the_readmes_install_line_fits_the_wheels(wheels: dict[str, Path]) -> None:
    line = re.search(r"^pip install '\./.*$", (ROOT / "README.md").read_text(), re.M)
    assert line
    wanted = re.findall(r"'\./packages/([\w-]+)\[([\w,]+)\]'", line[0])
    assert {name for name, _ in wanted} == set(PACKAGES)
    for name, extras in wanted:
        with zipfile.ZipFile(wheels[name]) as opened:
            (path,) = (each for each in opened.namelist() if each.endswith("METADATA"))
            metadata = opened.read(path).decode()
        provided = re.findall(r"^Provides-Extra: (.+)$", metadata, re.MULTILINE)
        assert set(extras.split(",")) <= set(provided)


@pytest.mark.slow
def test_every_optional_module_has_its_extra() -> None:
    declared = {
        re.split(r"[^\w-]", requirement)[0].lower().replace("_", "-"): (name, extra)
        for name, project in projects().items()
        for extra, requirements in project["project"]["optional-dependencies"].items()
        if extra != "all"
        for requirement in requirements
        if not requirement.startswith("tactophone[")
    }
    distributions = packages_distributions()
    for module, required in REQUIREMENT_OF_MODULE.items():
        # Ray, for example, need not be installed here.
        for name in distributions.get(module, ()):
            assert declared[name.lower().replace("_", "-")] == required
    assert set(declared.values()) == set(REQUIREMENT_OF_MODULE.values())


def test_a_release_states_where_source_issues_and_documentation_are(
    tmp_path: Path,
) -> None:
    workflow = pytest.importorskip("yaml").safe_load(
        (ROOT / ".github" / "workflows" / "release.yml").read_text()
    )
    (step,) = (
        step
        for step in workflow["jobs"]["build"]["steps"]
        if "URL" in step.get("env", {})
    )
    for name in PACKAGES:
        folder = tmp_path / "packages" / name
        folder.mkdir(parents=True)
        source = ROOT / "packages" / name / "pyproject.toml"
        (folder / "pyproject.toml").write_bytes(source.read_bytes())
    subprocess.run(
        ["bash", "-ec", step["run"]],
        cwd=tmp_path,
        env={"URL": "https://host/owner/name"},
        check=True,
    )
    for name in PACKAGES:
        text = (tmp_path / "packages" / name / "pyproject.toml").read_text()
        urls = tomllib.loads(text)["project"]["urls"]
        assert urls["Source"] == "https://host/owner/name"
        assert urls["Issues"] == "https://host/owner/name/issues"
        assert urls["Documentation"].startswith("https://host/owner/name/")


def test_the_libraries_of_a_call_are_imported_by_its_own_process_alone() -> None:
    source = Path(__file__).parents[1] / "packages/tactophone/src/tactophone"
    users = {
        path.relative_to(source).parent.as_posix()
        for path in source.rglob("*.py")
        if re.search(
            r"^\s*(?:import|from) (?:wormhole|twisted|aioice)\b",
            path.read_text(),
            re.MULTILINE,
        )
    }
    assert users == {"net/call"}
