"""What a page of the docs shows under its commands, and whether they print it.

A command stands in a block of ``console`` behind ``$ tactophone``, or behind a
machine's name, as in ``robot$ tactophone``. Below it stands what it prints:
``[exit 1]`` first where it fails, and ``...`` where only the beginning is shown.
"""

import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

LEFT_OUT = "..."
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")
RULES = re.compile(r"[\s─━]+")
VARIES = {
    "PAGE": re.compile(r"https?://\S+"),
    "FINGERPRINT": re.compile(r"\b[0-9A-F]{2}(?::[0-9A-F]{2}){31}\b"),
    "ADDRESS": re.compile(r"\b\d+\.\d+\.\d+\.\d+(?::\d+)?"),
    "DURATION": re.compile(r"\b(?:\d+\.)?\d+ s, [\d.]+ x real time"),
}
"""What differs each time, by the word that stands for it in a comparison."""


@dataclass(frozen=True, slots=True)
class Example:
    """A command of a page: whose prompt it has, its words after ``tactophone``, what is
    shown below it, and the exit status that the page promises."""

    machine: str
    command: str
    shown: tuple[str, ...]
    exit_code: int = 0

    @property
    def words(self) -> list[str]:
        return shlex.split(self.command, comments=True)

    @property
    def is_cut(self) -> bool:
        """Whether the page shows only the beginning."""
        return "..." in self.shown

    def unlike(
        self,
        printed: Sequence[str],
        same: Callable[[str, str], bool] | None = None,
    ) -> list[str]:
        """Return the lines of the page that the command did not print, or all that it
        printed where only their order or number differs; nothing where both agree, or
        where the page shows nothing."""
        same = same or agree
        if not self.shown or _match(printed, self.shown, same):
            return []
        missing = [
            expected
            for expected in self.shown
            if expected != LEFT_OUT
            and not any(same(line, expected) for line in printed)
        ]
        return missing or list(printed)

    def renewed(self, page: str, printed: Sequence[str]) -> str:
        """Return the page with what the command prints now: above ``...`` its first
        lines, and below its last ones."""
        if not self.shown:
            return page
        lines = list(printed)
        if LEFT_OUT in self.shown:
            above = self.shown.index(LEFT_OUT)
            below = len(self.shown) - above - 1
            lines = [*lines[:above], LEFT_OUT, *lines[len(lines) - below :]]
        head = [f"$ tactophone {self.command}"]
        if self.exit_code:
            head.append(f"[exit {self.exit_code}]")
        before, after = ("\n".join([*head, *end]) for end in (self.shown, lines))
        return page.replace(before, after, 1)


def _match(
    printed: Sequence[str], shown: Sequence[str], same: Callable[[str, str], bool]
) -> bool:
    if not shown:
        return not printed
    if shown[0] == LEFT_OUT:
        return any(
            _match(printed[start:], shown[1:], same)
            for start in range(len(printed) + 1)
        )
    return (
        bool(printed)
        and same(printed[0], shown[0])
        and _match(printed[1:], shown[1:], same)
    )


def examples(page: Path) -> Iterator[Example]:
    """Yield the commands of a page in their order."""
    blocks = re.findall(
        r"```console\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL
    )
    prompt = re.compile(r"^(\w*)\$ tactophone ", flags=re.MULTILINE)
    for block in blocks:
        _, *parts = prompt.split(block)
        for machine, text in zip(parts[::2], parts[1::2], strict=True):
            command, *shown = text.splitlines()
            exit_code = 0
            if shown and (promised := re.fullmatch(r"\[exit (\d)\]", shown[0])):
                exit_code = int(promised[1])
                del shown[0]
            yield Example(machine, command, tuple(shown), exit_code)


def agree(printed: str, shown: str) -> bool:
    """Whether two lines have the same words, and numbers that are close."""
    return agree_in_words(printed, shown) and all(
        _close(*pair)
        for pair in zip(
            NUMBER.findall(_constant(printed)),
            NUMBER.findall(_constant(shown)),
            strict=True,
        )
    )


def agree_in_words(printed: str, shown: str) -> bool:
    """Whether two lines have the same words, and numbers in the same places."""
    words = [
        RULES.sub(" ", NUMBER.sub("#", _constant(line))).strip()
        for line in (printed, shown)
    ]
    return words[0] == words[1]


def _constant(line: str) -> str:
    for word, found in VARIES.items():
        line = found.sub(word, line)
    return line


def _close(printed: str, shown: str) -> bool:
    """Whether two numbers differ by less than a retrained model or another processor
    may."""
    value = abs(float(shown))
    return abs(float(printed) - float(shown)) <= (
        0.08 if "." in shown and value <= 1 else max(4.0, 0.15 * value)
    )
