"""Each integration is imported from its own folder, so that the tests need no
installation."""

import sys
from pathlib import Path

for project in sorted(Path(__file__).parent.glob("*/pyproject.toml")):
    sys.path.insert(0, str(project.parent))
