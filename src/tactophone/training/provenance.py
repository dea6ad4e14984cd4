"""What a model card must say about the origin of the training data."""

from collections.abc import Sequence

from tactophone.dataset import Dataset, Recording

UNTESTED = "none in training; untested, unless a score below names a real set"
"""What a card says about real sound if the training sound was simulated."""


def caveats_of(dataset: Dataset) -> dict[str, str]:
    """Return the entries that a card's scores begin with."""
    return {"real sound": UNTESTED} if _is_simulated(dataset) else {}


def licence_of(dataset: Dataset) -> str:
    """Return the licences of the training sound; whoever distributes the weights needs to know them."""
    if _is_simulated(dataset):
        return "BSD-3-Clause, as the package; trained on simulated sound alone"
    licences = sorted({recording.known("licence") for recording in dataset.recordings} - {""})
    sources = "simulated sound and sound" if any(map(is_simulation, dataset.recordings)) else "sound"
    return f"weights alone, no recordings; trained on {sources} under: {'; '.join(licences)}" if licences else ""


def tip_of(recordings: Sequence[Recording]) -> str:
    """Return the tip that all recordings name; empty if they name none, or several."""
    tips = {recording.known("tip") for recording in recordings}
    return tips.pop() if len(tips) == 1 else ""


def _is_simulated(dataset: Dataset) -> bool:
    return all(map(is_simulation, dataset.recordings))


def is_simulation(recording: Recording) -> bool:
    """Return whether a recording says that it was simulated."""
    return recording.known("source") == "simulated"
