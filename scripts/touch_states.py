"""Write the states of contact and of a touch into the page about the detector.

python scripts/touch_states.py
"""

import argparse
from pathlib import Path

from tactophone.signal.perception import contact_state, touch_state

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "detector.md"

SECTIONS = {
    "contact states": contact_state.describe,
    "touch states": touch_state.describe,
}
"""What is written between the comments of each name."""


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    page = PAGE.read_text(encoding="utf-8")
    for name, describe in SECTIONS.items():
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        before, _, rest = page.partition(begin)
        _, _, after = rest.partition(end)
        page = f"{before}{begin}\n{describe()}\n{end}{after}"
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
