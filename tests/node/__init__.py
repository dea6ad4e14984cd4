"""Programs of others, from npm: ``npm install --prefix tests/node``."""

import json
import shutil
from pathlib import Path

import pytest

NODE = Path(__file__).parent
"""Where ``package.json`` is."""

_PACKAGES = json.loads((NODE / "package.json").read_text())["devDependencies"]

needs_node = pytest.mark.skipif(
    shutil.which("node") is None
    or not all((NODE / "node_modules" / name).is_dir() for name in _PACKAGES),
    reason="needs node and its packages: npm install --prefix tests/node",
)
