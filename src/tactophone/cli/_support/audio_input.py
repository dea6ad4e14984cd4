"""What `calibrate` and `record` share: whose sound they hear, and the simulated person who may do what they ask."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from tactophone import config
from tactophone.cli._support import flags, sources
from tactophone.types import AudioBlock, Source

FLAGS = {"--source": "capture.source", "--device": "capture.device"}

SETTLING = 0.5
"""Seconds after a source begins, or an instruction is given, in which nothing is listened to."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where the sound comes from."""
    flags.add_settings(parser, FLAGS)
    group = parser.add_argument_group("with --source finger (in virtual time: minutes take seconds)")
    group.add_argument(
        "--finger-gain", type=float, default=0.0, metavar="DB",
        help="turn the simulated contact microphone's gain, -40 to 40 dB",
    )  # fmt: skip
    group.add_argument(
        "--fault", action="append", default=[], metavar="CODE[@S-S]",
        help="break a simulated microphone, for ever or from one second to another: contact-dead, air-hum@3-5, ...",
    )  # fmt: skip
    group.add_argument("--seed", type=int, default=0, metavar="N", help="of the simulated person and set-up")


@dataclass(frozen=True, slots=True)
class SimulatedAct:
    """Something that a person is asked to do: a verb of the simulated one, and for how long, in s."""

    verb: str
    duration: float
    take: str = ""


class AudioInput:
    """A source that was opened, with or without somebody simulated to move the finger; a context manager."""

    def __init__(self, args: argparse.Namespace, thing: str) -> None:
        settings = flags.settings_of(args)
        self.name = settings.capture.source
        self._volunteer = None
        if self.name == "finger":
            from tactophone.simulation import find
            from tactophone.simulation.participants.participant import SimulatedParticipant
            from tactophone.simulation.physics.sensor_faults import FaultSpan, FaultySource

            self._volunteer = SimulatedParticipant(find(thing), gain_db=args.finger_gain, seed=args.seed)
            faults = [FaultSpan.parse(text) for text in args.fault]
            self.source: Source = FaultySource(self._volunteer, faults)
        else:
            self.source = sources.open_source(config.change(settings, ["capture.loop=false"]))
        self._resources = ExitStack()

    @property
    def simulated(self) -> bool:
        """Whether nobody has to be waited for."""
        return self.name in ("finger", "file")

    def __enter__(self) -> Self:
        self._resources.enter_context(self.source)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._resources.close()

    def __iter__(self) -> Iterator[AudioBlock]:
        return iter(self.source)

    def ask(self, act: SimulatedAct) -> None:
        """Have the simulated person do something; a real one reads it from the screen."""
        if self._volunteer is None:
            return
        if act.take:
            from tactophone.simulation import TAKES

            self._volunteer.take(next(take for take in TAKES if take.name == act.take), act.duration)
        elif act.verb == "rest":
            self._volunteer.rest()
        else:
            {"stroke": self._volunteer.stroke, "tap": self._volunteer.tap}[act.verb](act.duration)
