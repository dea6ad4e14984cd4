"""Labels that a person adds to a published data set, which has none of its own."""

from dataclasses import dataclass
from pathlib import Path

from tactophone.core.recordings.metadata import parse_label, rows
from tactophone.core.recordings.values import LABEL_NAMES, Problem, Recording
from tactophone.core.types import Touch

LABELS = "labels.csv"
"""Name of the file in the published folder, with the columns ``surface`` and
``label``."""


@dataclass(frozen=True, slots=True)
class ImportedSet:
    """Recordings made from a published data set, and the files that were left out."""

    recordings: tuple[Recording, ...]
    problems: tuple[Problem, ...]

    @property
    def labelled(self) -> bool:
        """Whether any recording has a label."""
        return any(recording.label is not None for recording in self.recordings)


def read_labels(path: Path, problems: list[Problem]) -> dict[str, Touch | None]:
    """Return the label of each surface of a ``labels.csv``, none if there is no such
    file."""
    if not path.is_file():
        return {}
    return {
        row["surface"]: LABEL_NAMES[
            parse_label(row["label"], path=path, problems=problems)
        ]
        for _, row in rows(path, required=("surface", "label"))
    }
