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

import numpy as np
import pytest
import soundfile

from tactophone.cli import EXTRAS_OF_VERB, VERBS
from tactophone.core.extras import EXTRA_OF_MODULE
from tests.lab.dataset.folders import audiofolder

ROOT = Path(__file__).parent.parent
INSTALL = re.compile(r"pip install 'tactophone\[([a-z,]+)\]'")

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
    "replay": ["run.mcap"],
    "feel": ["finger.wav"],
    "model": ["show", "paper"],
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
    "export": ["lerobot", "run.mcap", "--with", "set", "--out", "felt"],
}
"""Arguments with which each verb gets past parsing."""

WORKING = {
    "feel",
    "model",
    "status",
    "devices",
    "settings",
    "evaluate",
    "roughness",
    "dataset",
}
"""Verbs that succeed with the core alone."""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``tactophone`` in a fresh environment, from the wheel, without extras."""
    folder = tmp_path_factory.mktemp("package")
    pip = [sys.executable, "-m", "pip", "--quiet"]
    subprocess.run(
        [*pip, "wheel", "--no-deps", "--wheel-dir", folder, ROOT], check=True
    )
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    subprocess.run(
        [*pip, "--python", python, "install", next(folder.glob("*.whl"))], check=True
    )
    return python.with_name("tactophone")


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


@pytest.mark.package
@pytest.mark.parametrize("verb", VERBS)
def test_without_extras_each_verb_works_or_names_the_extra(
    program: Path, folder: Path, verb: str
) -> None:
    helped = subprocess.run(
        [program, verb, "--help"], capture_output=True, text=True, check=False
    )
    assert helped.returncode == 0, helped.stderr
    done = subprocess.run(
        [program, verb, *WORDS[verb]],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == (0 if verb in WORKING else 1), done.stderr
    if verb in EXTRAS_OF_VERB:
        assert len(done.stderr.splitlines()) == 1, done.stderr
        named = INSTALL.findall(done.stderr)[0].split(",")
        assert set(EXTRAS_OF_VERB[verb]) <= set(named)


@pytest.mark.package
def test_the_readmes_install_line_fits_the_wheel(program: Path) -> None:
    line = re.search(
        r"^pip install '\.\[([\w,]+)\]'$",
        (ROOT / "README.md").read_text(),
        re.MULTILINE,
    )
    assert line
    wheel = next(program.parents[2].glob("*.whl"))
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--dry-run",
        "--no-index",
        "--no-deps",
        f"{wheel}[{line[1]}]",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "does not provide the extra" not in done.stderr
    with zipfile.ZipFile(wheel) as opened:
        metadata = next(
            opened.read(name).decode()
            for name in opened.namelist()
            if name.endswith("METADATA")
        )
    assert set(line[1].split(",")) <= set(
        re.findall(r"^Provides-Extra: (.+)$", metadata, re.MULTILINE)
    )


@pytest.mark.slow
def test_every_optional_module_has_its_extra() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    declared = {
        re.split(r"[^\w-]", requirement)[0].lower().replace("_", "-"): extra
        for extra, requirements in extras.items()
        if extra != "all"
        for requirement in requirements
    }
    distributions = packages_distributions()
    for module, extra in EXTRA_OF_MODULE.items():
        for name in distributions.get(
            module, ()
        ):  # Ray, for example, need not be installed here
            assert declared[name.lower().replace("_", "-")] == extra
    assert set(declared.values()) == set(EXTRA_OF_MODULE.values())


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
    (tmp_path / "pyproject.toml").write_bytes((ROOT / "pyproject.toml").read_bytes())
    subprocess.run(
        ["bash", "-ec", step["run"]],
        cwd=tmp_path,
        env={"URL": "https://host/owner/name"},
        check=True,
    )
    urls = tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]["urls"]
    assert urls["Source"] == "https://host/owner/name"
    assert urls["Issues"] == "https://host/owner/name/issues"
    assert urls["Documentation"].startswith("https://host/owner/name/")


def test_the_libraries_of_a_call_are_imported_by_its_own_process_alone() -> None:
    source = Path(__file__).parents[1] / "src/tactophone"
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
