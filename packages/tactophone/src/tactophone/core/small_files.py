"""Files that a person writes and others hand on, such as settings: how many bytes of
them are read."""

from pathlib import Path


def read_small(path: Path, most: int) -> bytes:
    """Return the content of a file of ``most`` bytes at most.

    Whoever parses it may take time with the square of its size. Raises `OSError` if it
    cannot be read, and `ValueError`, which says what was found and wanted, if it is
    larger.
    """
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        size = path.stat().st_size
        found = f"{size} bytes" if size > most else f"over {most} bytes"
        raise ValueError(f"{found}, but at most {most} are read")
    return content
