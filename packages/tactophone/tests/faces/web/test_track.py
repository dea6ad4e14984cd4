"""What a chart draws is what was sent: the pages' own track, run by node."""

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactophone.faces.web

TRACK = Path(tactophone.faces.web.__file__).parent / "static" / "track.js"

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="needs node")

PROGRAM = """
import { readFileSync } from "node:fs";
const source = readFileSync(process.argv[1], "utf8");
const { Track, pieces, gaps, broken } = await import(
  "data:text/javascript," + encodeURIComponent(source));
const { messages, end } = JSON.parse(readFileSync(0, "utf8"));
const track = new Track(2, 2000);
const grew = [];
for (const { origin, rows } of messages) {
  const numbers = Float32Array.from(rows.flat());
  track.append({ rows: rows.length, columns: 2, numbers }, origin);
  const times = track.after(-Infinity)[0];
  grew.push(times.every((time, k) => !k || time >= times[k - 1]));
}
const columns = track.after(-Infinity);
console.log(JSON.stringify({
  grew, times: [...columns[0]], values: [...columns[1]],
  gaps: gaps(columns[0], end), pieces: pieces(columns[0]),
  broken: broken(columns).map((column) => [...column]),
}));
"""


def drawn(messages: Sequence[dict[str, Any]], end: float) -> dict[str, Any]:
    """Return what a track holds after these messages, drawn up to ``end`` s."""
    command = ["node", "--input-type=module", "-e", PROGRAM, str(TRACK)]
    content = json.dumps({"messages": messages, "end": end})
    done = subprocess.run(
        command, input=content, capture_output=True, text=True, timeout=30
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def message(times: Sequence[float], values: Sequence[float]) -> dict[str, Any]:
    """Return rows as the feed sends them, relative to the newest time."""
    origin = times[-1]
    rows = [[time - origin, value] for time, value in zip(times, values, strict=True)]
    return {"origin": origin, "rows": rows}


def stream(start: float, stop: float, step: float = 0.01) -> list[float]:
    return list(np.arange(start, stop, step))


@needs_node
def test_an_outage_is_a_gap_and_not_the_last_value_drawn_on() -> None:
    before, after = stream(0, 2), stream(8, 9)
    found = drawn(
        [message(before, [2] * len(before)), message(after, [1] * len(after))], 9.0
    )
    assert found["gaps"] == [[pytest.approx(before[-1]), pytest.approx(8.0)]]
    assert len(found["pieces"]) == 2
    times, values = found["broken"]
    (cut,) = (place for place, value in enumerate(values) if value is None)
    assert before[-1] < times[cut] < 8.0


@needs_node
def test_what_has_not_come_yet_is_a_gap_too() -> None:
    times = stream(0, 2)
    found = drawn([message(times, [0] * len(times))], 5.0)
    assert found["gaps"] == [[pytest.approx(times[-1]), 5.0]]


@needs_node
def test_a_second_pass_begins_anew_and_holds_nothing_of_the_first() -> None:
    first, second = stream(0, 5), stream(0, 1)
    mixed = message(second, [1] * len(second))
    # A message may bring the end of the first pass, which lies in the future.
    mixed["rows"] = [[4.9 - mixed["origin"], 2.0], *mixed["rows"]]
    found = drawn([message(first, [2] * len(first)), mixed], 1.0)
    assert set(found["values"]) == {1}
    assert found["times"] == pytest.approx(second, abs=1e-5)


@needs_node
@pytest.mark.parametrize("seed", range(8))
def test_time_only_grows_whatever_comes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    messages, now = [], 0.0
    for _ in range(40):
        kind = rng.choice(["on", "loop", "jump", "outage", "late"])
        now = {"loop": 0.0, "jump": now + rng.uniform(-3, 3)}.get(kind, now)
        now += rng.uniform(1, 6) * (kind == "outage")
        length = 6.0 if kind == "late" else rng.uniform(0.02, 0.3)
        step = 0.01 * rng.choice([0.5, 1, 2])
        times = stream(now, now + max(length, step), step)
        messages.append(message(times, [1] * len(times)))
        now = times[-1] + step
    found = drawn(messages, now)
    assert all(found["grew"])
    assert found["times"][-1] <= now + 0.05
    sent = np.concatenate(
        [np.array(entry["rows"])[:, 0] + entry["origin"] for entry in messages]
    )
    for time in found["times"]:
        assert np.abs(sent - time).min() < 1e-4
