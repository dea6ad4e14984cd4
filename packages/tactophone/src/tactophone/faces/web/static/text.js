// How every page formats numbers, and puts texts into the document.

const MINUS = "−";
const formats = [0, 1, 2].map((digits) => new Intl.NumberFormat("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }));

/** Format a number with 0 to 2 digits after the point, or a dash where there is none. */
export function formatNumber(value, digits = 0, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = formats[digits].format(Math.abs(value));
  return `${value < 0 && /[1-9]/.test(text) ? MINUS : ""}${text}${unit && `\u202f${unit}`}`;
}

export const percent = (share, digits = 0) => formatNumber(share === null ? null : 100 * share, digits, "%");
export const milliseconds = (seconds, digits = 1) => formatNumber(seconds === null ? null : 1000 * seconds, digits, "ms");
export const dbfs = (value) => formatNumber(value, 0, "dBFS");

/** Seconds as minutes and seconds: 1:05. */
export const clock = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;

/** Bytes as kB or MB. */
export const fileSize = (bytes) => (bytes < 1e6 ? formatNumber(bytes / 1e3, 0, "kB") : formatNumber(bytes / 1e6, 1, "MB"));

/** Set the rows of a definition list; unchanged rows are left alone. */
export function list(node, rows) {
  if (node.children.length !== rows.length) {
    node.replaceChildren(...rows.map(() => {
      const row = document.createElement("div");
      row.append(document.createElement("dt"), document.createElement("dd"));
      return row;
    }));
  }
  rows.forEach(([name, value, hint, mark], k) => {
    const row = node.children[k];
    put(row.firstChild, name);
    put(row.lastChild, value);
    if (row.title !== (hint ?? "")) row.title = hint ?? "";
    row.dataset.mark = mark ?? "";
  });
}

/** Set the items of a list, each a text and a mark: good, fair, bad or unknown. */
export function lines(node, items) {
  if (node.children.length !== items.length) node.replaceChildren(...items.map(() => document.createElement("li")));
  items.forEach(([text, mark], k) => {
    put(node.children[k], text);
    node.children[k].dataset.mark = mark;
  });
}

/** A text as the beginning of a sentence. */
export const capital = (text) => text && text[0].toUpperCase() + text.slice(1);

/** Set a text only if it changed, so that a screen reader does not repeat it. */
export function put(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Fold a part of the page on a phone, where it is one press away, and open it where there is room. */
export function foldOnPhone(details) {
  const narrow = matchMedia("(max-width: 760px)");
  const fold = () => { details.open = !narrow.matches; };
  narrow.addEventListener("change", fold);
  fold();
}

/** Set a text whose commands stand between backticks, and show these as code. */
export function putWords(node, text) {
  if (node.textContent === text.replaceAll("`", "")) return;
  node.replaceChildren(...text.split("`").map((part, k) => (k % 2 ? Object.assign(document.createElement("code"), { textContent: part }) : part)));
}

const SHOWN_AFTER = 10_000; // ms for which the end of a fault is shown

/** Faults as texts with the next step, and for a while the end of each; empty without faults. */
export function showFaults(node, faults) {
  const present = new Set(faults.map((fault) => fault.code));
  for (const { code, text } of node.faults ?? []) {
    if (!present.has(code)) node.append(endOf(code, text));
  }
  const texts = faults.map((fault) => fault.text);
  node.faults = faults;
  if (node.dataset.texts === texts.join("\n")) return;
  node.dataset.texts = texts.join("\n");
  const lines = texts.map((text) => {
    const line = document.createElement("p");
    putWords(line, capital(text));
    return line;
  });
  const over = [...node.querySelectorAll(".over")].filter((line) => !present.has(line.dataset.code));
  node.replaceChildren(...lines, ...over);
}

function endOf(code, text) {
  const line = Object.assign(document.createElement("p"), { className: "over" });
  line.dataset.code = code;
  putWords(line, `Over: ${text}`);
  setTimeout(() => line.remove(), SHOWN_AFTER);
  return line;
}

/** Write a command line that breaks between its words alone. */
export function putCommand(node, text) {
  const words = text.split(" ").flatMap((word) => [" ", Object.assign(document.createElement("span"), { textContent: word })]);
  node.replaceChildren(...words.slice(1));
}
