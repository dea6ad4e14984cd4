"""A filter in the kernel that drops foreign datagrams before the process spends time on them (Linux).

It is a program of classic BPF (``man 7 socket``, SO_ATTACH_FILTER) over the datagram with its UDP header of 8 bytes. It
lets pass what may begin a handshake, and of SRTP and SRTCP the peer's streams alone: their SSRC comes from the
handshake, so that nobody who cannot read the traffic guesses it. Whatever passes is authenticated as before.
"""

import contextlib
import ctypes
import socket
import sys
from collections.abc import Collection, Iterator

_SO_ATTACH_FILTER, _SO_DETACH_FILTER = 26, 27
_LOAD_BYTE, _LOAD_WORD, _AND, _JUMP, _JUMP_EQUAL, _JUMP_AT_LEAST, _RETURN = 0x30, 0x20, 0x54, 0x05, 0x15, 0x35, 0x06
_FIRST_BYTE, _SECOND_BYTE, _SSRC_OF_RTCP, _SSRC_OF_RTP = 8, 9, 12, 16
_DTLS_VERSION = 0xFE
"""First byte of every DTLS version; the second byte of a record."""

_WHOLE, _NOTHING = 0xFFFF_FFFF, 0

Instruction = tuple[int, int, int, int]
"""Code, instructions to skip if true and if false, and operand."""


class _Instruction(ctypes.Structure):
    _fields_ = [
        ("code", ctypes.c_ushort),
        ("if_true", ctypes.c_ubyte),
        ("if_false", ctypes.c_ubyte),
        ("operand", ctypes.c_uint32),
    ]


class _Program(ctypes.Structure):
    _fields_ = [("length", ctypes.c_ushort), ("instructions", ctypes.POINTER(_Instruction))]


def set_filter(target: socket.socket, streams: Collection[int], *, handshakes: bool = True) -> None:
    """Let DTLS (with ``handshakes``) and the SSRCs ``streams`` alone pass to a UDP socket; everything without any SSRC.

    Notes
    -----
    Where the system has no such filter, everything passes too: the session refuses the same datagrams, only later.
    """
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError):
        if not streams:
            target.setsockopt(socket.SOL_SOCKET, _SO_DETACH_FILTER, 0)
            return
        program = list(_program(sorted(streams), handshakes=handshakes))
        instructions = (_Instruction * len(program))(*(_Instruction(*each) for each in program))
        # The kernel copies both structures during the call.
        target.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, bytes(_Program(len(program), instructions)))


def _program(streams: Collection[int], *, handshakes: bool) -> Iterator[Instruction]:
    """Yield the filter's instructions. A load beyond the end of a datagram drops it."""
    rtp, compare, dtls = 11, 12, 13 + len(streams)
    drop, accept = dtls + 2, dtls + 3
    handshake = dtls if handshakes else drop

    def skip(index: int, target: int) -> int:
        return target - index - 1

    yield (_LOAD_BYTE, 0, 0, _FIRST_BYTE)
    yield (_JUMP_AT_LEAST, 0, skip(1, drop), 20)  # the ranges of RFC 7983: DTLS from 20 to 63, SRTP from 128 to 191
    yield (_JUMP_AT_LEAST, 0, skip(2, handshake), 64)
    yield (_JUMP_AT_LEAST, 0, skip(3, drop), 128)
    yield (_JUMP_AT_LEAST, skip(4, drop), 0, 192)
    yield (_LOAD_BYTE, 0, 0, _SECOND_BYTE)
    yield (_AND, 0, 0, 0x7F)
    yield (_JUMP_AT_LEAST, 0, skip(7, rtp), 64)  # RTCP from 64 to 95 (RFC 5761 section 4), as `srtp.is_report`
    yield (_JUMP_AT_LEAST, skip(8, rtp), 0, 96)
    yield (_LOAD_WORD, 0, 0, _SSRC_OF_RTCP)
    yield (_JUMP, 0, 0, skip(10, compare))
    yield (_LOAD_WORD, 0, 0, _SSRC_OF_RTP)
    for index, stream in enumerate(streams, compare):
        yield (_JUMP_EQUAL, skip(index, accept), 0, stream)
    yield (_JUMP, 0, 0, skip(dtls - 1, drop))
    yield (_LOAD_BYTE, 0, 0, _SECOND_BYTE)
    yield (_JUMP_EQUAL, skip(dtls + 1, accept), skip(dtls + 1, drop), _DTLS_VERSION)
    yield (_RETURN, 0, 0, _NOTHING)
    yield (_RETURN, 0, 0, _WHOLE)
