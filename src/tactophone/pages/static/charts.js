// uPlot, set up once for all charts of the page: no cursor, no legend, time from the right edge.

import uPlot from "./vendor/uPlot.esm.js";

const GUTTER = 46; // px left of every chart, so that the times of all stand below one another
const COLOURS = ["ink", "soft", "rule", "contact", "air", "none", "smooth", "rough", "vibration", "warn"];
const TOUCH_COLOURS = ["none", "smooth", "rough"];
const palette = {};

function readPalette() {
  const style = getComputedStyle(document.documentElement);
  for (const name of COLOURS) palette[name] = style.getPropertyValue(`--${name}`).trim();
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

/** Runs of equal values as coloured blocks: the model output above, the label below. */
export function stripes(plot, [times, predicted, truth]) {
  [[predicted, [1.1, 1.9]], [truth, [0.1, 0.9]]].forEach(([values, rows]) => {
    for (let k = 0, from = 0; k < values.length; k++) {
      if (k + 1 < values.length && values[k + 1] === values[from]) continue;
      if (values[from] >= 0) plot.block([times[from], times[Math.min(k + 1, times.length - 1)]], rows, TOUCH_COLOURS[values[from]]);
      from = k + 1;
    }
  });
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
    this.#plot?.setData(columns);
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

  /** Draw a thin line over the whole height at each of these times. */
  ticks(times, name) {
    const { ctx, bbox } = this.#plot;
    ctx.fillStyle = palette[name];
    for (const time of times) ctx.fillRect(this.#plot.valToPos(time, "x", true), bbox.top, devicePixelRatio, bbox.height);
  }

  /** Fill from one time to another, from one y to another. */
  block([from, to], [low, high], name) {
    const { ctx, bbox } = this.#plot;
    const left = Math.max(this.#plot.valToPos(from, "x", true), bbox.left);
    const right = Math.min(this.#plot.valToPos(to, "x", true), bbox.left + bbox.width);
    const top = this.#plot.valToPos(high, "y", true);
    ctx.fillStyle = palette[name];
    ctx.fillRect(left, top, Math.max(right - left, 0), this.#plot.valToPos(low, "y", true) - top);
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
      padding: [6, 5, this.options.times ? 0 : 6, 0],
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
    const label = (value) => (value ? `−${Math.round(10 * value * scale) / 10}` : "0");
    return {
      size: times ? 22 : 0,
      gap: 3,
      font: "11px system-ui, sans-serif",
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
      font: "11px system-ui, sans-serif",
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
