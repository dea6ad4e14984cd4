"""The space bar stops wherever it does nothing else: the pages' own keys, run by
node."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import tactophone.faces.web

STOP = Path(tactophone.faces.web.__file__).parent / "static" / "stop.js"

PROGRAM = """
import { readFileSync } from "node:fs";
const heard = {};
globalThis.addEventListener = (kind, hear) => { (heard[kind] ??= []).push(hear); };
const tell = (kind, event) => { for (const hear of heard[kind] ?? []) hear(event); };
const { listenForStop } = await import("data:text/javascript,"
  + encodeURIComponent(readFileSync(process.argv[1], "utf8")));
let asked = [];
listenForStop({ dataset: {}, setAttribute() {}, addEventListener() {} },
  (action) => asked.push(action), () => ({ stopped: false, armed: true }));
// As much of selectors as stop.js uses.
const matches = (one, tag, type) => one === tag || one === `[type=${type}]`
  || (one === "input:not([type=range])" && tag === "input" && type !== "range");
const found = {};
for (const [tag, type] of JSON.parse(readFileSync(0, "utf8"))) {
  const target = { blurred: 0, blur() { this.blurred += 1; }, closest(all) {
    return all.split(",").some((one) => matches(one.trim(), tag, type)) ? this : null;
  } };
  const press = (key) => {
    asked = [];
    tell("keydown", { key, target, preventDefault() {} });
    return asked.join();
  };
  const keys = [" ", "m", "Escape"].map(press);
  tell("click", { detail: 0, target });
  tell("change", { target });
  const byKeys = target.blurred;
  tell("pointerdown", { target });
  tell("click", { detail: 1, target });
  tell("change", { target });
  found[`${tag} ${type}`.trim()] = [...keys, byKeys, target.blurred > 0];
}
console.log(JSON.stringify(found));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_the_space_bar_stops_after_a_slider_and_what_was_clicked_leaves_it() -> None:
    """A slider that was dragged kept the space bar, with which it does nothing."""
    elements = [
        ["body", ""],
        ["input", "range"],
        ["input", "text"],
        ["input", "checkbox"],
        ["select", ""],
        ["summary", ""],
        ["button", ""],
    ]
    command = ["node", "--input-type=module", "-e", PROGRAM, str(STOP)]
    done = subprocess.run(
        command, input=json.dumps(elements), capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    # What the space bar, M and Escape ask for; whether keys, and whether a pointer,
    # make it leave the focus.
    assert json.loads(done.stdout) == {
        "body": ["stop", "mute", "stop", 0, False],
        "input range": ["stop", "mute", "stop", 0, False],
        "input text": ["", "", "stop", 0, False],
        "input checkbox": ["", "", "stop", 0, True],
        "select": ["", "", "stop", 0, True],
        "summary": ["", "mute", "stop", 0, True],
        "button": ["", "mute", "stop", 0, True],
    }
