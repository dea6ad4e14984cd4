"""The example through Khronos' own loader and validation layer, as pyopenxr brings
them.

Neither Debian 12 nor PyPI has a runtime in software, so that `runtime.c`, which
vibrates nothing, stands in for one.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

xr = pytest.importorskip("xr", reason="needs pyopenxr and PyOpenGL")

HERE = Path(__file__).parent
EXAMPLE = HERE.parent / "examples" / "apply.py"


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Return the environment in which a program finds runtime and layer."""
    if (compiler := shutil.which("cc")) is None or platform.system() != "Linux":
        pytest.skip("needs a C compiler on Linux")
    library = tmp_path / "libruntime.so"
    command = [compiler, "-Wall", "-Werror", "-shared", "-fPIC"]
    subprocess.run([*command, "-o", library, HERE / "runtime.c"], check=True)
    manifest = tmp_path / "runtime.json"
    runtime = {"name": "none", "library_path": str(library)}
    manifest.write_text(
        json.dumps({"file_format_version": "1.0.0", "runtime": runtime})
    )
    machine = platform.machine()
    return os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "XR_RUNTIME_JSON": str(manifest),
        "XR_API_LAYER_PATH": str(
            Path(xr.__file__).parent / "api_layer" / f"linux_{machine}"
        ),
        "XR_ENABLE_API_LAYERS": "XR_APILAYER_LUNARG_core_validation",
        "XR_CORE_VALIDATION_EXPORT_TYPE": "text",
    }


def printed(environment: dict[str, str], program: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        cwd=EXAMPLE.parent,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert any("Core Validation Layer is initialized" in line for line in lines)
    return lines


def complaints(lines: list[str]) -> list[str]:
    return [line for line in lines if "VALID_ERROR" in line or "VALID_WARNING" in line]


def test_every_frame_reaches_the_runtime_and_the_layer_finds_nothing(
    environment: dict[str, str],
) -> None:
    lines = printed(environment, "import apply; apply.main()")
    assert complaints(lines) == []
    frames = [line for line in lines if line.startswith("frame ")]
    kinds = [int(line.split()[1].rstrip(",")) for line in frames]
    assert kinds == [1, *[2] * 24, 3]
    assert "a(10000000)=0.5000" in frames[0]
    # 60 of 40 to 400 Hz, then 120.
    assert "f(10000000)=0.0556" in frames[0]
    assert "f(10000000)=0.2222" in frames[20]
    assert frames[-1].endswith("a(0)=0.0000 a(1000000)=0.0000 f(0)=0.0000")


def test_the_layer_complains_of_a_frame_that_the_standard_does_not_know(
    environment: dict[str, str],
) -> None:
    spoilt = """
import apply, xr
good = apply.vibration
def bad(frame):
    made = good(frame)
    made._stream_frame_type = 77
    return made
apply.vibration = bad
apply.main()
"""
    (first, *_) = complaints(printed(environment, spoilt))
    assert 'invalid XrHapticParametricStreamFrameTypeEXT "streamFrameType"' in first
