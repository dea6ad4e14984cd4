"""Write the states of a touch into the page about the detector.

python scripts/touch_states.py
"""

import argparse
from pathlib import Path

from tactophone.signal.perception.touch_state import describe

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "detector.md"
BEGIN = "<!-- touch states -->\n"
"""Line of the page before what this script writes."""

END = "<!-- end of touch states -->\n"
"""Line of the page after it."""


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n{describe()}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
