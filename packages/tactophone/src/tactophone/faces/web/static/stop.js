// The button Stop, and the keys: the space bar or Esc stop at one press, M mutes, and only holding the button releases a stop.
// The terminal has keys of its own: cli/console.py.

const HOLD = 900; // ms to hold the button that releases a stop

/** Let `button` and the keys of the page make requests by `ask(action)`; `look()` returns whether the run is `stopped` and `armed`. */
export function listenForStop(button, ask, look) {
  let holding = 0;

  function letGo() {
    clearTimeout(holding);
    delete button.dataset.held;
  }

  function press() {
    if (!look().stopped) return ask("stop");
    button.dataset.held = true;
    holding = setTimeout(() => { letGo(); ask("arm"); }, HOLD);
  }

  function key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || button.hidden || button.disabled) return;
    const busy = event.target.closest?.("input, select, textarea, button, a, summary, [role=application]");
    if (event.target === button && [" ", "Enter"].includes(event.key)) {
      if (!event.repeat) press();
    } else if ((event.key === " " && !busy) || event.key === "Escape") {
      if (!look().stopped) ask("stop");
    } else if (event.key.toLowerCase() === "m" && !event.target.closest?.("input, select, textarea") && look().armed) {
      return ask("mute"); // M only mutes: a slip of the finger must not start a vibration
    } else return;
    event.preventDefault();
  }

  button.setAttribute("aria-keyshortcuts", "Space Escape");
  button.addEventListener("pointerdown", press);
  for (const end of ["pointerup", "pointerleave", "pointercancel", "keyup", "blur"]) button.addEventListener(end, letGo);
  addEventListener("keydown", key);
  // A button that was clicked gives the space bar back to Stop; one reached by keys keeps it.
  addEventListener("click", ({ detail, target }) => { if (detail) target.closest?.("button")?.blur(); });
}
