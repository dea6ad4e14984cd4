"""Programs of others, from npm: ``npm install --prefix tests/node``."""

import shutil
from pathlib import Path

import pytest

NODE = Path(__file__).parent
"""Where ``package.json`` is."""

needs_node = pytest.mark.skipif(
    shutil.which("node") is None or not (NODE / "node_modules").is_dir(),
    reason="needs node and its packages: npm install --prefix tests/node",
)
