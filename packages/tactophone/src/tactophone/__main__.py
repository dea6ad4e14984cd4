"""``python -m tactophone`` is ``tactophone``."""

import sys

from tactophone.cli import main

if __name__ == "__main__":
    sys.exit(main())
