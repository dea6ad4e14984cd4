import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import Touch
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Recording
from tactophone.core.types import AudioBlock
from tactophone_lab.datasets.checks import check
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.recording.safe_writer import (
    ENTRY,
    PART,
    TakeWriter,
    recording_in,
    recover,
)

RATE = 48_000
BLOCK = 4800

WRITER = """
import resource, signal, sys
from pathlib import Path
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), int(sys.argv[3])))
sys.path[:0] = sys.argv[4:]
from tests.recording.test_safe_writer import begin, block
take = begin(Path(sys.argv[1]))
for place in range(int(sys.argv[2])):
    take.write(block(place))
    print(take.size, flush=True)
take.finish(quality="good")
print("finished", flush=True)
"""


def begin(root: Path, name: str = "long_light") -> TakeWriter:
    recording = Recording(
        root / "slate" / f"{name}.flac",
        "slate",
        Touch.ROUGH,
        ("contact", "air"),
        take=name,
    )
    return TakeWriter.begin(root, recording, sample_rate=RATE)


def block(place: int) -> AudioBlock:
    """Sound that says which sample it is, exact in 24 bits."""
    numbers = np.arange(place * BLOCK, (place + 1) * BLOCK) / 2**23
    return AudioBlock(
        np.stack([numbers, -numbers], axis=1).astype(np.float32), RATE, place * BLOCK
    )


def writer(
    root: Path, blocks: int, *, most_bytes: int = 1 << 30
) -> "subprocess.Popen[str]":
    """Begin a process that writes a take and says how far it is."""
    command = [
        sys.executable,
        "-c",
        WRITER,
        str(root),
        str(blocks),
        str(most_bytes),
        *sys.path,
    ]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def recovered(root: Path) -> int:
    """Recover what there is; give how many samples, after making sure that they are the
    right ones."""
    list(recover(root))
    (recording,) = open_dataset(root).recordings
    samples, _ = soundfile.read(recording.path)
    whole = np.concatenate(
        [block(place).samples for place in range(len(samples) // BLOCK + 1)]
    )[: len(samples)]
    np.testing.assert_array_equal(samples.astype(np.float32), whole)
    assert [path.name for path in recording.path.parent.iterdir()] == [
        recording.path.name
    ]
    return len(samples)


def test_a_take_becomes_a_lossless_file_and_a_line(tmp_path: Path) -> None:
    take = begin(tmp_path)
    for place in range(10):
        take.write(block(place))
    recording = take.finish(quality="good")
    samples, rate = soundfile.read(recording.path)
    assert (len(samples), rate, soundfile.info(recording.path).subtype) == (
        10 * BLOCK,
        RATE,
        "PCM_24",
    )
    (listed,) = open_dataset(tmp_path).recordings
    assert (listed.surface, listed.take, listed.known("quality")) == (
        "slate",
        "long_light",
        "good",
    )
    assert [path.name for path in recording.path.parent.iterdir()] == [
        "long_light.flac"
    ]


def test_a_manifest_that_was_spoilt_meanwhile_keeps_its_words_and_the_take(
    tmp_path: Path,
) -> None:
    manifest = tmp_path / "metadata.csv"
    take = begin(tmp_path)
    take.write(block(0))
    spoilt = "file_name,surface,label\na.wav,slate,raugh\n"
    manifest.write_text(spoilt)
    with pytest.raises(DatasetError, match=r"'raugh' is not a label.* run the command"):
        take.finish(quality="good")
    assert manifest.read_text() == spoilt
    manifest.write_text(spoilt.replace("raugh", "rough"))
    list(recover(tmp_path))
    first, second = open_dataset(tmp_path).recordings
    assert (first.label, second.known("quality")) == (Touch.ROUGH, "good")


def test_parts_of_a_data_set_stay_in_it_beside_a_take(tmp_path: Path) -> None:
    (tmp_path / "train").mkdir()
    manifest = tmp_path / "train/metadata.csv"
    manifest.write_text("file_name,surface,label\na.wav,slate,rough\n")
    take = begin(tmp_path)
    take.write(block(0))
    take.finish()
    first, second = open_dataset(tmp_path).recordings
    assert (first.path, first.known("split")) == (tmp_path / "train/a.wav", "train")
    assert second.take == "long_light"


def test_what_is_noted_of_a_take_survives_a_kill(tmp_path: Path) -> None:
    take = begin(tmp_path)
    take.note(gaps="0.100+0.050")
    for place in range(5):
        take.write(block(place))
    take._await_flush()
    list(recover(tmp_path))
    (listed,) = open_dataset(tmp_path).recordings
    assert listed.known("gaps") == "0.100+0.050"
    assert "cut off" in listed.known("quality")


def test_a_flush_that_fails_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: Path) -> None:
        raise OSError(5, "Input/output error")

    take = begin(tmp_path)
    monkeypatch.setattr("tactophone_lab.recording.safe_writer.flush_to_disk", fail)
    for place in range(5):
        take.write(block(place))
    with pytest.raises(DatasetError, match=r"Input/output error.* is kept"):
        take.finish()
    assert recovered(tmp_path) == 5 * BLOCK


@pytest.mark.slow
@pytest.mark.parametrize("killed_after", [1, 7, 38])
def test_a_kill_loses_less_than_a_second(tmp_path: Path, killed_after: int) -> None:
    process = writer(tmp_path, 200)
    assert process.stdout is not None
    for _ in range(killed_after):
        written = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert recovered(tmp_path) > written - RATE
    assert "cut off after" in open_dataset(tmp_path).recordings[0].known("quality")


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.002, 0.01, 0.03, 0.08])
def test_a_kill_while_the_take_is_finished_loses_nothing(
    tmp_path: Path, delay: float
) -> None:
    process = writer(tmp_path, 60)
    assert process.stdout is not None
    for _ in range(60):
        process.stdout.readline()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(delay)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert recovered(tmp_path) == 60 * BLOCK


@pytest.mark.slow
def test_a_full_disk_keeps_what_was_written_and_says_so(tmp_path: Path) -> None:
    process = writer(tmp_path, 100, most_bytes=1_000_000)
    printed, errors = process.communicate()
    written = int(printed.split()[-1])
    assert "what was recorded is kept" in errors
    assert recovered(tmp_path) >= written


@pytest.mark.realtime
def test_a_truly_full_file_system_loses_nothing_that_was_written(
    tmp_path: Path,
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)],
        capture_output=True,
    ).returncode:
        pytest.skip("no right to mount a small file system here")
    try:
        printed, errors = writer(disk, 100).communicate()
        assert "Free some space" in errors
        with pytest.raises(DatasetError, match="free some space"):
            list(recover(disk))
        assert (disk / "slate" / f"long_light{PART}").is_file()
        subprocess.run(["mount", "-o", "remount,size=8m", str(disk)], check=True)
        assert recovered(disk) >= int(printed.split()[-1])
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_retake_replaces_the_take_and_its_line(tmp_path: Path) -> None:
    for count in (3, 5, 5):
        take = begin(tmp_path)
        for place in range(count):
            take.write(block(place))
        take.finish(quality=f"of {count}")
    (listed,) = open_dataset(tmp_path).recordings
    assert listed.known("quality") == "of 5"
    assert soundfile.info(listed.path).frames == 5 * BLOCK


@pytest.mark.parametrize("killed", [True, False])
def test_a_retake_that_is_cut_off_replaces_no_longer_take(
    killed: bool, tmp_path: Path
) -> None:
    """A whole take was replaced by the first moment of the next one."""
    for count in (5, 2, 1):
        take = begin(tmp_path)
        for place in range(count):
            take.write(block(place))
        if killed and count < 5:
            take._file.close()
            list(recover(tmp_path))
        else:
            take.finish(quality=f"of {count}")
    folder = tmp_path / "slate"
    found = {path.name: soundfile.info(path).frames for path in folder.iterdir()}
    assert found == {
        "long_light.flac": 5 * BLOCK,
        "long_light-2.flac": 2 * BLOCK,
        "long_light-3.flac": BLOCK,
    }
    first, *_ = listed = open_dataset(tmp_path).recordings
    assert {each.path.name for each in listed} == set(found)
    assert {each.take for each in listed} == {"long_light"}
    assert first.known("quality") == "of 5"


def test_finishing_that_was_cut_off_goes_on_with_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = begin(tmp_path)
    for place in range(2):
        kept.write(block(place))
    kept.finish()
    again = begin(tmp_path)
    again.write(block(0))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("tactophone_lab.recording.safe_writer.add_to_metadata", full)
        with pytest.raises(DatasetError, match="kept"):
            again.finish(quality="good")
    assert [each.path.name for each in recover(tmp_path)] == ["long_light-2.flac"]
    assert len(open_dataset(tmp_path).recordings) == 2


def test_a_file_that_no_manifest_lists_is_not_replaced(tmp_path: Path) -> None:
    take = begin(tmp_path)
    for place in range(2):
        take.write(block(place))
    other = take.recording.path
    soundfile.write(other, np.zeros((9, 1)), RATE)
    before = other.read_bytes()
    assert take.finish().path.name == "long_light-2.flac"
    assert other.read_bytes() == before


def test_a_discarded_take_leaves_the_earlier_one(tmp_path: Path) -> None:
    take = begin(tmp_path)
    for place in range(5):
        take.write(block(place))
    kept = take.finish()
    again = begin(tmp_path)
    again.write(block(1))
    again.discard()
    assert [path.name for path in kept.path.parent.iterdir()] == [kept.path.name]
    assert check(open_dataset(tmp_path)) == ()


def test_takes_of_several_objects_share_one_manifest(tmp_path: Path) -> None:
    for name in ("long_light", "wiggle"):
        take = begin(tmp_path, name)
        take.write(block(0))
        take.finish()
    assert [recording.take for recording in open_dataset(tmp_path).recordings] == [
        "long_light",
        "wiggle",
    ]


def test_an_entry_that_was_cut_off_is_dropped(tmp_path: Path) -> None:
    (tmp_path / "x.part.json").write_text('{"file": "x.fl')
    assert list(recover(tmp_path)) == []
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "slate").write_text("in the way")
    with pytest.raises(DatasetError, match="--out"):
        begin(tmp_path)


def test_two_recorders_never_share_a_folder(tmp_path: Path) -> None:
    """The second took the running take of the first for one that was cut off, and
    removed its sound."""
    program = (
        "import sys; from pathlib import Path; from "
        "tactophone_lab.recording.safe_writer import recording_in\n"
        "with recording_in(Path(sys.argv[1])): print('recording', flush=True); "
        "sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)], stdin=-1, stdout=-1, text=True
    ) as first:
        assert first.stdout
        assert first.stdout.readline() == "recording\n"
        with (
            pytest.raises(DatasetError, match="another `tactophone record`"),
            recording_in(tmp_path),
        ):
            pass
        first.kill()
        first.communicate()
    with recording_in(tmp_path):
        assert list(tmp_path.iterdir()) == []


def test_a_folder_without_recordings_is_not_left_behind(tmp_path: Path) -> None:
    with recording_in(tmp_path / "new"):
        assert (tmp_path / "new").is_dir()
    assert not (tmp_path / "new").exists()


def test_a_disk_that_is_full_while_the_entry_is_rewritten_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    take = begin(tmp_path)
    take.write(block(0))
    entry = take.recording.path.with_suffix(ENTRY)
    before = entry.read_text()
    write_text = Path.write_text

    def full(path: Path, text: str, **options: str) -> int:
        write_text(path, text[:10], **options)
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_text", full)
        with pytest.raises(DatasetError, match="kept"):
            take.finish(quality="good")
    assert entry.read_text() == before
    assert recovered(tmp_path) == BLOCK


@pytest.mark.parametrize(
    "change", [('"file"', '"shape": 5, "file"'), ('"surface"', '"surfice"')]
)
def test_an_entry_of_another_version_is_finished_too(
    change: tuple[str, str], tmp_path: Path
) -> None:
    take = begin(tmp_path)
    take.write(block(0))
    entry = take.recording.path.with_suffix(ENTRY)
    entry.write_text(entry.read_text().replace(*change))
    assert recovered(tmp_path) == BLOCK


@pytest.mark.parametrize("entry", ["{", None])
def test_sound_without_a_readable_entry_stays_and_is_named(
    entry: str | None, tmp_path: Path
) -> None:
    """The next take of that name began by deleting it."""
    take = begin(tmp_path)
    take.write(block(0))
    take.recording.path.with_suffix(ENTRY).unlink()
    if entry:
        take.recording.path.with_suffix(ENTRY).write_text(entry)
    assert list(recover(tmp_path)) == []
    part = take.recording.path.with_suffix(PART)
    sound = part.read_bytes()
    with pytest.raises(DatasetError, match=r"part\.wav: 0\.1 s of a take .* move the"):
        begin(tmp_path)
    assert part.read_bytes() == sound


@pytest.mark.parametrize("ending", [".flac", PART, ENTRY])
@pytest.mark.parametrize("size", [0, 1])
def test_a_take_that_is_finished_reaches_no_file_elsewhere_by_a_link(
    ending: str, size: int, tmp_path: Path
) -> None:
    victim, root = tmp_path / "victim.txt", tmp_path / "takes"
    victim.write_text("mine")
    take = begin(root)
    if size:
        take.write(block(0))
    linked = take.recording.path.with_suffix(ending)
    linked.unlink(missing_ok=True)
    linked.symlink_to(victim)
    with contextlib.suppress(DatasetError):
        list(recover(root))
    assert victim.read_text() == "mine"


def test_no_take_is_written_into_a_folder_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "takes").mkdir()
    (tmp_path / "takes/slate").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DatasetError, match="a link that leaves"):
        begin(tmp_path / "takes")
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize("size", [0, 30])
def test_a_part_that_ends_in_its_header_is_no_take_and_in_nobodys_way(
    size: int, tmp_path: Path
) -> None:
    """Left by a disk that was full at the first sound, it ended each later run."""
    take = begin(tmp_path)
    take._file.close()
    part = take.recording.path.with_suffix(PART)
    part.write_bytes(part.read_bytes()[:size])
    assert list(recover(tmp_path)) == []
    assert list(part.parent.iterdir()) == []


def test_a_part_that_is_no_sound_is_named(tmp_path: Path) -> None:
    take = begin(tmp_path)
    take._file.close()
    take.recording.path.with_suffix(PART).write_bytes(bytes(5000))
    with pytest.raises(DatasetError, match=r"part\.wav: is no sound .* move it away"):
        list(recover(tmp_path))


@pytest.mark.parametrize(
    "crafted",
    [
        {"file": ".."},
        {"file": ""},
        {"file": "a\0b"},
        {"file": "a/b.flac"},
        {"surface": "\ud800"},
        {"channels": [1, 2]},
        {"channels": 1},
        {"properties": [1]},
        {"properties": {"object": ["\ud800"]}},
    ],
    ids=repr,
)
def test_a_crafted_entry_is_left_out_and_writes_nothing(
    crafted: dict[str, object], tmp_path: Path
) -> None:
    entry = begin(tmp_path).recording.path.with_suffix(ENTRY)
    entry.with_suffix("").with_suffix(PART).unlink()
    entry.write_text(json.dumps(json.loads(entry.read_text()) | crafted))
    assert list(recover(tmp_path)) == []
    assert list(entry.parent.iterdir()) == []


def test_a_folder_whose_name_no_sound_file_can_have_is_refused_at_once(
    tmp_path: Path,
) -> None:
    root = tmp_path / os.fsdecode(b"rec\xff")
    with pytest.raises(DatasetError, match="no UTF-8"), recording_in(root):
        pass
    assert not root.exists()


@pytest.mark.parametrize("content", [None, b"", b"RIFF"])
def test_an_empty_take_leaves_the_earlier_one_as_it_is(
    content: bytes | None, tmp_path: Path
) -> None:
    """It took the quality of the earlier one, which was then recorded over."""
    kept = begin(tmp_path)
    kept.write(block(0))
    kept.finish(quality="good")
    part = begin(tmp_path).recording.path.with_suffix(PART)
    if content is None:
        part.unlink()
    else:
        part.write_bytes(content)
    assert recovered(tmp_path) == BLOCK
    assert open_dataset(tmp_path).recordings[0].known("quality") == "good"


def test_an_entry_from_anywhere_writes_over_no_manifest(tmp_path: Path) -> None:
    take = begin(tmp_path)
    take.write(block(0))
    take.finish(quality="good")
    begun = begin(tmp_path, "metadata")
    begun.write(block(0))
    for suffix in (PART, ENTRY):
        path = begun.recording.path.with_suffix(suffix)
        text = path.read_bytes().replace(b"metadata.flac", b"metadata.csv")
        (tmp_path / path.name).write_bytes(text)
    list(recover(tmp_path))
    assert (tmp_path / "metadata.csv").read_text().startswith("file_name,")


def test_a_pipe_in_the_place_of_an_entry_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / f"x{ENTRY}")
    assert list(recover(tmp_path)) == []
