"""``tactophone setup --compare``: what it says of two objects."""

from collections.abc import Iterator, Sequence
from typing import Any

from tactophone.app.compare import Comparison
from tactophone.cli import output
from tactophone.core.errors import ConfigError
from tactophone.signal.perception.comparison import LEAST_HEARD

ALMOST_SURE = 0.95
"""Probability from which an order is called almost sure."""


def two_names(given: str, usual: tuple[str, str]) -> tuple[str, str]:
    """Return the names of the two objects to compare; the usual ones where none are
    given."""
    names = [name.strip() for name in given.split(",") if name.strip()]
    if not names:
        return usual
    if len(names) != 2:
        raise ConfigError(
            f"--compare {given!r} names {len(names)} objects, but two are compared: "
            "name them as in --compare slate,glass"
        )
    return names[0], names[1]


def comparison_as_json(found: Comparison, names: Sequence[str]) -> dict[str, Any]:
    """Return what ``setup --compare --json`` prints."""
    objects = [
        {"name": name, "evidence": evidence, "seconds": seconds}
        for name, evidence, seconds in zip(
            names, found.evidence, found.seconds, strict=True
        )
    ]
    return {
        "objects": objects,
        "rougher": None if found.rougher is None else names[found.rougher],
        "certainty": found.certainty,
        "certainty_from": "simulated pairs",
        "notes": found.notes,
    }


def comparison_in_words(
    found: Comparison, names: Sequence[str]
) -> Iterator[output.Part]:
    yield [
        {
            "object": name,
            "touch heard": f"{seconds:.1f} s",
            "evidence for rough": f"{evidence:+.1f}",
        }
        for name, evidence, seconds in zip(
            names, found.evidence, found.seconds, strict=True
        )
    ]
    for note in found.notes:
        yield output.styled("yellow", "note:", f" {note}")
    yield verdict(found, names)


def verdict(found: Comparison, names: Sequence[str]) -> str:
    """Say which is rougher, or that this is not sure and what to do."""
    if not found.heard_enough:
        heard, name = min(zip(found.seconds, names, strict=True))
        return (
            f"not sure which is rougher: {heard:.1f} s of touch was heard on {name}, "
            f"and {LEAST_HEARD:g} s is needed; press harder, or turn the gain up"
        )
    if found.rougher is None:
        return (
            "not sure which is rougher: simulated pairs that differ as little are too "
            "often in the wrong order; to be surer, stroke both again in the same way"
        )
    percent = output.percent(found.certainty)
    sure = "almost surely" if found.certainty >= ALMOST_SURE else "probably"
    return (
        f"rougher: {names[found.rougher]}, {sure}; in {percent} of simulated pairs "
        "that differ as much this order is right"
    )
