"""The time of day is wrong, as on a robot that boots without a network, or is set while
the link is at work."""

import datetime
import os
import subprocess
import sys
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from tactophone.net.link.identity import Identity
from tests.support.kills import WallClock, needs_compiler

from .session_pair import SessionPair, answering, calling

ROOT = Path(__file__).parents[5]
HOUR = 3_600


def dated(name: str, year: int) -> Identity:
    """Return an identity that is valid by date in one year only."""
    key = ec.generate_private_key(ec.SECP256R1())
    title = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    begin = datetime.datetime(year, 1, 1, tzinfo=datetime.UTC)
    builder = (
        x509.CertificateBuilder(
            title, title, key.public_key(), x509.random_serial_number()
        )
        .not_valid_before(begin)
        .not_valid_after(begin + datetime.timedelta(days=365))
    )
    return Identity(key, builder.sign(key, hashes.SHA256()))


@pytest.mark.parametrize(("robots", "operators"), [(1970, 2099), (2099, 1970)])
def test_two_machines_connect_whatever_date_their_certificates_are_from(
    robots: int, operators: int
) -> None:
    robot, operator = dated("robot", robots), dated("operator", operators)
    pair = SessionPair(calling(robot, operator), answering(operator, robot))
    pair.wait(0.1)
    assert pair.robot.peer == "operator"
    assert pair.operator.peer == "robot"


CALLS = """
import sys
from tests.net.link.test_handshake import steps_of_a_call

# For each flight of a handshake, one in the middle of which the clock is set after it.
for flight in range(8):
    sent = []
    call = steps_of_a_call(sent)
    for _ in range(flight + 1):
        ends = next(call)
    print("set the clock", flush=True)
    sys.stdin.readline()
    robot, operator = [ends, *call][-1]
    assert robot.agreement and operator.agreement, flight
    assert len(sent) == 5, (flight, len(sent))
"""
"""Handshakes that wait in the middle until the clock, which OpenSSL reads, is set."""


@needs_compiler
@pytest.mark.parametrize("by", [HOUR, -HOUR])
def test_a_clock_that_is_set_in_a_handshake_neither_ends_it_nor_repeats_a_flight(
    by: int, tmp_path: Path
) -> None:
    clock = WallClock(tmp_path)
    folders = [*ROOT.glob("packages/*/src"), ROOT / "packages" / "tactophone", ROOT]
    paths = {"PYTHONPATH": os.pathsep.join(map(str, folders))}
    with subprocess.Popen(
        [sys.executable, "-c", CALLS],
        env=os.environ | clock.environment | paths,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin
        assert process.stdout
        assert process.stderr
        offset = 0
        for line in process.stdout:
            assert line == "set the clock\n"
            offset += by
            clock.set(offset)
            process.stdin.write("\n")
            process.stdin.flush()
        assert process.wait() == 0, process.stderr.read()
