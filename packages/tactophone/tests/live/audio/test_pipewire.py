"""JACK by PipeWire, as today's desktops have it: a server of the test's own, with a
sink that is no sound card."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

NEEDED = ("dbus-run-session", "pipewire", "wireplumber", "pw-jack")

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.skipif(
        not all(map(shutil.which, NEEDED)), reason=f"needs {', '.join(NEEDED)}"
    ),
]

SINK = """
context.properties = {
  default.clock.rate = 48000
  default.clock.quantum = 128
  default.clock.min-quantum = 128
}
context.objects = [ { factory = adapter args = {
  factory.name = support.null-audio-sink
  node.name = "null"
  media.class = "Audio/Sink"
  audio.position = [ FL FR ]
} } ]
"""

SESSION = """
pipewire & server=$!
wireplumber & manager=$!
until pw-cli info all 2>/dev/null | grep -q '"null"'; do sleep 0.1; done
"$@"
kill $server $manager
"""

LISTED = """
import json
from dataclasses import asdict
from tactophone.live.audio.survey import survey
print(json.dumps(asdict(survey()[0])))
"""


def listed(folder: Path, *before: str) -> Any:
    """Return the first device that a survey finds, with a private folder for the
    server's sockets and settings."""
    environment = os.environ | {
        "XDG_RUNTIME_DIR": str(folder),
        "XDG_CONFIG_HOME": str(folder),
    }
    command = [*before, "pw-jack", sys.executable, "-c", LISTED]
    done = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    assert lines, done.stderr
    return json.loads(lines[-1])


def test_its_sink_is_listed_by_its_name_with_what_to_type(tmp_path: Path) -> None:
    settings = tmp_path / "pipewire" / "pipewire.conf.d" / "null.conf"
    settings.parent.mkdir(parents=True)
    settings.write_text(SINK)
    found = listed(tmp_path, "dbus-run-session", "--", "sh", "-c", SESSION, "sh")
    assert (found["system"], found["outputs"], found["sample_rate"]) == (
        "JACK by PipeWire",
        2,
        48_000,
    )
    assert "output.port=null:playback_FL" in found["settings"]
    assert found["note"].startswith("periods of 128 samples")


def test_it_is_named_where_it_does_not_run(tmp_path: Path) -> None:
    assert "PipeWire does not answer: start it" in listed(tmp_path)["actuator"]
