"""Tables of states that run, and how they are shown in the documentation."""

import enum
from collections.abc import Iterable, Mapping
from typing import TypeAlias, TypeVar

State = TypeVar("State", bound=enum.Enum)
Event = TypeVar("Event", bound=enum.Enum)

Table: TypeAlias = Mapping[State, Mapping[Event, State]]
"""For each state and each event that it can meet, the next state."""


def describe_states(states: Iterable[enum.Enum]) -> str:
    """Return a table of states and what each means."""
    rows = [f"| {name_of(state)} | {state.value} |" for state in states]
    return "\n".join(["| state | what it means |", "|---|---|", *rows]) + "\n"


def describe_table(table: Mapping[State, Mapping[Event, State]]) -> str:
    """Return the states of a table, a drawing of its changes, and what each event
    is."""
    events = {event for changes in table.values() for event in changes}
    kind = type(next(iter(events)))
    meanings = [f"| {name_of(event)} | {event.value} |" for event in kind]
    return "\n".join(
        [
            describe_states(table),
            *drawing(table),
            "",
            "| event | when |",
            "|---|---|",
            *meanings,
            "",
        ]
    )


def drawing(table: Mapping[State, Mapping[Event, State]]) -> list[str]:
    """Return the lines of a Mermaid drawing of all changes of state; the first state of
    the table is the one that it begins in."""
    lines = ["```mermaid", "stateDiagram-v2"]
    lines.append(f"    [*] --> {name_of(next(iter(table)))}")
    for state, changes in table.items():
        for event, after in changes.items():
            if after is not state:
                change = f"{name_of(state)} --> {name_of(after)}"
                lines.append(f"    {change}: {name_of(event)}")
    return [*lines, "```"]


def name_of(state: enum.Enum) -> str:
    """Return the name of a state or an event as it stands in the documentation.

    >>> name_of(enum.Enum("Level", ["OPENS_SOON"]).OPENS_SOON)
    'opens soon'
    """
    return state.name.lower().replace("_", " ")
