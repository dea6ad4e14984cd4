"""What a model's card must say of where its training sound came from."""

from tactophone.dataset import Dataset

UNTESTED = "none heard in training; untested, unless a score below names a real set"
"""What a card says of real sound if the training sound was simulated."""


def caveats_of(dataset: Dataset) -> dict[str, str]:
    """Give the entries that a card's scores begin with."""
    return {"real sound": UNTESTED} if _is_simulated(dataset) else {}


def licence_of(dataset: Dataset) -> str:
    """Tell under which licences the sound is, that whoever passes the weights on may know."""
    if _is_simulated(dataset):
        return "BSD-3-Clause, as the package; trained on simulated sound alone"
    told = sorted({one.known("licence") for one in dataset.recordings} - {""})
    if told:
        return f"trained on sound under: {'; '.join(told)}"
    return ""


def _is_simulated(dataset: Dataset) -> bool:
    return all(one.known("source") == "simulated" for one in dataset.recordings)
