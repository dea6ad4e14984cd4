"""Our dissector in tshark, and our encryption read by GStreamer's SRTP. Skipped where
they are not installed."""

import json
import math
import socket
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactophone.core.types import FloatArray, Prediction, Touch
from tactophone.net.link.codec import Codec
from tactophone.net.link.handshake import KEY_SIZE, SALT_SIZE, Secrets
from tactophone.net.link.packet import PayloadType, write_prediction, write_predictions
from tactophone.net.link.session import SrtpCrypto
from tactophone.net.link.stream import (
    BlockEncoder,
    Packetizer,
    Redundancy,
    RedundancyRule,
)
from tests.live.runtime.live_system import eventually
from tests.net.link.test_interop import (
    PORT,
    RATE,
    SSRC,
    needs_gstreamer,
    needs_wireshark,
    packets,
    tone,
    write_capture,
)

LUA = Path(__file__).parents[5] / "docs" / "reference" / "tactophone.lua"

PREDICTIONS = [
    Prediction((0.1, 0.2, 0.7), Touch.ROUGH, 0.75, -20.5, 1.0, 1.256),
    Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, 2.0, 2.256, faulty=True),
]


@needs_wireshark
def test_the_dissector_reads_predictions(tmp_path: Path) -> None:
    packetizer = Packetizer(
        BlockEncoder(Codec("opus")), ssrc=SSRC, redundancy=Redundancy(RedundancyRule())
    )
    sent = [
        bytes(
            packetizer.wrap(
                PayloadType.PREDICTION, round(each.end * RATE), write_prediction(each)
            )
        )
        for each in PREDICTIONS
    ]
    kind, hand = write_predictions(dict(enumerate(PREDICTIONS)), fingers=5)
    sent.append(bytes(packetizer.wrap(kind, 0, hand)))
    first, second, together, cut = dissected(tmp_path / "a.pcap", [*sent, sent[0][:-3]])
    found = first["tactophone"]
    assert found["tactophone.touch"] == "2"
    assert float(found["tactophone.rough"]) == pytest.approx(0.7, abs=1e-4)
    assert float(found["tactophone.level_dbfs"]) == pytest.approx(-20.5)
    assert float(found["tactophone.window"]) == pytest.approx(0.256)
    assert float(second["tactophone"]["tactophone.level_dbfs"]) == -math.inf
    assert second["tactophone"]["tactophone.faulty"] in ("1", "True")
    assert together["tactophone"]["tactophone.fingers"] == ["5", "5"]
    assert together["tactophone"]["tactophone.finger"] == ["0", "1"]
    assert together["tactophone"]["tactophone.touch"] == ["2", "0"]
    assert "not 16 bytes" in json.dumps(cut)
    assert len(LUA.read_text().splitlines()) <= 100


def dissected(path: Path, datagrams: list[bytes]) -> list[dict[str, Any]]:
    """Write packets to a capture, and return what Wireshark with our dissector finds in
    each, by layer."""
    write_capture(path, datagrams)
    done = subprocess.run(
        [
            "tshark",
            "-X",
            f"lua_script:{LUA}",
            "-r",
            str(path),
            "-T",
            "json",
            "--no-duplicate-keys",
            "-d",
            f"udp.port=={PORT},rtp",
        ],
        capture_output=True,
        check=True,
        timeout=120,
    )
    return [packet["_source"]["layers"] for packet in json.loads(done.stdout)]


def decrypted_by_gstreamer(
    folder: Path, datagrams: list[bytes], caps: str
) -> FloatArray:
    """Send datagrams to GStreamer over UDP; return the samples that it decrypts.

    From a file it would crash: srtpdec of 1.22 decrypts in place, which pcapparse's
    buffers do not allow.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    received = folder / "received.raw"
    source = (
        f"udpsrc address=127.0.0.1 port={port} num-buffers={len(datagrams)} "
        f"buffer-size=2000000 caps={caps}"
    )
    sink = (
        "audioconvert ! audio/x-raw,format=F32LE ! filesink sync=false "
        f"location={received}"
    )
    pipeline = f"{source} ! srtpdec ! rtpL16depay ! {sink}".split()
    with subprocess.Popen(
        ["gst-launch-1.0", "-q", *pipeline], stderr=subprocess.DEVNULL
    ) as process:
        assert eventually(
            lambda: f":{port:04X} " in Path("/proc/net/udp").read_text(), timeout=20
        )
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
            for datagram in datagrams:
                sending.sendto(datagram, ("127.0.0.1", port))
        assert process.wait(60) == 0
    return np.fromfile(received, np.float32)


@needs_gstreamer
@pytest.mark.realtime
def test_gstreamer_decrypts_what_we_encrypt(tmp_path: Path) -> None:
    key = bytes(range(KEY_SIZE + SALT_SIZE))
    crypto = SrtpCrypto(Secrets(key, bytes(KEY_SIZE + SALT_SIZE), SSRC, SSRC + 1))
    codec = Codec("pcm16", channels=1, packet_size=120)
    sealed = [crypto.protect(bytes(packet)) for packet in packets(codec)]
    cipher = "(string)aes-256-gcm"
    caps = (
        f"application/x-srtp,media=(string)audio,clock-rate=(int){RATE},encoding-name=(string)L16,channels=(int)1,"
        f"encoding-params=(string)1,payload=(int){codec.kind:d},ssrc=(uint){SSRC},roc=(uint)0,"
        f"srtp-key=(buffer){key.hex()},srtp-cipher={cipher},srtp-auth=(string)null,srtcp-cipher={cipher},"
        "srtcp-auth=(string)null"
    )
    received = decrypted_by_gstreamer(tmp_path, sealed, caps)
    np.testing.assert_allclose(received[:, np.newaxis], tone(1), atol=1e-4)
    # One changed bit in each packet: the other implementation refuses all of them.
    forged = [packet[:-1] + bytes([packet[-1] ^ 1]) for packet in sealed]
    assert not len(decrypted_by_gstreamer(tmp_path, forged, caps))
