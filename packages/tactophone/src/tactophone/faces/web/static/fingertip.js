// The page as the fingertip: commands become the vibration of a gamepad, of a phone, or sound, whichever the device has.
//
// Dead man's switch: without a fresh command for 150 ms everything is silent, on a hidden page and after stop at once.
// A command that comes late is not rendered: age.js.
// Each effect also ends by itself: none lasts longer than what is left of the 150 ms, so a stalled page falls silent too.

import { STALE } from "./age.js";
import { Speaker } from "./speaker.js";

export const DEAD_MAN = 150; // ms after the last command
const REFRESH = 50; // ms between two effects of a gamepad
const EFFECT = 120; // ms of an effect: lasts over a missed refresh
const ROUGH = [8, 8]; // ms on, off: about 60 Hz, as fast as a phone's motor follows
const ROUGH_TRAIN = 112; // ms, seven of them; the next train follows without a seam
const SMOOTH = [10]; // ms: a single tick
const SMOOTH_TRAIN = 120; // ms from tick to tick
const EXPONENT = 0.4; // the profile's faint end, -25 dB, becomes a third of the ceiling, at which motors turn

/**
 * Strong and weak motor of a gamepad, 0 to 1: rough turns the strong (slow) one, smooth the weak (fast) one, and both
 * share what lies between. Never above the ceiling. As `motor_levels` in live/audio/gamepad.py.
 */
export function motors(amplitude, roughness, ceiling) {
  if (!(amplitude > 0 && ceiling > 0)) return [0, 0];
  const drive = ceiling * Math.min(1, amplitude / ceiling) ** EXPONENT;
  return [drive * roughness, drive * (1 - roughness)];
}

export function hasPhoneMotor() {
  // Desktop browsers have the function too, without a motor behind it.
  return "vibrate" in navigator && (navigator.userAgentData?.mobile ?? /Android/.test(navigator.userAgent));
}

const isAppleTouch = () => /iPhone|iPad/.test(navigator.userAgent) || (/Mac/.test(navigator.userAgent) && navigator.maxTouchPoints > 1);

export const gamepad = () => [...(navigator.getGamepads?.() ?? [])].find((pad) => pad?.connected && pad.vibrationActuator) ?? null;

export class Fingertip {
  #speaker = null;
  #on = false;
  #command = null; // {amplitude, roughness, ceiling, at}
  #trainEnd = 0;
  #way = "";
  #chosen = "auto";
  #missing = "";
  #timer = null;
  #deadMan = null;
  #pad = null;

  /** `onWay(text)`: how the vibration is rendered now, or why it is not; `quiet`: never by sound, as another plays it. */
  constructor({ onWay, quiet = false }) {
    this.onWay = onWay;
    this.quiet = quiet;
    document.addEventListener("visibilitychange", () => (document.hidden ? this.#silence() : this.#showWay()));
    addEventListener("pagehide", () => this.stop());
    for (const kind of ["gamepadconnected", "gamepaddisconnected"]) addEventListener(kind, () => this.#showWay());
  }

  get on() { return this.#on; }

  /** How the vibration is rendered now, or why it is not. */
  get words() { return this.#words(); }

  /** Start, from a button's handler: browsers allow sound and vibration only then. */
  async start() {
    this.#on = true;
    this.#timer ??= setInterval(() => this.#refresh(), REFRESH);
    if (!this.quiet) {
      this.#speaker ??= new Speaker(() => {});
      try {
        await this.#speaker.start();
        this.#missing = "";
      } catch (error) {
        this.#missing = error.message;
      }
    }
    this.#showWay();
  }

  stop() {
    this.#on = false;
    this.#silence();
    clearInterval(this.#timer);
    this.#timer = null;
    this.#showWay();
  }

  /** `auto`, `gamepad`, `phone` or `sound`. */
  choose(way) {
    this.#silence();
    this.#chosen = way;
    this.#showWay();
  }

  set volume(value) { if (this.#speaker) this.#speaker.volume = value; }

  set overtones(enabled) { if (this.#speaker) this.#speaker.overtones = enabled; }

  /** A fresh command of the run, `age` ms old at most; `null` without one. Samples are the waveform, for sound. */
  take({ command, ceiling, armed, alive, age = 0 }, samples) {
    if (!this.#on || document.hidden) return;
    if (!armed || !alive) return this.#silence();
    if (!(age < STALE)) return; // the dead man's switch ends what goes on
    if (command) this.#render(command, ceiling);
    if (samples?.length && this.#way === "sound") {
      this.#speaker.ceiling = ceiling;
      this.#speaker.play(samples);
    }
  }

  #render([amplitude, roughness], ceiling) {
    const before = this.#command;
    this.#command = { amplitude, roughness, ceiling, at: performance.now() };
    clearTimeout(this.#deadMan);
    this.#deadMan = setTimeout(() => this.#silence(), DEAD_MAN);
    const changed = !before || before.amplitude > 0 !== amplitude > 0 || before.roughness >= 0.5 !== roughness >= 0.5;
    if (amplitude > 0 && changed) this.#refresh(true);
    else if (before?.amplitude > 0 && !(amplitude > 0)) this.#rest(); // the waveform of the sound fades by itself
  }

  /** Make the next effect; `now`: the command has changed, so the old effect is cut. */
  #refresh(now = false) {
    if (this.#way !== this.#wayNow()) this.#showWay();
    const command = this.#command;
    if (!command) return;
    const left = DEAD_MAN - (performance.now() - command.at);
    if (left <= 0) return this.#silence(); // the timer for it is late
    if (!(command.amplitude > 0)) return;
    if (this.#way === "gamepad") this.#rumble(command, Math.min(EFFECT, left));
    else if (this.#way === "phone" && (now || performance.now() >= this.#trainEnd - REFRESH / 2)) this.#buzz(command, left);
  }

  #rumble({ amplitude, roughness, ceiling }, duration) {
    const [strongMagnitude, weakMagnitude] = motors(amplitude, roughness, ceiling);
    this.#pad = gamepad()?.vibrationActuator ?? null;
    this.#pad?.playEffect("dual-rumble", { duration, strongMagnitude, weakMagnitude })?.catch?.(() => {});
  }

  #buzz({ roughness }, left) {
    const rough = roughness >= 0.5;
    const train = rough ? Array(Math.max(1, Math.floor(Math.min(ROUGH_TRAIN, left) / 16))).fill(ROUGH).flat() : SMOOTH;
    this.#trainEnd = performance.now() + (rough ? ROUGH_TRAIN : SMOOTH_TRAIN);
    navigator.vibrate(train);
  }

  /** End every effect and drop the sound that is queued. */
  #silence() {
    if (this.#command?.amplitude > 0) this.#rest();
    if (this.#command) this.#speaker?.silence();
    this.#command = null;
  }

  /** End the effect of a motor. */
  #rest() {
    this.#trainEnd = 0;
    this.#pad?.reset?.()?.catch?.(() => {});
    if (this.#way === "phone") navigator.vibrate(0);
  }

  #wayNow() {
    if (!this.#on) return "";
    const sounds = !this.quiet && !this.#missing;
    const has = { gamepad: gamepad() !== null, phone: hasPhoneMotor(), sound: sounds };
    if (this.#chosen !== "auto") return has[this.#chosen] ? this.#chosen : "";
    return Object.keys(has).find((way) => has[way]) ?? "";
  }

  #showWay() {
    const way = this.#wayNow();
    if (this.#way !== way) this.#silence();
    this.#way = way;
    this.onWay(this.#words(), way);
  }

  #words() {
    if (!this.#on) return "";
    const chosen = this.#chosen;
    const words = {
      gamepad: "You feel it in the gamepad.",
      phone: "You feel it in this phone: short ticks are smooth, a buzz is rough.",
      sound: "You get it as sound: use headphones, or lay a finger on the loudspeaker.",
    }[this.#way] ?? {
      gamepad: "No gamepad is found: connect one, and press any of its buttons.",
      phone: "This device gives a web page no vibration motor.",
    }[chosen] ?? "This page cannot make you feel it.";
    const apple = isAppleTouch() && this.#way !== "gamepad" ? " An iPhone or iPad gives web pages no vibration motor: connect a gamepad, or open this page on an Android phone." : "";
    const missing = this.#missing && this.#way !== "gamepad" ? ` ${this.#missing}` : "";
    return words + apple + missing;
  }
}
