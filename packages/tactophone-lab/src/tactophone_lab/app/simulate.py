"""``tactophone simulate``: recordings of the simulated finger, planned first and then
rendered."""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tactophone.core.errors import ConfigError
from tactophone.core.recordings.metadata import add_to_metadata, read_to_rewrite
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import ignore
from tactophone_lab.simulation.catalogue import (
    PAPER,
    SimulatedObject,
    catalogue,
    find,
)
from tactophone_lab.simulation.competition import (
    DAYS,
    TASKS,
    CompetitionRun,
    run_recording,
    write_run,
)
from tactophone_lab.simulation.random_objects import MOST_OBJECTS, draw_objects
from tactophone_lab.simulation.recording_levels import electronics
from tactophone_lab.simulation.render import (
    RenderJob,
    RenderOptions,
    plan_dataset,
    render_dataset,
    write_manifest,
)
from tactophone_lab.simulation.takes import Take


@dataclass(frozen=True, slots=True)
class RenderedSet:
    """How much of a planned data set is finished."""

    folder: Path
    finished: int
    planned: int
    seconds: float
    """How long this rendering took."""


def objects_named(names: str) -> list[SimulatedObject]:
    """Return the objects of a text: numbers or names separated by commas, ``paper``,
    ``all``, or ``random:COUNT:SEED`` for as many that are drawn.

    Raises `ConfigError` for an unknown one.
    """
    if names.startswith("random"):
        return _random_objects(names)
    if names == "all":
        return list(catalogue())
    if names == "paper":
        return [obj for obj in catalogue() if obj.number in PAPER]
    return [find(name.strip()) for name in names.split(",")]


def _random_objects(names: str) -> list[SimulatedObject]:
    matched = re.fullmatch(r"random:(\d{1,4}):(\d{1,9})", names)
    count = int(matched[1]) if matched else 0
    if not matched or not 0 < count <= MOST_OBJECTS:
        raise ConfigError(
            f"objects {names!r}: wanted random:COUNT:SEED with a COUNT of 1 to "
            f"{MOST_OBJECTS}, such as random:48:7"
        )
    return list(draw_objects(count, int(matched[2])))


def plan_recordings(
    objects: Sequence[SimulatedObject],
    takes: Sequence[Take],
    options: RenderOptions,
    *,
    scenarios: bool = False,
) -> tuple[RenderJob, ...]:
    """Plan the recordings of a data set; raises `ConfigError` if the authors' layout
    cannot name them, if their levels say nothing of the tip, or if a sound in the room
    is silent, and `DatasetError` if that is no sound."""
    electronics(options.levels, hall=options.hall, tip=options.tip)
    if options.room_sound:
        options.room_sound.check()
    if options.authors_layout:
        _check_layout(options.tip)
        if scenarios or any(obj.number not in PAPER for obj in objects):
            raise ConfigError(
                "the authors' layout has objects 00 to 22 and no scenarios; omit "
                "--scenarios and others"
            )
    return plan_dataset(objects, options, scenarios=scenarios, takes=takes)


def render_recordings(
    folder: Path,
    plan: Sequence[RenderJob],
    *,
    processes: int = 1,
    finish: Callable[[RenderedSet], None] = ignore,
    report: Callable[[RenderJob], None] = ignore,
) -> RenderedSet:
    """Render what is missing of a plan, and write the manifest.

    - ``finish``: called at the end, also after an interruption; the manifest then lists
      what is finished.
    - ``report``: called with each recording when it is finished.
    """
    began = time.monotonic()
    try:
        for job in render_dataset(folder, plan, processes=processes):
            report(job)
    finally:
        finished = write_manifest(folder, plan)
        seconds = time.monotonic() - began
        rendered = RenderedSet(folder, finished, len(plan), seconds)
        finish(rendered)
    return rendered


def plan_competition(
    runs: int,
    *,
    task: str = "box",
    seed: int = 0,
    tip: str = DEFAULT_TIP,
    authors_layout: bool = False,
    opus: bool = False,
) -> list[CompetitionRun]:
    """Plan a number of runs a day over five stones; raises `ConfigError` for a tip that
    the authors' layout or the task's levels do not have."""
    if authors_layout:
        _check_layout(tip)
    electronics(TASKS[task].levels, hall=True, tip=tip)
    return [
        CompetitionRun(day, number, seed, tip, TASKS[task], opus)
        for day in DAYS
        for number in range(1, runs + 1)
    ]


def render_competition(
    folder: Path,
    runs: Sequence[CompetitionRun],
    *,
    bits: int = 16,
    report: Callable[[CompetitionRun], None] = ignore,
) -> None:
    """Render each run, and add it to the manifest with the truth over time.

    Raises `DatasetError` if a manifest that is there could not be written again.
    """
    read_to_rewrite(folder)
    for run in runs:
        write_run(folder, run, bits=bits)
        report(run)
    add_to_metadata(folder, [run_recording(folder, run) for run in runs])


def _check_layout(tip: str) -> None:
    if tip != DEFAULT_TIP:
        raise ConfigError(
            f"--tip {tip}: the authors' layout needs their finger, tip {DEFAULT_TIP}; "
            "omit one of them"
        )
