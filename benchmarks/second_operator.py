"""One more operator on this machine for a robot that is paired with one."""

from pathlib import Path

from tactophone.core.settings import Settings, change
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.udp import UdpSocket


def with_operator(
    robot: Settings, operator: Settings, folder: Path, *, name: str
) -> tuple[Settings, Settings]:
    """Return the robot's settings with one more operator, and that operator's;
    ``folder`` holds the keys of both."""
    identity = Identity.create(name)
    identity.save(folder / name)
    Peers.load(folder / "operator").save(folder / name)
    Peers.load(folder / "robot").trusting(name, identity.fingerprint).save(
        folder / "robot"
    )
    with UdpSocket("127.0.0.1") as probe:
        port = probe.address[1]
    called = f"link.peer={robot.link.peer},127.0.0.1:{port}"
    second = [
        f"link.identity={folder / name}",
        f"link.port={port}",
        f"process.name={name}",
    ]
    return change(robot, [called]), change(operator, second)
