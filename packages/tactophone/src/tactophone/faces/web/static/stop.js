// The button Stop, and the keys: the space bar or Esc stop at one press, M mutes, and only holding the button releases a stop.
// The terminal has keys of its own: cli/console.py.

const LOOKS = 9; // while the button is held, before it releases a stop: 0.9 s, and longer on a page that stood still
const BETWEEN = 100; // ms
const TYPED = "input:not([type=range]), select, textarea"; // a slider does nothing with a space or an M

/**
 * Let `button` and the keys of the page make requests by `ask(action, silenced)`; `look()` returns whether the run is `stopped` and
 * `armed`, and how often it was `silenced`. */
export function listenForStop(button, ask, look) {
  let holding = 0;
  const down = new Set(); // what presses the button: a mouse, touch, a key
  let pointed = false; // whether the last input was no key

  function letGo() {
    clearInterval(holding);
    delete button.dataset.held;
  }

  /** One finger or one key alone holds (`first`): a flat hand does not, nor a mouse and a key. */
  function press(what, first = true) {
    letGo();
    down.add(what);
    const { stopped, silenced } = look();
    if (!stopped) return ask("stop");
    if (!first || down.size > 1) return;
    button.dataset.held = true;
    let looks = 0;
    // Looks are counted, not time: that it was let go is heard between two of them, also where the page stood still.
    holding = setInterval(() => {
      const now = look();
      if (!now.stopped || now.silenced !== silenced) return letGo(); // somebody released it, or stopped anew
      if (++looks < LOOKS) return;
      letGo();
      ask("arm", silenced);
    }, BETWEEN);
  }

  function release(what) {
    down.delete(what);
    letGo();
  }

  function key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || button.hidden || button.disabled) return;
    pointed = false;
    const busy = event.target.closest?.(`${TYPED}, button, a, summary, [role=application]`);
    if (event.target === button && [" ", "Enter"].includes(event.key)) {
      if (!event.repeat) press(event.key);
    } else if ((event.key === " " && !busy) || event.key === "Escape") {
      if (!look().stopped) ask("stop");
    } else if (event.key.toLowerCase() === "m" && !event.target.closest?.(TYPED) && look().armed) {
      return ask("mute"); // M only mutes: a slip of the finger must not start a vibration
    } else return;
    event.preventDefault();
  }

  button.setAttribute("aria-keyshortcuts", "Space Escape");
  // Not by the second button of a mouse: it may open a menu, which takes the end of the press.
  button.addEventListener("pointerdown", ({ pointerType, button: which, isPrimary }) => press(pointerType, which === 0 && isPrimary));
  for (const end of ["pointerup", "pointerleave", "pointercancel"]) button.addEventListener(end, ({ pointerType }) => release(pointerType));
  button.addEventListener("keyup", ({ key }) => release(key));
  for (const [place, end] of [[button, "blur"], [globalThis, "visibilitychange"]]) place.addEventListener(end, () => { down.clear(); letGo(); });
  addEventListener("keydown", key);
  // What was clicked or chosen from gives the space bar back to Stop; what was reached by keys keeps it.
  addEventListener("pointerdown", () => { pointed = true; });
  addEventListener("click", ({ detail, target }) => { if (detail) target.closest?.("button, a, summary, [type=checkbox]")?.blur(); });
  addEventListener("change", ({ target }) => { if (pointed) target.closest?.("select")?.blur(); });
}
