"""Parsers of files and of the page's messages: what another program, or somebody else, may have written."""

import atexit
import io
import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import soundfile

from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings, change, read_settings
from tactophone.faces.web.dashboard import parse_request
from tactophone.faces.web.game_rules import read_results
from tactophone.lab.dataset.read import open_dataset
from tactophone.lab.recording.safe_writer import _read_entry
from tactophone.live.audio.files import FileSource
from tactophone.live.telemetry.layout import FingerState, State
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.net.link.identity import CERTIFICATE_FILE, KEY_FILE, PEERS_FILE, Identity, Peers
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import ModelCard, read_model
from tactophone.signal.perception.models import default_model, model_path

from .target import Run, Target


def _file(name: str, read: Callable[[Path], object]) -> Run:
    """Return a function that writes bytes to a temporary file of this name, with mode 0600, and reads it."""
    folder = Path(tempfile.mkdtemp(prefix="tactophone-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)

    def run(data: bytes) -> None:
        path = folder / name
        path.write_bytes(data)
        path.chmod(0o600)
        read(path)

    return run


def peers() -> tuple[Sequence[bytes], Run]:
    line = f"{Identity.create('robot').fingerprint} robot\n".encode()
    return [line, line * 2], _file(PEERS_FILE, lambda path: Peers.load(path.parent).items())


def identities() -> tuple[Sequence[bytes], Run]:
    folder = Path(tempfile.mkdtemp(prefix="tactophone-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    Identity.create("robot").save(folder)
    files = [(folder / name).read_bytes() for name in (KEY_FILE, CERTIFICATE_FILE)]

    def run(data: bytes) -> None:
        """Replace the key or the certificate, by the first byte."""
        for index, name in enumerate((KEY_FILE, CERTIFICATE_FILE)):
            (folder / name).write_bytes(data[1:] if data[:1] == bytes([index]) else files[index])
        _ = Identity.load(folder).name, Identity.load(folder).fingerprint

    return [bytes([index]) + content for index, content in enumerate(files)], run


def page_requests() -> tuple[Sequence[bytes], Run]:
    messages: list[dict[str, object]] = [
        {"action": "mute"},
        {"action": "ceiling", "value": 0.2},
        {"action": "profile", "text": "paper"},
    ]
    state = State(profiles=("paper",), fingers=(FingerState(ceiling=0.5),))

    def run(data: bytes) -> None:
        for local in (True, False):
            parse_request(data[:4_096].decode(errors="replace"), state, local=local)

    return [json.dumps(message).encode() for message in messages], run


def settings() -> tuple[Sequence[bytes], Run]:
    toml = b'[link]\nport = 48471\npacket_duration = 0.005\nhost = ""\n[rendering]\nceiling = 0.5\nmuted = true\n'
    return [toml], _file("settings.toml", read_settings)


def assignments() -> tuple[Sequence[bytes], Run]:
    def run(data: bytes) -> None:
        change(Settings(), [data.decode(errors="replace")])

    return [b"link.port=48471", b"rendering.ceiling=0.3", b"link.peer=robot"], run


def calibrations() -> tuple[Sequence[bytes], Run]:
    toml = b'made = "2026-01-01"\nsource = "x"\nsample_rate = 48000\nthreshold_dbfs = -50.0\n'
    return [toml], _file("calibration.toml", Calibration.read)


def cards() -> tuple[Sequence[bytes], Run]:
    card = json.loads(read_model(model_path(default_model())).card.to_json())
    small = card | {"training": {}, "scores": {}, "settings": {}}
    return [json.dumps(small).encode()], lambda data: ModelCard.from_json(data.decode(errors="replace"))


def metadata() -> tuple[Sequence[bytes], Run]:
    table = (
        b"file_name,surface,label,channels,take,scenario,session,segments\n"
        b"a.wav,slate,rough,contact|air,long,table,d,0.30-5.17=rough 6-7=none\nsub/b.wav,glass,smooth,contact,,,,\n"
    )
    return [table], _file("metadata.csv", lambda path: open_dataset(path.parent))


def takes() -> tuple[Sequence[bytes], Run]:
    entry = {
        "surface": "slate", "label": "rough", "take": "1", "scenario": "", "session": "", "file": "a.wav",
        "channels": ["contact"], "properties": {},
    }  # fmt: skip
    return [json.dumps(entry).encode()], _file("take.json", _read_entry)


def rounds() -> tuple[Sequence[bytes], Run]:
    return [b'{"player": "a", "right": true}\n', b"{}\n[]\n"], _file("results.jsonl", read_results)


def timelines() -> tuple[Sequence[bytes], Run]:
    head = b"time,touch,roughness,level_dbfs,amplitude,frequency,none,smooth,rough\n"
    return [head + b"0.1,rough,0.7,-20,0.5,60,0.1,0.2,0.7\n"], _file("timeline.csv", read_timeline)


def recordings() -> tuple[Sequence[bytes], Run]:
    seeds = []
    noise = np.random.default_rng(0).standard_normal((400, 2)) * 0.1
    for kind, coding in (
        ("WAV", "PCM_16"),
        ("WAV", "FLOAT"),
        ("FLAC", "PCM_16"),
        ("OGG", "VORBIS"),
        ("AIFF", "PCM_24"),
    ):
        buffer = io.BytesIO()
        soundfile.write(buffer, noise, 48_000, format=kind, subtype=coding)
        seeds.append(buffer.getvalue())

    def read(path: Path) -> None:
        with FileSource(path, block_size=4_096) as source:
            for block in islice(source, 50):
                assert block.samples.dtype == np.float32

    return seeds, _file("take.wav", read)


TARGETS = {
    "peers": Target(peers, (TactophoneError,)),
    "identities": Target(identities, (TactophoneError,)),
    "page_requests": Target(page_requests),
    "settings": Target(settings, (TactophoneError,)),
    "assignments": Target(assignments, (TactophoneError,)),
    "calibrations": Target(calibrations, (TactophoneError,)),
    "cards": Target(cards, (ValueError, KeyError, TypeError)),
    "metadata": Target(metadata, (TactophoneError,)),
    "takes": Target(takes),
    "rounds": Target(rounds),
    "timelines": Target(timelines, (TactophoneError,)),
    "recordings": Target(recordings, (TactophoneError,)),
}
