// The last seconds of a signal, as columns that a chart can draw without copying.

export class Track {
  #columns;
  #start = 0;
  #end = 0;

  /** Keep `columns` columns of at least `capacity` rows; the first column is time and only grows. */
  constructor(columns, capacity) {
    this.#columns = Array.from({ length: columns }, () => new Float64Array(2 * capacity));
    this.capacity = capacity;
  }

  /** Add rows of a table whose times count from `origin`. */
  append({ rows, columns, numbers }, origin) {
    for (let row = 0; row < rows; row++) {
      this.#makeRoom();
      const at = row * columns;
      this.#columns[0][this.#end] = origin + numbers[at];
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
