"""The words of a page that do not change while it is open: the docs keep them beside
each picture of a page, so that a test finds a picture of an older page."""

import re

from selenium import webdriver

WORDS_FILE = "words.json"
"""Name of the file beside the pictures, with the words of each."""

_SHOWN = """
const named = "h1, h2, h3, button, label, legend, summary, dt, .key b";
return [...document.querySelectorAll(named)]
  .filter((node) => node.checkVisibility({ visibilityProperty: true }))
  .map((node) => [...node.childNodes]
    .filter(({ nodeType }) => nodeType === Node.TEXT_NODE)
    .map(({ textContent }) => textContent).join(" "));
"""

CHANGING = {"Mute", "Resume", "Record", "Pause", "Go on", "Dark", "Light", "label"}
"""Words that depend on the state of a run, on the viewer or on the source."""


def fixed_words(browser: webdriver.Chrome) -> list[str]:
    """Return the headings, labels and buttons that the page shows, sorted; without
    numbers and without words of a moment."""
    found = {" ".join(words.split()) for words in browser.execute_script(_SHOWN)}
    return sorted(
        words for words in found - CHANGING if words and not re.search(r"\d", words)
    )
