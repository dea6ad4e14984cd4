"""Assemble the page that listens: ``python examples/browser/build.py [FOLDER]``, then
serve the folder.

Needs ``npm install --prefix tests/node`` for ONNX Runtime. Any web server will do, such
as ``python -m http.server --directory FOLDER``: there is no server part. The docs site
holds the page too.
"""

import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
REPOSITORY = HERE.parent.parent
TELEPHONE = REPOSITORY / "packages" / "tactophone" / "src" / "tactophone"
RUNTIME = REPOSITORY / "tests" / "node" / "node_modules" / "onnxruntime-web" / "dist"
STATIC = TELEPHONE / "faces" / "web" / "static"
PARTS = (
    *(HERE / name for name in ("index.html", "page.css", "page.js", "model.js")),
    STATIC.parents[2] / "core" / "palette.css",
    *(STATIC / name for name in ("capture.js", "fingertip.js", "speaker.js")),
    TELEPHONE / "signal" / "perception" / "models" / "stylus.onnx",
    *(
        RUNTIME / name
        for name in ("ort.wasm.bundle.min.mjs", "ort-wasm-simd-threaded.wasm")
    ),
)


def build(folder: Path) -> None:
    """Copy all parts into a folder; raises `FileNotFoundError` where the runtime was
    not installed."""
    if not RUNTIME.is_dir():
        raise FileNotFoundError(
            f"{RUNTIME} is missing: npm install --prefix tests/node"
        )
    folder.mkdir(parents=True, exist_ok=True)
    for part in PARTS:
        shutil.copy(part, folder)


if __name__ == "__main__":
    build(Path(sys.argv[1] if len(sys.argv) > 1 else "build/browser"))
