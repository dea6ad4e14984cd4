"""Which tests hold the promises of docs/reference/safety.md and threat-model.md, and
which of them did not run."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PAGES = ("safety", "threat-model")

STRICT = "TACTOPHONE_STRICT_PROMISES"
"""Environment variable; if set, a session fails where a named test was skipped."""

_NAMED = re.compile(r"`(?:(?P<file>[\w./-]*test_\w+\.py)(?:::)?)?(?P<test>test_\w+)?`")


@dataclass(frozen=True, slots=True)
class Named:
    """What the pages name: whole files by their last name, and single tests.

    ``homes`` are the files of the single tests.
    """

    files: frozenset[str]
    tests: frozenset[str]
    homes: frozenset[str] = frozenset()

    @classmethod
    def read(cls, docs: Path) -> "Named":
        files: set[str] = set()
        tests: set[str] = set()
        homes: set[str] = set()
        for page in PAGES:
            text = (docs / "reference" / f"{page}.md").read_text(encoding="utf-8")
            for match in _NAMED.finditer(text):
                file = (match["file"] or "").rpartition("/")[2]
                if match["test"]:
                    tests.add(match["test"])
                    homes.add(file)
                elif file:
                    files.add(file)
        return cls(frozenset(files), frozenset(tests), frozenset(homes - {""}))

    def hold(self, nodeid: str) -> bool:
        """Whether a test, or a file that was skipped as a whole, is named, or the file
        holds a test that is."""
        path, _, test = nodeid.partition("::")
        file = path.rpartition("/")[2]
        if file in self.files:
            return True
        return test.partition("[")[0] in self.tests if test else file in self.homes


@dataclass(slots=True)
class Unchecked:
    """Named tests that a session has skipped, with the reason of each."""

    named: Named
    skipped: dict[str, str] = field(default_factory=dict)

    def note(self, report: Any) -> None:
        """Note a report of a test or of a file, if it says that something named was
        skipped."""
        if (
            report.outcome == "skipped"
            and not hasattr(report, "wasxfail")
            and self.named.hold(report.nodeid)
        ):
            reason = report.longrepr
            text = reason[2] if isinstance(reason, tuple) else str(reason)
            self.skipped[report.nodeid] = text.removeprefix("Skipped: ")

    def lines(self) -> list[str]:
        """Return one line for each reason, with the tests that it skipped."""
        by_reason: dict[str, list[str]] = {}
        for nodeid, reason in self.skipped.items():
            by_reason.setdefault(reason, []).append(nodeid)
        return [
            f"  {reason}: {', '.join(sorted(nodes))}"
            for reason, nodes in sorted(by_reason.items())
        ]
