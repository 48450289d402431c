// Which designs are shown, in which order: typed arrays throughout, so that a million of them answer at once.
//
// Every filter owns one bit of a row's mask, set where the row fails; a row is shown where no bit is set. A histogram of
// a column counts the rows that no other filter hides.

export const BINS = 60;
const UNKNOWN = 255; // bin of a number that is not known
const RADIX = 11;

export class Query {
  #bits = new Map();
  #bins = new Map(); // column -> {low, high, bins Uint8Array}
  #orders = new Map(); // the last order
  #extents = new Map();
  #room = [new Uint32Array(0), new Uint32Array(0)];

  constructor(table) {
    this.table = table;
    this.rows = table.rows;
    this.mask = new Uint32Array(this.rows);
  }

  /** Show rows of numbers from low to high (inclusive; null: no bound); both null end the filter. */
  range(name, low, high) {
    if (low === null && high === null) return this.#set(name, null);
    const values = this.table.arrays[name];
    const from = low ?? -Infinity;
    const to = high ?? Infinity;
    const bit = this.#bit(name);
    const { mask, rows } = this;
    for (let row = 0; row < rows; row++) {
      const value = values[row];
      mask[row] = value >= from && value <= to ? mask[row] & ~bit : mask[row] | bit;
    }
  }

  /** Show rows whose number (0 to 255) is one of some; null ends the filter. */
  among(name, wanted, values = this.table.arrays[name]) {
    if (wanted === null) return this.#set(name, null);
    const good = new Uint8Array(256);
    for (const value of wanted) good[value] = 1;
    return this.#set(name, (row) => good[values[row]] === 1);
  }

  /** Show these rows only; null ends the filter. */
  only(name, rows) {
    if (rows === null) return this.#set(name, null);
    const good = new Uint8Array(this.rows);
    for (const row of rows) good[row] = 1;
    return this.#set(name, (row) => good[row] === 1);
  }

  /** Show rows of which a test says so; null ends the filter. */
  where(name, test) {
    return this.#set(name, test);
  }

  /** The rows that are shown, in the order of a column, Uint32Array; unknown numbers come last. */
  shown(column, descending) {
    const order = this.#order(column, descending);
    // The rows that were given out last are still in use while the next are made.
    this.#room.reverse();
    if (this.#room[0].length < this.rows) this.#room[0] = new Uint32Array(this.rows);
    const found = this.#room[0];
    const { mask } = this;
    let count = 0;
    for (let i = 0; i < order.length; i++) {
      const row = order[i];
      found[count] = row; // taken back by the next where it is hidden: no branch to guess
      count += mask[row] === 0 ? 1 : 0;
    }
    return found.subarray(0, count);
  }

  /** {low, high, counts, unknown}: how many of the rows that no other filter hides fall into each bin of a column. */
  histogram(name) {
    const { low, high, bins } = this.#binned(name);
    const others = ~(this.#bits.get(name) ?? 0);
    const counts = new Uint32Array(256);
    const { mask } = this;
    for (let row = 0; row < this.rows; row++) if ((mask[row] & others) === 0) counts[bins[row]]++;
    return { low, high, counts: counts.subarray(0, BINS), unknown: counts[UNKNOWN] };
  }

  /** Counts of a column of small whole numbers, of rows that no other filter hides. */
  tally(name, values = this.table.arrays[name]) {
    const others = ~(this.#bits.get(name) ?? 0);
    const counts = new Uint32Array(256);
    for (let row = 0; row < this.rows; row++) if ((this.mask[row] & others) === 0) counts[values[row]]++;
    return counts;
  }

  #bit(name) {
    if (!this.#bits.has(name)) this.#bits.set(name, 1 << this.#bits.size);
    return this.#bits.get(name);
  }

  #set(name, test) {
    if (test === null && !this.#bits.has(name)) return;
    const bit = this.#bit(name);
    const { mask, rows } = this;
    if (test === null) for (let row = 0; row < rows; row++) mask[row] &= ~bit;
    else for (let row = 0; row < rows; row++) mask[row] = test(row) ? mask[row] & ~bit : mask[row] | bit;
  }

  /** Least and greatest number of a column that are known. */
  extent(name) {
    if (!this.#extents.has(name)) {
      const values = this.table.arrays[name];
      let low = Infinity;
      let high = -Infinity;
      for (let row = 0; row < this.rows; row++) {
        const value = values[row];
        if (value < low) low = value;
        if (value > high) high = value;
      }
      this.#extents.set(name, low <= high ? [low, high] : [0, 0]);
    }
    return this.#extents.get(name);
  }

  #binned(name) {
    if (!this.#bins.has(name)) {
      const values = this.table.arrays[name];
      const [low, high] = this.extent(name);
      const scale = high > low ? BINS / (high - low) : 0;
      const bins = new Uint8Array(this.rows);
      for (let row = 0; row < this.rows; row++) {
        const value = values[row];
        bins[row] = value >= low ? Math.min(BINS - 1, (value - low) * scale) : UNKNOWN;
      }
      this.#bins.set(name, { low, high, bins });
    }
    return this.#bins.get(name);
  }

  #order(column, descending) {
    const key = `${column} ${descending}`;
    if (!this.#orders.has(key)) {
      this.#orders.clear();
      this.#orders.set(key, sortedRows(this.table.arrays[column], this.rows, descending));
    }
    return this.#orders.get(key);
  }

  /** Judgements change columns: their order is found anew. */
  forget() {
    this.#orders.clear();
    for (const name of ["rating", "favourite", "rejected"]) this.#bins.delete(name);
  }
}

/** Row numbers in the order of some numbers, Uint32Array; equal ones as they stand, unknown (NaN) ones last. */
export function sortedRows(values, rows, descending) {
  const keys = sortKeys(values, rows, descending);
  let order = new Uint32Array(rows);
  let sorted = true;
  for (let row = 0; row < rows; row++) {
    order[row] = row;
    if (row > 0 && keys[row] < keys[row - 1]) sorted = false;
  }
  if (sorted) return order;
  let other = new Uint32Array(rows);
  const counts = new Uint32Array(1 << RADIX);
  for (let shift = 0; shift < 32; shift += RADIX) {
    const last = (1 << RADIX) - 1;
    counts.fill(0);
    for (let row = 0; row < rows; row++) counts[(keys[row] >>> shift) & last]++;
    let total = 0;
    for (let i = 0; i <= last; i++) {
      const here = counts[i];
      counts[i] = total;
      total += here;
    }
    for (let i = 0; i < rows; i++) {
      const row = order[i];
      other[counts[(keys[row] >>> shift) & last]++] = row;
    }
    [order, other] = [other, order];
  }
  return order;
}

/** Whole numbers of 32 bits that order as the numbers do. */
function sortKeys(values, rows, descending) {
  const keys = new Uint32Array(rows);
  if (!(values instanceof Float32Array)) {
    for (let row = 0; row < rows; row++) keys[row] = descending ? ~values[row] : values[row];
    return keys;
  }
  const bits = new Uint32Array(values.buffer, values.byteOffset, values.length);
  for (let row = 0; row < rows; row++) {
    const word = bits[row];
    if (values[row] !== values[row]) {
      keys[row] = 0xffffffff;
      continue;
    }
    const ascending = word >>> 31 ? ~word : word | 0x80000000;
    keys[row] = descending ? ~ascending : ascending;
  }
  return keys;
}
