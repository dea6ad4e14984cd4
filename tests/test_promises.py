"""A promise whose test was skipped is named, with the reason."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.promises import STRICT, Named, Unchecked

DOCS = Path(__file__).parent.parent / "docs"


def test_the_pages_name_files_and_tests() -> None:
    named = Named.read(DOCS)
    assert named.hold("packages/tactophone/tests/live/runtime/test_safety.py")
    assert named.hold(
        "packages/tactophone/tests/live/audio/test_gamepad.py::test_silence_and_a_failing_render_rest_both_motors"
    )
    assert named.hold(
        "packages/x/test_send.py::test_what_one_operator_says_leaves_the_sound_of_the_other_equal_to_the_bit[Goodbye]"
    )
    assert not named.hold("tests/test_promises.py::test_something_else")


def test_a_file_skipped_as_a_whole_is_noted_for_the_one_test_that_is_named() -> None:
    named = Named.read(DOCS)
    assert named.hold("packages/tactophone/tests/live/audio/test_gamepad.py")
    assert not named.hold("packages/tactophone/tests/live/audio/test_stream.py")


def test_ci_lets_no_promise_go_unchecked() -> None:
    """What needs root is skipped for everybody else."""
    workflow = pytest.importorskip("yaml").safe_load(
        (DOCS.parent / ".github" / "workflows" / "test.yml").read_text()
    )
    commands = [step.get("run", "") for step in workflow["jobs"]["root"]["steps"]]
    assert any(
        "sudo" in command and f"{STRICT}=1" in command and ".ci/run" in command
        for command in commands
    )


def test_skips_are_listed_by_their_reason() -> None:
    unchecked = Unchecked(Named(frozenset({"test_a.py"}), frozenset({"test_b"})))
    for nodeid, outcome in (
        ("x/test_a.py::test_1", "skipped"),
        ("x/test_a.py", "skipped"),
        ("x/test_c.py::test_b[1]", "skipped"),
        ("x/test_c.py::test_d", "skipped"),
        ("x/test_a.py::test_2", "passed"),
    ):
        reason = ("file", 1, "Skipped: needs root")
        unchecked.note(SimpleNamespace(nodeid=nodeid, outcome=outcome, longrepr=reason))
    assert unchecked.lines() == [
        "  needs root: x/test_a.py, x/test_a.py::test_1, x/test_c.py::test_b[1]"
    ]


@pytest.mark.slow
@pytest.mark.parametrize("strict", ["", "1"])
def test_a_session_prints_them_and_fails_where_it_must_check_all(
    strict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(STRICT, strict)
    monkeypatch.setenv("TACTOPHONE_RECORDINGS", "")
    # Workers leave the summary to the session that began them; this is a session.
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    # Without evdev the file of the gamepad's promise is skipped as a whole.
    without_evdev = (
        "import sys; sys.modules['evdev'] = None; import pytest; "
        "sys.exit(pytest.main(['-q', "
        "'packages/tactophone/tests/live/audio/test_gamepad.py']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", without_evdev],
        capture_output=True,
        text=True,
        cwd=DOCS.parent,
    )
    assert "promises that no test checked here:" in done.stdout
    assert "test_gamepad.py" in done.stdout
    assert (done.returncode == pytest.ExitCode.TESTS_FAILED) == bool(strict)
