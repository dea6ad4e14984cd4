// The contact sound as the detector hears it: the level of each of its bands over time, stronger where it is louder.

import { Chart, line } from "./charts.js";
import { formatNumber } from "./text.js";
import { gaps, pieces } from "./track.js";

const LEAST = -90; // dB: nothing under it is sent
const RANGE = 30; // dB at least, from the faintest that is drawn to the darkest
const COLUMN = 0.02; // s of a column: HOP of spectrogram.py
const NAMED = 5; // bands from one that is named on the axis to the next

/** Draw `rows`, columns of time and of each band's level, as opacity. */
function painted(rows, [from, to], loudest) {
  const bands = rows.length - 1;
  const canvas = new OffscreenCanvas(to - from, bands);
  const paint = canvas.getContext("2d");
  const picture = paint.createImageData(to - from, bands);
  for (let band = 0; band < bands; band++) {
    for (let k = from; k < to; k++) {
      const share = (rows[band + 1][k] - LEAST) / (loudest - LEAST);
      picture.data[4 * ((bands - 1 - band) * (to - from) + k - from) + 3] = 255 * Math.min(1, Math.max(0, share));
    }
  }
  paint.putImageData(picture, 0, 0);
  return canvas;
}

export class SpectrogramChart {
  #chart;
  #rows = [[]];
  #loudest = LEAST + RANGE;
  #end = 0;

  constructor(node, span) {
    this.bandsHz = []; // the middle of each band, in Hz
    this.#chart = new Chart(node, {
      span,
      lines: [{ ...line("ink"), paths: () => null }],
      times: true,
      y: () => [0, Math.max(1, this.bandsHz.length)],
      splits: () => this.bandsHz.map((_, band) => band + 0.5).filter((_, band) => band % NAMED === 0),
      label: (place) => formatNumber(this.bandsHz[Math.floor(place)]),
      over: (chart) => this.#over(chart),
    });
  }

  /** Show columns of time and bands up to `now`. */
  draw(rows, now) {
    this.#rows = rows;
    this.#end = now;
    const loudest = rows.slice(1).reduce((most, levels) => levels.reduce((a, b) => Math.max(a, b), most), LEAST + RANGE);
    this.#loudest = Math.max(loudest, this.#loudest - 0.2);
    this.#chart.draw([rows[0], rows[0]], now);
  }

  #over(chart) {
    const times = this.#rows[0];
    for (const [from, to] of pieces(times)) {
      chart.picture(painted(this.#rows, [from, to], this.#loudest), [times[from] - COLUMN, times[to - 1]], [0, this.#rows.length - 1], "contact");
    }
    for (const gap of gaps(times, this.#end)) chart.hatch(gap, "no data");
  }
}
