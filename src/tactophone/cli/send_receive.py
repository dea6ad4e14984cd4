"""``tactophone send``, ``receive`` and ``loopback``: the robot's side, the operator's side, or both on one machine."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from tactophone.cli import audio, live, options, output, page
from tactophone.settings import Settings

if TYPE_CHECKING:
    from tactophone.runtime.supervisor import Supervisor
    from tactophone.runtime.wiring import OpenSource

EXAMPLES = {
    "send": (
        "tactophone send --peer operator.local",
        "tactophone send --peer operator.local --source finger --tip stylus",
        "tactophone send --peer 192.0.2.7:48470 --codec pcm16 --record run.mcap",
    ),
    "receive": (
        "tactophone receive --calibration calibration.toml --dashboard",
        "tactophone receive --actuator portaudio:DualSense --profile dualsense --ceiling 0.3",
        "tactophone receive --settings operator.toml --record run.csv --bridge foxglove",
    ),
    "loopback": (
        "tactophone loopback --source finger --actuator none --dashboard",
        "tactophone loopback --source file:stroke.wav --actuator file:vibration.wav --network wifi",
        "tactophone loopback --source finger --actuator none --duration 1",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    live.add_arguments(parser, parser.get_default("verb"))


def run(args: argparse.Namespace) -> int:
    """Run one side or both until interrupted, or until the sound ends."""
    settings = options.settings_of(args)
    if args.verb == "loopback":
        settings = audio.for_one_microphone(settings)
    name = settings.process.name or args.verb
    if args.verb == "receive":
        from tactophone.runtime.operator import run_operator
        from tactophone.runtime.supervisor import Supervisor, supervised

        operator = Supervisor(run_operator, settings, name=name, report=output.note)
        return live.follow(args, settings, supervised(operator), name)
    open_source, microphone = audio.source_of(settings, page=page.wanted(args, settings))
    if args.verb == "loopback":
        sides = both_sides(settings, name=name, open_source=open_source)
        return live.follow(args, settings, sides, name, microphone=microphone)
    from tactophone.runtime.robot import run_robot
    from tactophone.runtime.supervisor import Supervisor, supervised

    main = partial(run_robot, open_source=open_source)
    robot = Supervisor(main, settings, name=name, report=output.note)
    return live.follow(args, settings, supervised(robot), name, microphone=microphone)


@contextmanager
def both_sides(
    settings: Settings, *, name: str, open_source: "OpenSource | None" = None
) -> "Iterator[Sequence[Supervisor]]":
    """Run operator and robot, in this order, as two processes with fresh keys and the simulated network between them.

    ``open_source`` replaces the way in which the settings' source is opened.
    """
    from tactophone.runtime.operator import run_operator
    from tactophone.runtime.pairing import pair_on_one_machine, temporary_keys
    from tactophone.runtime.priority import prioritize_thread
    from tactophone.runtime.robot import run_robot
    from tactophone.runtime.supervisor import Supervisor, supervised

    simulated = settings.simulation
    with temporary_keys() as folder, ExitStack() as stack:
        robot, operator = pair_on_one_machine(settings, folder, name=name)
        receive = partial(run_operator, robot=robot.process.name)
        receiving = Supervisor(receive, operator, name=name, report=output.note)
        if simulated.network != "clean":
            from tactophone.simulation.network import ImpairmentProxy, network_profile

            # The simulated network stands in front of the operator's port.
            prepare, profile = partial(prioritize_thread, operator.process.priority), network_profile(simulated.network)
            proxy = ImpairmentProxy(("127.0.0.1", operator.link.port), profile, seed=simulated.seed, prepare=prepare)
            robot = replace(robot, link=replace(robot.link, port=stack.enter_context(proxy).address[1]))
        send = partial(run_robot, open_source=open_source or audio.open_source)
        sending = Supervisor(send, robot, name=robot.process.name, report=output.note)
        yield stack.enter_context(supervised(receiving, sending))
