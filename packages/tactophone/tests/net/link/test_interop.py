"""Wireshark parses the packets and GStreamer decodes them. Skipped where they are not
installed."""

import json
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks.virtual_link import VirtualLink, paired_sessions
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.net.link.codec import Codec
from tactophone.net.link.packet import Packet
from tactophone.net.link.stream import (
    BlockEncoder,
    Packetizer,
    Redundancy,
    RedundancyRule,
)

RATE = 48_000
PORT = 48_470
SSRC = 0x5EED

needs_wireshark = pytest.mark.skipif(
    shutil.which("tshark") is None, reason="apt install tshark"
)
needs_gstreamer = pytest.mark.skipif(
    shutil.which("gst-launch-1.0") is None,
    reason="apt install gstreamer1.0-tools gstreamer1.0-plugins-{base,good,bad}",
)


def tone(channels: int) -> FloatArray:
    wave = 0.25 * np.sin(2 * np.pi * 250 * np.arange(RATE) / RATE)
    return np.repeat(wave[:, np.newaxis], channels, axis=1).astype(np.float32)


def packets(codec: Codec, *, depth: int = 0) -> list[Packet]:
    redundancy = Redundancy(RedundancyRule(least=depth, most=depth))
    packetizer = Packetizer(BlockEncoder(codec), ssrc=SSRC, redundancy=redundancy)
    return list(
        map(
            packetizer.packet,
            packetizer.encoder.push(AudioBlock(tone(codec.channels), RATE)),
        )
    )


def write_capture(path: Path, datagrams: list[bytes]) -> None:
    """Write UDP datagrams as Wireshark reads them: a pcap file of bare IPv4 packets
    (link type 101)."""
    with path.open("wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65_535, 101))
        for number, datagram in enumerate(datagrams):
            size = 28 + len(datagram)
            address = bytes([192, 0, 2, 1, 192, 0, 2, 2])
            ip = (
                struct.pack("!BBHHHBBH", 0x45, 0, size, number % 65_536, 0, 64, 17, 0)
                + address
            )
            udp = struct.pack("!HHHH", PORT, PORT, 8 + len(datagram), 0)
            file.write(
                struct.pack("<IIII", number // 200, number % 200 * 5_000, size, size)
                + ip
                + udp
                + datagram
            )


def dissect(path: Path, protocol: str, *fields: str) -> list[dict[str, list[str]]]:
    arguments = [word for field in fields for word in ("-e", field)]
    decode = ["-d", f"udp.port=={PORT},{protocol}"]
    run = subprocess.run(
        ["tshark", "-r", path, *decode, "-T", "json", *arguments],
        capture_output=True,
        check=True,
        timeout=120,
    )
    return [packet["_source"]["layers"] for packet in json.loads(run.stdout)]


@needs_wireshark
def test_wireshark_reads_header_and_redundancy(tmp_path: Path) -> None:
    sent = packets(Codec("opus"), depth=1)[:20]
    write_capture(tmp_path / "red.pcap", [bytes(packet) for packet in sent])
    read = dissect(
        tmp_path / "red.pcap",
        "rtp",
        "rtp.version",
        "rtp.seq",
        "rtp.timestamp",
        "rtp.ssrc",
        "rtp.marker",
        "rtp.p_type",
    )
    assert [int(layers["rtp.seq"][0]) for layers in read] == [
        packet.sequence for packet in sent
    ]
    assert [int(layers["rtp.timestamp"][0]) for layers in read] == [
        packet.payload.timestamp for packet in sent
    ]
    assert {layers["rtp.ssrc"][0] for layers in read} == {f"0x{SSRC:08x}"}
    assert [layers["rtp.marker"][0] in ("1", "True") for layers in read] == [True] + [
        False
    ] * 19
    assert [layers["rtp.p_type"][0] for layers in read[:2]] == ["99", "101"]


@needs_wireshark
def test_wireshark_reads_a_whole_session(tmp_path: Path) -> None:
    robot, operator = paired_sessions(Codec("opus"))
    link = VirtualLink(robot, operator)
    seen: list[bytes] = []
    for session in (robot.members[0].session, operator.session):
        opened = session.outgoing

        def outgoing(opened=opened) -> list:  # type: ignore[no-untyped-def,type-arg]
            fresh = opened()
            seen.extend(datagram for datagram, _ in fresh)
            return fresh

        session.outgoing = outgoing  # type: ignore[method-assign]
    now = link.connect(0.0)
    handshake_size = len(seen)
    link.robot.push(AudioBlock(tone(2)[:2_400], RATE))
    link.carry(now)
    write_capture(tmp_path / "call.pcap", seen)
    handshake = dissect(tmp_path / "call.pcap", "dtls", "dtls.handshake.type")[
        :handshake_size
    ]
    types = [
        kind for layers in handshake for kind in layers.get("dtls.handshake.type", [])
    ]
    assert types[:4] == ["1", "3", "1", "2"]  # hello, verify, hello, server hello
    sealed = dissect(tmp_path / "call.pcap", "rtp", "rtp.p_type")[handshake_size:]
    assert [layers["rtp.p_type"][0] for layers in sealed if "rtp.p_type" in layers][
        :2
    ] == ["99", "101"]


def gstreamer(
    tmp_path: Path, datagrams: list[bytes], caps: str, *stages: str
) -> FloatArray:
    """Let GStreamer read a capture and write the samples that it decodes."""
    write_capture(tmp_path / "stream.pcap", datagrams)
    received = tmp_path / "received.raw"
    source = (
        f"filesrc location={tmp_path / 'stream.pcap'} ! pcapparse "
        f"dst-port={PORT} caps={caps}"
    )
    sink = f"audioconvert ! audio/x-raw,format=F32LE ! filesink location={received}"
    pipeline = " ! ".join([source, *stages, sink])
    subprocess.run(
        ["gst-launch-1.0", "-q", *pipeline.split()],
        check=True,
        capture_output=True,
        timeout=120,
    )
    return np.fromfile(received, np.float32)


@needs_gstreamer
@pytest.mark.parametrize("channels", [1, 2])
def test_gstreamer_reads_pcm(tmp_path: Path, channels: int) -> None:
    codec = Codec("pcm16", channels=channels, packet_size=120)
    caps = (
        f"application/x-rtp,media=audio,clock-rate={RATE},encoding-name=L16,channels={channels},"
        f"encoding-params=(string){channels},payload={codec.kind:d}"
    )
    received = gstreamer(
        tmp_path, [bytes(packet) for packet in packets(codec)], caps, "rtpL16depay"
    )
    np.testing.assert_allclose(
        received.reshape(-1, channels), tone(channels), atol=1e-4
    )


@needs_gstreamer
@pytest.mark.parametrize("channels", [1, 2])
def test_gstreamer_reads_opus(tmp_path: Path, channels: int) -> None:
    codec = Codec("opus", channels=channels)
    mapping = (
        'num_streams=(string)2,coupled_streams=(string)0,channel_mapping=(string)"0,1",'
        if channels == 2
        else ""
    )
    name = "MULTIOPUS" if channels == 2 else "OPUS"
    caps = (
        f"application/x-rtp,media=audio,clock-rate={RATE},encoding-name={name},{mapping}"
        f"encoding-params=(string)2,payload={codec.kind:d}"
    )
    received = gstreamer(
        tmp_path,
        [bytes(packet) for packet in packets(codec)],
        caps,
        "rtpopusdepay",
        "opusdec",
    )
    assert received.std() == pytest.approx(0.25 / np.sqrt(2), rel=0.05)
