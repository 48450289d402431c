// The columns of a catalogue as typed arrays, which grow behind.

const KINDS = { f4: Float32Array, u4: Uint32Array, u1: Uint8Array };
const ID = 16; // bytes

export class Table {
  constructor(columns) {
    this.columns = columns;
    this.rows = 0;
    this.room = 0;
    this.arrays = {};
  }

  /** Take the bytes of some rows more; those of the first are not copied. */
  append(buffer, rows) {
    const pieces = {};
    let at = 0;
    for (const { name, type } of this.columns) {
      const numbers = type === "id" ? ID * rows : rows;
      const kind = KINDS[type] ?? Uint8Array;
      pieces[name] = new kind(buffer, at, numbers);
      at += Math.ceil((numbers * kind.BYTES_PER_ELEMENT) / 8) * 8;
    }
    if (at !== buffer.byteLength) throw new Error(`the columns are ${buffer.byteLength} bytes; ${at} were expected`);
    if (this.rows === 0) {
      this.arrays = pieces;
      this.room = rows;
    } else {
      if (this.rows + rows > this.room) this.#grow(Math.max(this.rows + rows, Math.ceil(1.5 * this.room)));
      for (const { name, type } of this.columns) this.arrays[name].set(pieces[name], this.rows * (type === "id" ? ID : 1));
    }
    this.rows += rows;
  }

  #grow(room) {
    for (const { name, type } of this.columns) {
      const longer = new this.arrays[name].constructor(room * (type === "id" ? ID : 1));
      longer.set(this.arrays[name]);
      this.arrays[name] = longer;
    }
    this.room = room;
  }

  /** 32 hex digits. */
  idOf(row) {
    let text = "";
    for (let i = ID * row; i < ID * row + ID; i++) text += this.arrays.design_id[i].toString(16).padStart(2, "0");
    return text;
  }

  /** Rows of which the id begins with these hex digits, at most `most`. */
  rowsBeginning(digits, most = Infinity) {
    const found = [];
    const bytes = digits.length >> 1;
    const wanted = Array.from({ length: bytes }, (_, i) => parseInt(digits.slice(2 * i, 2 * i + 2), 16));
    const odd = digits.length % 2 ? parseInt(digits.at(-1), 16) : -1;
    const ids = this.arrays.design_id;
    for (let row = 0; row < this.rows && found.length < most; row++) {
      let i = 0;
      while (i < bytes && ids[ID * row + i] === wanted[i]) i++;
      if (i === bytes && (odd < 0 || ids[ID * row + bytes] >> 4 === odd)) found.push(row);
    }
    return found;
  }
}
