"""A page by axe-core, in the widths of a phone, a tablet and a laptop, light and dark;
and by the Tab key alone."""

import importlib.util
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from tests.browser import resize

_CARRIER = importlib.util.find_spec("axe_playwright_python")
"""The package that carries axe-core. Only its script is read: nothing of it is
imported, nor Playwright, which it would need."""

needs_axe = pytest.mark.skipif(
    _CARRIER is None, reason="needs axe-core: pip install --group dev"
)

SIZES = (390, 768, 1280)

_RUN = """
const done = arguments[0];
const described = ({ html, failureSummary }) => [html.slice(0, 80), failureSummary];
axe.run(document, { resultTypes: ["violations"] }).then(
  ({ violations }) => done(violations
    .filter(({ impact }) => ["serious", "critical"].includes(impact))
    .map(({ id, nodes }) => [id, nodes.map(described)])),
  String,
);
"""


def _axe() -> str:
    """Return the source of axe-core."""
    assert _CARRIER is not None
    assert _CARRIER.origin is not None
    return Path(_CARRIER.origin).with_name("axe.min.js").read_text(encoding="utf-8")


def serious_faults(browser: webdriver.Chrome) -> list[str]:
    """Return the faults of the open page, in every size and theme; leaves it at a
    laptop's size, light."""
    found = []
    source = _axe()
    for theme in ("dark", "light"):
        # Still, as the contrast of a colour on its way to another says nothing.
        preferred = [
            {"name": "prefers-color-scheme", "value": theme},
            {"name": "prefers-reduced-motion", "value": "reduce"},
        ]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": preferred})
        for width in SIZES:
            resize(browser, width, 900)
            browser.execute_script(source)
            faults = browser.execute_async_script(_RUN)
            found += [f"{theme}, {width} px: {fault}" for fault in faults]
    return found


def outside(browser: webdriver.Chrome) -> int:
    """Return by how many pixels the page is wider than its window."""
    script = "return document.documentElement.scrollWidth - innerWidth"
    return int(browser.execute_script(script))


_CONTROLS = """
const usable = "summary, a[href], button, input, select, [tabindex='0']";
const visible = (node) => node.checkVisibility({ visibilityProperty: true });
return [...document.querySelectorAll(usable)]
  .filter((node) => !node.disabled && visible(node))
  .filter((node) => node.type !== "radio" || node.checked).length;
"""
_FOCUSED = """
const node = document.activeElement;
if (node === document.body) return null;
const { outlineStyle, outlineWidth, boxShadow } = getComputedStyle(node);
const outlined = outlineStyle !== "none" && parseFloat(outlineWidth) >= 1;
const seen = outlined || boxShadow !== "none";
const place = [...document.querySelectorAll("*")].indexOf(node);
return [place + " " + node.outerHTML.slice(0, 80), seen];
"""


def reached_by_tab(browser: webdriver.Chrome) -> tuple[int, dict[str, bool]]:
    """Return the number of controls that can be used, and those that the Tab key
    reaches, with whether one sees it.

    Of a group of radio buttons, Tab reaches the chosen one, and the arrow keys the
    others.
    """
    # Tab goes on from the element that had the focus last; so the page itself has it
    # first.
    browser.execute_script(
        "document.body.tabIndex = -1; document.body.focus(); "
        "document.body.removeAttribute('tabindex');"
    )
    reached: dict[str, bool] = {}
    for _ in range(60):
        ActionChains(browser).send_keys(Keys.TAB).perform()
        focused = browser.execute_script(_FOCUSED)
        if focused is None or focused[0] in reached:
            break
        reached[focused[0]] = focused[1]
    return int(browser.execute_script(_CONTROLS)), reached
