// Open on your phone: this page's address as a QR code, where another device can reach it; else how to start the run so.

import { putWords } from "./text.js";

const ALONE = "Only this machine reaches this page. Start the run again with `--lan`, and a phone in the same network can open it.";

const place = document.querySelector("#phone");
place.addEventListener("toggle", async () => {
  if (!place.open || place.children.length > 1) return;
  const line = Object.assign(document.createElement("p"), { className: "hint" });
  place.append(line);
  const here = location.pathname.split("/").pop();
  const address = `qr.svg?page=${here}`;
  const answer = await fetch(address);
  if (answer.status !== 200) return putWords(line, answer.status === 204 ? ALONE : "No QR code: the machine lacks the library `segno`.");
  line.before(Object.assign(document.createElement("img"), { className: "qr", src: address, alt: "QR code of this page's address" }));
  putWords(line, "Scan it with a phone in the same network. Whoever has the address sees this run, feels it, and can stop, mute and weaken it.");
});
