// The last seconds of a signal, as columns that a chart can draw. One rule holds for every picture: what is drawn was.
// Time only grows, a jump back begins the picture anew, and where no rows came there is a gap.

/** Seconds without a row from which a picture shows a gap. */
export const GAP = 0.1;
/** Seconds back from which rows are of another pass, or of another run. */
const REWOUND = 0.05;

export class Track {
  #columns;
  #start = 0;
  #end = 0;

  /** Keep `columns` columns of at least `capacity` rows; the first column is time and only grows. */
  constructor(columns, capacity) {
    this.#columns = Array.from({ length: columns }, () => new Float64Array(2 * capacity));
    this.capacity = capacity;
  }

  /** Add rows of a table whose times count from `origin`, the stream time of the message that brought them. */
  append({ rows, columns, numbers }, origin) {
    if (origin < this.newest(0) - REWOUND) this.clear();
    for (let row = 0; row < rows; row++) {
      const at = row * columns;
      const time = origin + numbers[at];
      // A row from the future, or from the past, belongs to the pass before a jump.
      if (numbers[at] > GAP || time < this.newest(0)) continue;
      this.#makeRoom();
      this.#columns[0][this.#end] = time;
      for (let k = 1; k < this.#columns.length; k++) this.#columns[k][this.#end] = numbers[at + k];
      this.#end++;
    }
    this.#start = Math.max(this.#start, this.#end - this.capacity);
  }

  /** Columns of the rows at `since` or later. */
  after(since) {
    let low = this.#start;
    let high = this.#end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.#columns[0][middle] < since) low = middle + 1;
      else high = middle;
    }
    return this.#columns.map((column) => column.subarray(low, this.#end));
  }

  /** A value of the newest row, or NaN. */
  newest(column) {
    return this.#end > this.#start ? this.#columns[column][this.#end - 1] : NaN;
  }

  clear() {
    this.#start = this.#end = 0;
  }

  #makeRoom() {
    if (this.#end < this.#columns[0].length) return;
    for (const column of this.#columns) column.copyWithin(0, this.#end - this.capacity, this.#end);
    this.#start = 0;
    this.#end = this.capacity;
  }
}

/** Where rows follow each other without a gap: [from, to) of each piece, by their times. */
export function pieces(times) {
  const found = [];
  for (let k = 0, from = 0; k < times.length; k++) {
    if (k + 1 < times.length && times[k + 1] - times[k] <= GAP) continue;
    found.push([from, k + 1]);
    from = k + 1;
  }
  return found;
}

/** Intervals without data, from the first row on, up to `end`. */
export function gaps(times, end) {
  const found = [];
  for (const [from, to] of pieces(times)) {
    const next = to < times.length ? times[to] : end;
    if (next - times[to - 1] > GAP) found.push([times[to - 1], next]);
  }
  return found;
}

/** Columns of which a line breaks at each gap: a row of nulls stands there. */
export function broken(columns) {
  const cuts = pieces(columns[0]);
  if (cuts.length < 2) return columns;
  return columns.map((column, k) => cuts.flatMap(([from, to], piece) => {
    const rows = Array.from(column.subarray(from, to));
    if (piece) rows.unshift(k ? null : columns[0][from] - GAP / 2);
    return rows;
  }));
}
