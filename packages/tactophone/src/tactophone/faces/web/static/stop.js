// The button Stop, and the keys: the space bar or Esc stop at one press, M mutes, and only holding the button releases a stop.
// The terminal has keys of its own: cli/console.py.

const HOLD = 900; // ms to hold the button that releases a stop
const TYPED = "input:not([type=range]), select, textarea"; // a slider does nothing with a space or an M

/** Let `button` and the keys of the page make requests by `ask(action)`; `look()` returns whether the run is `stopped` and `armed`. */
export function listenForStop(button, ask, look) {
  let holding = 0;
  let pointed = false; // whether the last input was no key

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
    pointed = false;
    const busy = event.target.closest?.(`${TYPED}, button, a, summary, [role=application]`);
    if (event.target === button && [" ", "Enter"].includes(event.key)) {
      if (!event.repeat) press();
    } else if ((event.key === " " && !busy) || event.key === "Escape") {
      if (!look().stopped) ask("stop");
    } else if (event.key.toLowerCase() === "m" && !event.target.closest?.(TYPED) && look().armed) {
      return ask("mute"); // M only mutes: a slip of the finger must not start a vibration
    } else return;
    event.preventDefault();
  }

  button.setAttribute("aria-keyshortcuts", "Space Escape");
  button.addEventListener("pointerdown", press);
  for (const end of ["pointerup", "pointerleave", "pointercancel", "keyup", "blur"]) button.addEventListener(end, letGo);
  addEventListener("keydown", key);
  // What was clicked or chosen from gives the space bar back to Stop; what was reached by keys keeps it.
  addEventListener("pointerdown", () => { pointed = true; });
  addEventListener("click", ({ detail, target }) => { if (detail) target.closest?.("button, a, summary, [type=checkbox]")?.blur(); });
  addEventListener("change", ({ target }) => { if (pointed) target.closest?.("select")?.blur(); });
}
