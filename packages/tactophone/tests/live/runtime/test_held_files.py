"""Files that a run has read are changed or deleted while it goes on."""

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings, change
from tactophone.live.runtime.held_files import HeldFiles, HeldPeers, files_of
from tactophone.live.runtime.supervisor import ProcessInfo, Side, _run
from tactophone.live.telemetry.layout import Fault
from tactophone.net.link.identity import PEERS_FILE, Identity, Peers
from tests.models import write_tiny_model

from .live_system import LiveSystem, eventually


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write_tiny_model(tmp_path / "tiny.onnx", gain=1e3)


def words(files: HeldFiles) -> str:
    return "; ".join(fault.text for fault in files.faults())


def test_a_run_says_that_it_keeps_what_it_read_of_a_changed_file(model: Path) -> None:
    settings = change(Settings(), [f"detector.model={model}"])
    read = files_of(settings)
    files = HeldFiles(read, read)
    assert words(files) == ""
    content = model.read_bytes()
    model.write_bytes(content + b"\0")
    assert words(files).startswith(f"{model} was changed: the run goes on with what it")
    model.unlink()
    assert words(files).startswith(f"{model} is gone: the run goes on with what it")
    model.write_bytes(content)
    assert words(files) == ""


@pytest.mark.parametrize("large", [False, True])
def test_a_pipe_or_a_huge_file_in_the_place_of_a_model_is_not_read(
    large: bool, model: Path
) -> None:
    """Whoever may write to its folder held up the thread that watches the peers."""
    settings = change(Settings(), [f"detector.model={model}"])
    read = files_of(settings)
    files = HeldFiles(read, read)
    model.unlink()
    if large:
        with model.open("wb") as file:
            file.truncate(1 << 40)
    else:
        os.mkfifo(model)
    assert words(files).startswith(f"{model} was changed: the run goes on with what it")


def test_a_file_or_a_name_that_hangs_keeps_no_peer_that_is_trusted_no_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing looked at the peers until the disk of the model, or the name server,
    answered."""
    identity = Identity.create("first")
    Peers({identity.fingerprint: "first"}).save(tmp_path)
    settings = change(Settings(), [f"link.identity={tmp_path}"])
    monkeypatch.setattr("tactophone.live.runtime.supervisor.FILES_INTERVAL", 0.01)
    side = Side(settings, ProcessInfo("test-hangs"), role="operator")
    trusted: list[Peers] = []
    answered = threading.Event()

    def hang() -> Iterator[Fault]:
        answered.wait()
        yield from ()

    monkeypatch.setattr(side._files, "faults", hang)
    side._watch_outside(trusted.append, lambda: list(hang()) and None)
    try:
        Peers({}).save(tmp_path)
        assert eventually(lambda: len(trusted) == 1)
    finally:
        answered.set()
        side.ended.set()


def test_a_process_that_replaces_another_says_that_it_reads_a_changed_file(
    model: Path,
) -> None:
    settings = change(Settings(), [f"detector.model={model}"])
    began = files_of(settings)
    model.write_bytes(model.read_bytes() + b"\0")
    files = HeldFiles(files_of(settings), began)
    assert "uses what it is now: arm only if that is meant" in words(files)


def test_a_calibration_is_watched_too_and_a_name_without_a_file_is_left(
    tmp_path: Path,
) -> None:
    calibration = tmp_path / "mine.toml"
    calibration.write_text("a")
    changes = ["detector.model=nonesuch", f"detector.calibration={calibration}"]
    assert list(files_of(change(Settings(), changes))) == [str(calibration)]


def test_peers_are_read_again_and_kept_while_their_file_is_of_no_use(
    tmp_path: Path,
) -> None:
    first, second = Identity.create("first"), Identity.create("second")
    Peers({first.fingerprint: "first"}).save(tmp_path)
    trusted: list[Peers] = []
    settings = change(Settings(), [f"link.identity={tmp_path}"])
    held = HeldPeers(settings, trusted.append)
    assert list(held.look()) == []
    (tmp_path / PEERS_FILE).write_text("no fingerprint\n")
    (fault,) = held.look()
    assert fault.text.startswith("the run goes on with the peers it knows: 'no' is not")
    (tmp_path / PEERS_FILE).unlink()
    (fault,) = held.look()
    assert "is gone" in fault.text
    assert trusted == []
    Peers({second.fingerprint: "second"}).save(tmp_path)
    assert list(held.look()) == []
    assert [peers.items() for peers in trusted] == [[("second", second.fingerprint)]]


@pytest.mark.realtime
def test_a_machine_that_is_trusted_no_longer_is_cut_off_and_let_in_again(
    tmp_path: Path, model: Path
) -> None:
    system = LiveSystem(tmp_path, model)
    folder = tmp_path / "operator"
    peers = Peers.load(folder)
    with system.both():
        assert eventually(lambda: system.amplitude() > 0.3)
        peers.without("robot").save(folder)
        assert eventually(lambda: system.amplitude() == 0.0)
        assert "listening" in system.snapshot().state.link
        peers.save(folder)
        assert eventually(lambda: system.amplitude() > 0.3, timeout=15.0)


@pytest.mark.realtime
def test_page_and_terminal_say_that_the_model_file_has_changed(
    tmp_path: Path, model: Path
) -> None:
    system = LiveSystem(tmp_path, model)
    with system.both():
        assert eventually(lambda: system.amplitude() > 0.3)
        model.unlink()
        assert eventually(
            lambda: any("is gone" in f.text for f in system.snapshot().state.faults)
        )
        assert eventually(lambda: system.amplitude() > 0.3)


@pytest.mark.realtime
def test_an_operator_whose_name_leads_elsewhere_is_called_there(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = LiveSystem(tmp_path, model)
    found = ["127.0.0.2"]
    monkeypatch.setattr("tactophone.live.runtime.robot.LOOK_UP_INTERVAL", 0.5)
    for module in ("robot", "sessions"):
        monkeypatch.setattr(
            f"tactophone.live.runtime.{module}.resolve",
            lambda host, port: [(found[0], port)],
        )
    with system.both():
        assert not eventually(lambda: system.amplitude() > 0.3, timeout=3.0)
        found[0] = "127.0.0.1"
        assert eventually(lambda: system.amplitude() > 0.3, timeout=15.0)


class NoParent:
    def tell(self, message: object) -> None: ...


def test_a_package_that_was_updated_during_the_run_is_not_mixed_with_the_old() -> None:
    with pytest.raises(TactophoneError, match=r"0\.0\.1 was replaced by .* during the"):
        _run(NoParent(), print, Settings(), ProcessInfo("x"), "0.0.1")
