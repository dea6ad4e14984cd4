"""Sound input of `calibrate` and `record`: a source, or a simulated person who follows the instructions."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from tactophone.cli._support import flags
from tactophone.cli._support.ranges import SEED, Within
from tactophone.settings import change

if TYPE_CHECKING:
    from tactophone.types import AudioBlock, Source

FLAGS = {"--source": "capture.source", "--device": "capture.device", "--tip": "capture.tip"}

GAIN = Within(float, -40, 40, unit="dB")

SETTLING = 0.5
"""Seconds that are discarded after a source is opened and after each instruction."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where the sound comes from."""
    flags.add_settings(parser, FLAGS)
    flags.add_finger(parser)
    group = parser.add_argument_group("with --source finger (in virtual time: minutes take seconds)")
    group.add_argument(
        "--finger-gain", type=GAIN, default=0.0, metavar="DB",
        help="extra gain of the simulated contact microphone, %(type)s",
    )  # fmt: skip
    group.add_argument(
        "--finger-air-gain", type=GAIN, default=0.0, metavar="DB",
        help="the same of the simulated air microphone, %(type)s; a stylus may drive it too far",
    )  # fmt: skip
    group.add_argument(
        "--fault", action="append", default=[], metavar="CODE[@S-S]",
        help="fault of a simulated microphone, always or between two times in s: contact-dead, air-hum@3-5, ...",
    )  # fmt: skip
    group.add_argument(
        "--seed", type=SEED, default=0, metavar="N", help="random seed of the simulated person and set-up, %(type)s"
    )


@dataclass(frozen=True, slots=True)
class SimulatedAct:
    """An instruction for the simulated person: ``rest``, ``stroke``, ``tap`` or ``take``, and its duration in s."""

    verb: str
    duration: float
    take: str = ""


class AudioInput:
    """An open source; a person touching ``object_name`` if it is the simulated finger. A context manager."""

    def __init__(self, args: argparse.Namespace, object_name: str) -> None:
        settings = flags.settings_of(args)
        self.name = settings.capture.source
        self._participant = None
        if self.name == "finger":
            from tactophone.simulation.catalogue import find
            from tactophone.simulation.faults import FaultSpan, FaultySource
            from tactophone.simulation.participant import SimulatedParticipant

            self._participant = SimulatedParticipant(
                find(object_name),
                gain_db=args.finger_gain,
                air_gain_db=args.finger_air_gain,
                seed=args.seed,
                tip=settings.capture.tip,
            )
            faults = [FaultSpan.parse(text) for text in args.fault]
            self.source: Source = FaultySource(self._participant, faults)
        else:
            from tactophone.cli._support.sources import open_source

            self.source = open_source(change(settings, ["capture.loop=false"]))
        self._resources = ExitStack()

    @property
    def simulated(self) -> bool:
        """Whether no real person takes part."""
        return self.name in ("finger", "file")

    def __enter__(self) -> Self:
        self._resources.enter_context(self.source)
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def __iter__(self) -> "Iterator[AudioBlock]":
        return iter(self.source)

    def ask(self, act: SimulatedAct) -> None:
        """Instruct the simulated person, if there is one; a real person reads the screen."""
        if self._participant is None:
            return
        if act.take:
            from tactophone.simulation.takes import TAKES

            self._participant.take(next(take for take in TAKES if take.name == act.take), act.duration)
        elif act.verb == "rest":
            self._participant.rest()
        else:
            {"stroke": self._participant.stroke, "tap": self._participant.tap}[act.verb](act.duration)
