"""Writes the golden packets beside this file: one good packet of each shape, one broken
packet for each fault.

Spelled out byte by byte, not with the code under test. Run it by hand when a shape is
added: ``python tests/data/packets/make.py``.
"""

from pathlib import Path

# Opus, packet 7, at 960 samples, stream 42.
HEAD = bytes.fromhex("80 62 0007 000003c0 0000002a")
RED = bytes.fromhex("80 65 0007 000003c0 0000002a")
# More follow; type 98, 240 samples earlier, 2 bytes.
EARLIER = bytes.fromhex("e203c002")

PACKETS = {
    "plain": HEAD + b"sound",
    "marked": bytes([0x80, 0xE2]) + HEAD[2:] + b"sound",
    "one_earlier": RED + EARLIER + b"\x62" + b"ab" + b"sound",
    "two_earlier": RED
    + bytes.fromhex("e2078001")
    + EARLIER
    + b"\x62"
    + b"Z"
    + b"ab"
    + b"sound",
    "contributing_sources": b"\x82" + HEAD[1:] + bytes(8) + b"sound",
    "extension": b"\x90" + HEAD[1:] + bytes.fromhex("bede0001 11223344") + b"sound",
    "padded": b"\xa0" + HEAD[1:] + b"sound" + b"\x00\x00\x03",
    "empty": b"",
    "truncated_header": HEAD[:11],
    "wrong_version": b"\x40" + HEAD[1:] + b"sound",
    "unknown_payload_type": b"\x80\x00" + HEAD[2:] + b"sound",
    "sources_past_the_end": b"\x8f" + HEAD[1:] + b"sound",
    "extension_past_the_end": b"\x90" + HEAD[1:] + bytes.fromhex("bede00ff 11223344"),
    "extension_header_cut": b"\x90" + HEAD[1:] + b"\xbe",
    "padding_of_nothing": b"\xa0" + HEAD[1:] + b"sound\x00",
    "padding_past_the_start": b"\xa0" + HEAD[1:] + b"sound\xff",
    "earlier_header_cut": RED + EARLIER[:3],
    "earlier_past_the_end": RED + EARLIER + b"\x62" + b"a",
    "no_payload_of_its_own": RED + EARLIER,
    "redundancy_within_redundancy": RED
    + bytes.fromhex("e503c002")
    + b"\x62"
    + b"ab"
    + b"sound",
}

if __name__ == "__main__":
    for name, packet in PACKETS.items():
        Path(__file__).with_name(f"{name}.bin").write_bytes(packet)
