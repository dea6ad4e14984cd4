"""Assemble the page that listens: ``python examples/browser/build.py [FOLDER]``, then
serve the folder.

Needs ``npm install --prefix tests/node`` for ONNX Runtime. Any web server will do, such
as ``python -m http.server --directory FOLDER``: there is no server part. The docs site
holds the page too.
"""

import json
import shutil
import sys
from pathlib import Path

from tactophone.core.settings import DEFAULT_CEILING
from tactophone.signal.haptics.profiles import (
    ROUGH_STIMULUS,
    SMOOTH_STIMULUS,
    Stimulus,
)

HERE = Path(__file__).parent
REPOSITORY = HERE.parent.parent
TELEPHONE = REPOSITORY / "packages" / "tactophone" / "src" / "tactophone"
RUNTIME = REPOSITORY / "tests" / "node" / "node_modules" / "onnxruntime-web" / "dist"
STATIC = TELEPHONE / "faces" / "web" / "static"
PARTS = (
    *(HERE / name for name in ("index.html", "page.css", "page.js", "model.js")),
    STATIC.parents[2] / "core" / "palette.css",
    *(
        STATIC / name
        for name in ("capture.js", "fingertip.js", "resampler.js", "speaker.js")
    ),
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
    (folder / "stimuli.js").write_text(stimuli(), encoding="utf-8")


def stimuli() -> str:
    """Return the module with the vibration that the page renders: the telephone's own
    two stimuli of the paper, and its default ceiling."""
    return (
        "// The paper's two stimuli, in Hz and dB of full drive; the ceiling, 0 to 1.\n"
        f"export const SMOOTH = {_object(SMOOTH_STIMULUS)};\n"
        f"export const ROUGH = {_object(ROUGH_STIMULUS)};\n"
        f"export const HIGHEST_CEILING = {DEFAULT_CEILING};\n"
    )


def _object(stimulus: Stimulus) -> str:
    return json.dumps({"frequency": stimulus.frequency, "dbfs": stimulus.level_dbfs})


if __name__ == "__main__":
    build(Path(sys.argv[1] if len(sys.argv) > 1 else "build/browser"))
