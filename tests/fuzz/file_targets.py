"""Parsers of files and of the page's messages: what another program, or somebody else,
may have written."""

import atexit
import contextlib
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
from tactophone.core.hand import each_finger, with_fingers
from tactophone.core.settings import Settings, change, read_settings
from tactophone.core.types import Prediction, Touch
from tactophone.faces.bridges.foxglove import _Viewer
from tactophone.faces.web.dashboard import parse_request
from tactophone.live.audio.files import FileSource
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.net.link.identity import (
    CERTIFICATE_FILE,
    KEY_FILE,
    PEERS_FILE,
    Identity,
    Peers,
)
from tactophone.signal.haptics.limits import Limits, peak_amplitude
from tactophone.signal.haptics.profiles import (
    PROFILES,
    ActuatorResponse,
    open_profile,
    parse_levels,
)
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import ModelCard, read_model
from tactophone.signal.perception.models import default_model, model_path
from tactophone.signal.perception.onnx_table import check_graph
from tactophone_lab.datasets.biotac import import_biotac
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.roughness import measure_heights, read_heights
from tactophone_lab.game.stone_box import read_results
from tactophone_lab.recording.safe_writer import _read_entry
from tactophone_lab.training.recipes import RecipeFile

from .target import Run, Target

ROOT = Path(__file__).parents[2]


def file_run(name: str, read: Callable[[Path], object]) -> Run:
    """Return a function that writes bytes to a temporary file of this name, with mode
    0600, and reads it."""
    folder = Path(tempfile.mkdtemp(prefix="tactophone-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)

    def run(data: bytes) -> None:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        path.chmod(0o600)
        read(path)

    return run


def peers() -> tuple[Sequence[bytes], Run]:
    line = f"{Identity.create('robot').fingerprint} robot\n".encode()
    return [line, line * 2], file_run(
        PEERS_FILE, lambda path: Peers.load(path.parent).items()
    )


def identities() -> tuple[Sequence[bytes], Run]:
    folder = Path(tempfile.mkdtemp(prefix="tactophone-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    Identity.create("robot").save(folder)
    files = [(folder / name).read_bytes() for name in (KEY_FILE, CERTIFICATE_FILE)]

    def run(data: bytes) -> None:
        """Replace the key or the certificate, by the first byte."""
        for index, name in enumerate((KEY_FILE, CERTIFICATE_FILE)):
            (folder / name).write_bytes(
                data[1:] if data[:1] == bytes([index]) else files[index]
            )
        _ = Identity.load(folder).name, Identity.load(folder).fingerprint

    return [bytes([index]) + content for index, content in enumerate(files)], run


def page_requests() -> tuple[Sequence[bytes], Run]:
    messages: list[dict[str, object]] = [
        {"action": "mute"},
        {"action": "ceiling", "value": 0.2},
        {"action": "profile", "text": "paper"},
    ]
    state = RunState(profiles=("paper",), fingers=(FingerState(ceiling=0.5),))

    def run(data: bytes) -> None:
        for local in (True, False):
            parse_request(data[:4_096].decode(errors="replace"), state, local=local)

    return [json.dumps(message).encode() for message in messages], run


def settings() -> tuple[Sequence[bytes], Run]:
    toml = (
        b'[link]\nport = 48471\npacket_duration = 0.005\nhost = ""\n'
        b"[rendering]\nceiling = 0.5\nmuted = true\n"
    )
    return [toml], file_run("settings.toml", read_settings)


def assignments() -> tuple[Sequence[bytes], Run]:
    def run(data: bytes) -> None:
        change(Settings(), [data.decode(errors="replace")])

    return [b"link.port=48471", b"rendering.ceiling=0.3", b"link.peer=robot"], run


def calibrations() -> tuple[Sequence[bytes], Run]:
    toml = (
        b'made = "2026-01-01"\nsource = "x"\n'
        b"sample_rate = 48000\nthreshold_dbfs = -50.0\n"
    )
    return [toml], file_run("calibration.toml", Calibration.read)


def cards() -> tuple[Sequence[bytes], Run]:
    card = json.loads(read_model(model_path(default_model())).card.to_json())
    small = card | {"training": {}, "scores": {}, "settings": {}}
    return [json.dumps(small).encode()], lambda data: ModelCard.from_json(
        data.decode(errors="replace")
    )


def metadata() -> tuple[Sequence[bytes], Run]:
    table = (
        b"file_name,surface,label,channels,take,scenario,session,segments\n"
        b"a.wav,slate,rough,contact|air,long,table,d,0.30-5.17=rough 6-7=none\n"
        b"sub/b.wav,glass,smooth,contact,,,,\n"
    )
    return [table], file_run("metadata.csv", lambda path: open_dataset(path.parent))


def takes() -> tuple[Sequence[bytes], Run]:
    entry = {
        "surface": "slate",
        "label": "rough",
        "take": "1",
        "scenario": "",
        "session": "",
        "file": "a.wav",
        "channels": ["contact"],
        "properties": {},
    }
    return [json.dumps(entry).encode()], file_run("take.json", _read_entry)


def rounds() -> tuple[Sequence[bytes], Run]:
    return [b'{"player": "a", "right": true}\n', b"{}\n[]\n"], file_run(
        "results.jsonl", read_results
    )


def timelines() -> tuple[Sequence[bytes], Run]:
    head = b"time,touch,roughness,level_dbfs,amplitude,frequency,none,smooth,rough\n"
    return [head + b"0.1,rough,0.7,-20,0.5,60,0.1,0.2,0.7\n"], file_run(
        "timeline.csv", read_timeline
    )


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

    return seeds, file_run("take.wav", read)


def heights() -> tuple[Sequence[bytes], Run]:
    roughness = np.random.default_rng(0).standard_normal(4_000) * 1e-6
    plain, packed = io.BytesIO(), io.BytesIO()
    np.save(plain, roughness)
    np.savez_compressed(packed, heights=roughness[:500], step=1e-5)
    runs = [
        file_run(f"heights{ending}", _measure)
        for ending in (".npy", ".npz", ".png", ".csv")
    ]
    seeds = [
        b"\0" + plain.getvalue(),
        b"\1" + packed.getvalue(),
        b"\0" + packed.getvalue(),
    ]
    return [*seeds, b"\3" + "\n".join(map(str, roughness[:300])).encode()], chosen(runs)


def _measure(path: Path) -> None:
    found, step = read_heights(path)
    if found.size < 20_000:
        with contextlib.suppress(ValueError), np.errstate(all="ignore"):
            measure_heights(found, step=step or 1e-5)


def chosen(runs: Sequence[Run]) -> Run:
    """Return a function that gives the input to one of several, by its first byte."""
    return lambda data: runs[data[0] % len(runs)](data[1:]) if data else None


def responses() -> tuple[Sequence[bytes], Run]:
    def run(data: bytes) -> None:
        response = ActuatorResponse(levels=parse_levels(data.decode(errors="replace")))
        for name in PROFILES:
            profile = open_profile(name, response)
            assert 0 <= peak_amplitude(profile) <= 1
            rough = Prediction((0.0, 0.5, 0.5), Touch.ROUGH, 0.5, -20.0, 0.0, 0.2)
            command = Limits().bound(profile.command(rough))
            assert 0 <= command.amplitude <= 0.5
            assert 35 <= command.frequency <= 1000

    return [b"40:-12,160:0,250:-6"], run


def labs() -> tuple[Sequence[bytes], Run]:
    """The published CSV of a BioTac, and the labels of its surfaces."""
    columns = ",".join(f"pac{number}" for number in range(1, 23))
    table = f"{columns}\n" + "\n".join(",".join(["2000"] * 22) for _ in range(30))
    folder = Path(tempfile.mkdtemp(prefix="tactophone-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / "in/slate").mkdir(parents=True)

    def read(place: str) -> Run:
        def run(data: bytes) -> None:
            (folder / "in/slate/a.csv").write_text(table)
            (folder / "in/labels.csv").unlink(missing_ok=True)
            (folder / "in" / place).write_bytes(data)
            import_biotac(folder / "in", folder / "out")

        return run

    labels = b"surface,label\nslate,rough\n"
    return [b"\0" + table.encode(), b"\1" + labels], chosen(
        [read("slate/a.csv"), read("labels.csv")]
    )


def hands() -> tuple[Sequence[bytes], Run]:
    toml = (
        b'[thumb]\ncontact = 1\nair = "system:capture_2"\nprofile = "dualsense"\n'
        b"ceiling = 0.4\n[index]\n"
        b'threshold_dbfs = -34\nport = "x"\nchannel = 2\nmodel = "paper"\n'
    )
    return [toml], file_run(
        "hand.toml", lambda path: each_finger(with_fingers(Settings(), str(path)))
    )


def recipes() -> tuple[Sequence[bytes], Run]:
    seeds = [
        path.read_bytes()
        for path in sorted((ROOT / "examples/recipes").rglob("*.toml"))
    ]
    return seeds or [b"hop = 64\nepochs = 1\n"], file_run(
        "recipe.toml", RecipeFile.read
    )


def graphs() -> tuple[Sequence[bytes], Run]:
    names = [model_path(name).read_bytes() for name in ("paper", default_model())]
    return [names[0][-30_000:], names[1][:60_000]], check_graph


def foxglove_requests() -> tuple[Sequence[bytes], Run]:
    viewer = _Viewer(None, {"a": 1, "b": 2}, {})  # type: ignore[arg-type]
    seeds = [
        b'{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}',
        b'{"op":"unsubscribe","subscriptionIds":[1]}',
    ]
    return seeds, lambda data: viewer.obey(data.decode(errors="replace"))


TARGETS = {
    "heights": Target(heights, (TactophoneError,)),
    "responses": Target(responses, (TactophoneError,)),
    "labs": Target(labs, (TactophoneError,)),
    "hands": Target(hands, (TactophoneError,)),
    "recipes": Target(recipes, (TactophoneError,)),
    "graphs": Target(graphs, (ValueError,)),
    "foxglove_requests": Target(foxglove_requests),
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
