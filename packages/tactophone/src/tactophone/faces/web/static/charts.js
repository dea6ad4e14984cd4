// uPlot, set up once for all charts of the page: no cursor, no legend, time from the right edge.

import uPlot from "./vendor/uPlot.esm.js";

const GUTTER = 46; // px left of every chart, so that the times of all stand below one another
const COLOURS = ["ink", "soft", "rule", "contact", "air", "none", "smooth", "rough", "vibration", "warn"];
const WORDS = ["ink", "soft", "rule"]; // colours that a chart without fresh data keeps
const palette = {};
let faded = false;

function readPalette() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  for (const name of COLOURS) palette[name] = colour(name);
  // Old data pales; axes and words stay readable.
  if (faded) for (const name of COLOURS) if (!WORDS.includes(name)) palette[name] = `color-mix(in srgb, ${colour("none")} 45%, ${colour("panel")})`;
}

/** Whether the page has no fresh data, as statebar.js finds. */
function readFreshness() {
  const stale = document.body.dataset.stale === "true";
  if (stale === faded) return;
  faded = stale;
  readPalette();
}

/** A line of a chart; `fill` tints the area below it. */
export function line(name, { width = 1.5, dash, fill = false } = {}) {
  return {
    stroke: () => palette[name],
    fill: fill ? () => `color-mix(in srgb, ${palette[name]} 22%, transparent)` : undefined,
    width,
    dash,
    points: { show: false },
  };
}

export class Chart {
  #plot;
  #now = 0;
  #columns;

  /**
   * @param node the element to draw into
   * @param options.span     seconds shown, or a function that returns them
   * @param options.lines    a `line` for each column after the time
   * @param options.y        (plot, lowest, highest) => [low, high]
   * @param options.splits   () => y values with a grid line; round values by default
   * @param options.label    y value => text
   * @param options.times    whether to label the times below
   * @param options.scale    from seconds to the unit of these labels
   * @param options.between  [a, b]: columns between which is filled
   * @param options.over     (chart, columns) draws on top
   */
  constructor(node, options) {
    this.node = node;
    this.options = { times: false, scale: 1, label: String, ...options };
    this.#columns = Array.from({ length: options.lines.length + 1 }, () => []);
    new ResizeObserver(() => this.#fit()).observe(node);
    addEventListener("themechange", () => this.#plot?.redraw());
  }

  /** Show columns that end at `now`. */
  draw(columns, now) {
    this.#now = now;
    this.#columns = columns;
    readFreshness();
    if (this.node.clientWidth) this.#plot?.setData(columns); // not on a tab that is closed
  }

  /** Draw a level line across. */
  rule(value, name, dash = [4, 4]) {
    const { ctx, bbox } = this.#plot;
    const y = Math.round(this.#plot.valToPos(value, "y", true)) + 0.5;
    if (!(y >= bbox.top && y <= bbox.top + bbox.height)) return;
    ctx.save();
    ctx.strokeStyle = palette[name];
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash(dash.map((part) => part * devicePixelRatio));
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    ctx.restore();
  }

  /** Draw a thin line over the whole height at a time, and name it unless the last mark is nearer than its name is wide. */
  mark(time, name, since) {
    const { ctx, bbox } = this.#plot;
    const left = this.#plot.valToPos(time, "x", true);
    if (left < bbox.left) return;
    ctx.fillStyle = palette.ink;
    ctx.fillRect(left, bbox.top, devicePixelRatio, bbox.height);
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    const wide = this.#plot.valToPos(time + Math.min(since, this.#span), "x", true) - left > ctx.measureText(name).width;
    if (wide) ctx.fillText(name, left + 4 * devicePixelRatio, bbox.top + 13 * devicePixelRatio);
  }

  /** Fill from one time to another, from one y to another. */
  block([from, to], [low, high], name, opacity = 1) {
    const { ctx, bbox } = this.#plot;
    const left = Math.max(this.#plot.valToPos(from, "x", true), bbox.left);
    const right = Math.min(this.#plot.valToPos(to, "x", true), bbox.left + bbox.width);
    const top = this.#plot.valToPos(high, "y", true);
    ctx.globalAlpha = opacity;
    ctx.fillStyle = palette[name];
    ctx.fillRect(left, top, Math.max(right - left, 0), this.#plot.valToPos(low, "y", true) - top);
    ctx.globalAlpha = 1;
  }

  /** Hatch a time in which nothing was measured, and say so where there is room. */
  hatch([from, to], words) {
    const { ctx, bbox } = this.#plot;
    const left = Math.max(this.#plot.valToPos(from, "x", true), bbox.left);
    const right = Math.min(this.#plot.valToPos(to, "x", true), bbox.left + bbox.width);
    if (right <= left) return;
    const step = 9 * devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, bbox.top, right - left, bbox.height);
    ctx.clip();
    ctx.strokeStyle = palette.rule;
    ctx.lineWidth = 1.5 * devicePixelRatio;
    ctx.beginPath();
    for (let x = left - bbox.height; x < right; x += step) {
      ctx.moveTo(x, bbox.top + bbox.height);
      ctx.lineTo(x + bbox.height, bbox.top);
    }
    ctx.stroke();
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    const wide = ctx.measureText(words).width;
    if (right - left > wide + step) {
      ctx.fillStyle = palette.soft;
      ctx.textAlign = "left"; // the axes leave another one behind
      ctx.fillText(words, (left + right - wide) / 2, bbox.top + bbox.height / 2);
    }
    ctx.restore();
  }

  /** Draw a picture from one time to another, from one y to another: its opaque pixels take the colour. */
  picture(canvas, [from, to], [low, high], name) {
    const { ctx, bbox } = this.#plot;
    const paint = canvas.getContext("2d");
    paint.globalCompositeOperation = "source-in";
    paint.fillStyle = palette[name];
    paint.fillRect(0, 0, canvas.width, canvas.height);
    const [left, right] = [from, to].map((time) => this.#plot.valToPos(time, "x", true));
    const [bottom, top] = [low, high].map((value) => this.#plot.valToPos(value, "y", true));
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(canvas, left, top, right - left, bottom - top);
    ctx.restore();
  }

  /** Fill below values, each placed by `place(value)`, down to `base`; steps, as each holds until the next. */
  area(times, values, place, base, name, opacity) {
    if (!times.length) return;
    const { ctx } = this.#plot;
    const x = (time) => this.#plot.valToPos(time, "x", true);
    const y = (value) => this.#plot.valToPos(value, "y", true);
    ctx.beginPath();
    ctx.moveTo(x(times[0]), y(base));
    times.forEach((time, k) => {
      ctx.lineTo(x(time), y(place(values[Math.max(0, k - 1)])));
      ctx.lineTo(x(time), y(place(values[k])));
    });
    ctx.lineTo(x(times.at(-1)), y(base));
    ctx.globalAlpha = opacity;
    ctx.fillStyle = palette[name];
    ctx.fill();
    ctx.globalAlpha = 1;
  }

  get #span() {
    const { span } = this.options;
    return typeof span === "function" ? span() : span;
  }

  #fit() {
    const { clientWidth: width, clientHeight: height } = this.node;
    if (!width || !height) return;
    if (this.#plot) this.#plot.setSize({ width, height });
    else this.#plot = new uPlot(this.#settings(width, height), this.#columns, this.node);
  }

  #settings(width, height) {
    const { lines, between, over, y } = this.options;
    return {
      width,
      height,
      padding: [6, 16, this.options.times ? 0 : 6, 0],
      cursor: { show: false },
      legend: { show: false },
      scales: { x: { time: false, range: () => [this.#now - this.#span, this.#now] }, y: { range: y } },
      axes: [this.#timeAxis(), this.#valueAxis()],
      series: [{}, ...lines],
      bands: between && [{ series: between, fill: () => lines[between[0] - 1].stroke() }],
      hooks: { draw: over ? [() => over(this, this.#columns)] : [] },
    };
  }

  #timeAxis() {
    const { scale, times } = this.options;
    const steps = [1, 0.8, 0.6, 0.4, 0.2, 0];
    const label = (value) => (value ? `−${Math.round(10 * value * scale) / 10} ${scale === 1 ? "s" : "ms"}` : "now");
    return {
      size: times ? 26 : 0,
      gap: 7, // clear of the lowest value's label
      font: "12px system-ui, sans-serif",
      stroke: () => palette.soft,
      grid: { stroke: () => palette.rule, width: 1 },
      ticks: { show: false },
      splits: () => steps.map((step) => this.#now - step * this.#span),
      values: () => (times ? steps.map((step) => label(step * this.#span)) : steps.map(() => "")),
    };
  }

  #valueAxis() {
    const { splits, label } = this.options;
    return {
      size: GUTTER,
      gap: 6,
      font: "12px system-ui, sans-serif",
      stroke: () => palette.soft,
      grid: { stroke: () => palette.rule, width: 1 },
      ticks: { show: false },
      splits,
      values: (plot, values) => values.map(label),
    };
  }
}

readPalette();
addEventListener("themechange", readPalette, { capture: true });
