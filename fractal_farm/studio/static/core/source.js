// The catalogue behind the pages: its columns and maps, the API of a server, and what changes while somebody looks.

import { designCode, digitsOf } from "./code.js";
import { Table } from "./table.js";
import { Thumbnails } from "./thumbnails.js";

const LOOK = 3000; // milliseconds between looks for new designs
const BLOCKS = 384; // blocks of maps that are kept
const TOKEN = "farm-token";
const NUMBERS = 13;
const FEW = 200_000; // rows up to which columns are read again for somebody else's judgements

/** Read the catalogue: data/catalogue.json, then its columns. */
export async function openStudio() {
  takeToken();
  const coming = asked("data/catalogue.json");
  const thumbnails = new Thumbnails(); // its workers start while the catalogue comes
  const catalogue = await (await coming).json();
  const studio = new Studio(catalogue, thumbnails);
  await studio.load();
  return studio;
}

class Studio {
  #listeners = new Map();
  #blocks = new Map(); // number -> Float32Array, or a Promise of it; least recently used first
  #ahead = false;

  constructor(catalogue, thumbnails) {
    this.catalogue = catalogue;
    this.can = Boolean(catalogue.server);
    this.table = new Table(catalogue.columns);
    this.thumbnails = thumbnails;
    thumbnails.mapsOf = (row) => this.mapsNow(row);
    this.api = {
      get: async (path) => (await asked(`api/${path}`)).json(),
      post: async (path, body) => (await asked(`api/${path}`, body)).json(),
      bytes: async (path, body) => (await asked(`api/${path}`, body)).arrayBuffer(),
    };
  }

  get columns() {
    return this.table.arrays;
  }

  async load() {
    const { version, rows } = this.catalogue;
    this.table.append(await (await asked(`data/${version}/columns.bin?from=0`)).arrayBuffer(), rows);
    if (this.can) setTimeout(() => this.#look(), LOOK);
  }

  /** on("grown" | "judged" | "status", listener) -> a function that ends it. */
  on(event, listener) {
    const listeners = this.#listeners.get(event) ?? this.#listeners.set(event, new Set()).get(event);
    listeners.add(listener);
    return () => listeners.delete(listener);
  }

  emit(event, detail) {
    for (const listener of this.#listeners.get(event) ?? []) listener(detail);
  }

  idOf(row) {
    return this.table.idOf(row);
  }

  codeOf(row) {
    return designCode(this.table.idOf(row).slice(0, 32));
  }

  /** The row of an id, a code, or the beginning of one; undefined if there is none. */
  rowOf(text) {
    const digits = digitsOf(text);
    return digits ? this.table.rowsBeginning(digits, 1)[0] : undefined;
  }

  go(page, ...parts) {
    location.hash = `#/${[page, ...parts].filter(Boolean).join("/")}`;
  }

  async details(row) {
    if (this.can) return this.api.get(`design/${this.idOf(row)}`);
    const { version, block } = this.catalogue;
    const number = Math.floor(row / block);
    this.detailBlocks ??= new Map();
    if (!this.detailBlocks.has(number)) {
      this.detailBlocks.set(number, asked(`data/${version}/details/${number}.json`).then((answer) => answer.json()));
    }
    return (await this.detailBlocks.get(number))[row % block];
  }

  /** Maps of a row, Float32Array (maps_per_row * 13), when they are there. */
  async maps(row) {
    for (;;) {
      const found = this.mapsNow(row);
      if (found) return found;
      await new Promise((done) => {
        const end = this.on("maps", () => (end(), done()));
      });
    }
  }

  /** Maps of a row, or null while they are fetched ("maps" is emitted, and thumbnails go on, when some have come). */
  mapsNow(row) {
    const { block, maps_per_row: most } = this.catalogue;
    const number = Math.floor(row / block);
    const held = this.#blocks.get(number);
    if (held instanceof Float32Array) {
      this.#blocks.delete(number);
      this.#blocks.set(number, held);
      const at = (row % block) * most * NUMBERS;
      return at < held.length ? held.slice(at, at + most * NUMBERS) : null;
    }
    if (!held) this.#fetchBlock(number);
    return null;
  }

  #fetchBlock(number) {
    const { version } = this.catalogue;
    const coming = asked(`data/${version}/maps/${number}.bin`)
      .then((answer) => answer.arrayBuffer())
      .then((buffer) => {
        this.#blocks.set(number, new Float32Array(buffer));
        for (const oldest of this.#blocks.keys()) {
          if (this.#blocks.size <= BLOCKS) break;
          this.#blocks.delete(oldest);
        }
      })
      .catch((error) => {
        this.emit("status", { error: error.message });
        return new Promise((done) => setTimeout(done, 1000)).then(() => this.#blocks.delete(number));
      })
      .then(() => this.#arrived());
    this.#blocks.set(number, coming);
  }

  /** Fetch the blocks that are not there, one after the other, while nothing else is to do; as many as are kept. */
  async fetchAhead() {
    const { block, rows } = this.catalogue;
    if (this.#ahead || rows > block * BLOCKS) return;
    this.#ahead = true;
    for (let number = 0; number * block < rows; number++) {
      await new Promise((done) => (globalThis.requestIdleCallback ?? setTimeout)(done, { timeout: 500 }));
      if (this.#blocks.has(number)) continue;
      this.#fetchBlock(number);
      await this.#blocks.get(number);
    }
  }

  #arrived() {
    this.emit("maps");
    this.thumbnails.pump();
  }

  /** A small picture into a canvas: {row} or {maps, probabilities, symmetry, seed}; see thumbnails.js. */
  async thumbnail(canvas, request) {
    if (request.row === undefined) return this.thumbnails.draw(canvas, request);
    const { row, ...how } = request;
    const symmetry = this.columns.symmetry[row];
    return this.thumbnails.draw(canvas, { symmetry, seed: this.idOf(row), fetched: this.maps(row), ...how });
  }

  /** A favourite or stars, shown at once and written down by the server; taken back if it refuses. */
  async judge({ design_id: id, favourite, rating }) {
    const row = this.table.rowsBeginning(id, 1)[0];
    const { favourite: hearts, rating: stars } = this.columns;
    const before = [hearts[row], stars[row]];
    if (favourite !== undefined) hearts[row] = favourite ? 1 : 0;
    if (rating !== undefined) stars[row] = rating;
    this.emit("judged", { row });
    try {
      const told = { design_id: id };
      if (favourite !== undefined) told.favourite = Boolean(favourite);
      if (rating !== undefined) told.rating = rating;
      await this.api.post("judge", told);
    } catch (error) {
      [hearts[row], stars[row]] = before;
      this.emit("judged", { row });
      this.emit("status", { error: error.message });
    }
  }

  async #look() {
    try {
      const now = await (await asked("data/catalogue.json")).json();
      const before = this.catalogue;
      if (now.epoch !== before.epoch || (now.judged !== before.judged && now.rows <= FEW)) await this.#reread(now);
      else if (now.rows > before.rows) await this.#grow(now);
      else Object.assign(before, { live: now.live, runs: now.runs, version: now.version, judged: now.judged });
    } catch (error) {
      this.emit("status", { error: error.message, quiet: true });
    }
    setTimeout(() => this.#look(), document.hidden ? 4 * LOOK : LOOK);
  }

  async #grow(now) {
    const added = now.rows - this.catalogue.rows;
    const url = `data/${now.version}/columns.bin?from=${this.catalogue.rows}`;
    this.table.append(await (await asked(url)).arrayBuffer(), added);
    this.#changed(now, added);
  }

  async #reread(now) {
    const table = new Table(now.columns);
    table.append(await (await asked(`data/${now.version}/columns.bin?from=0`)).arrayBuffer(), now.rows);
    const added = now.rows - this.catalogue.rows;
    this.table = table;
    this.#changed(now, added);
    this.emit("judged", {});
  }

  #changed(now, added) {
    const last = Math.floor((this.catalogue.rows - 1) / this.catalogue.block);
    if (this.#blocks.get(last) instanceof Float32Array) this.#blocks.delete(last);
    if (now.maps_per_row !== this.catalogue.maps_per_row) {
      this.#blocks.clear();
    }
    Object.assign(this.catalogue, now);
    if (added > 0) this.emit("grown", { added });
  }
}

/** The token of the address goes into the session, and out of the address bar. */
function takeToken() {
  const address = new URL(location.href);
  const token = address.searchParams.get("token");
  if (!token) return;
  sessionStorage.setItem(TOKEN, token);
  address.searchParams.delete("token");
  history.replaceState(null, "", address);
}

/** The answer to a GET, or to a POST of a body as JSON; a refusal becomes an Error with its one line. */
async function asked(path, body) {
  const how = body === undefined ? {} : { method: "POST", body: JSON.stringify(body) };
  if (body !== undefined) {
    how.headers = { "Content-Type": "application/json", "X-Farm-Token": sessionStorage.getItem(TOKEN) ?? "" };
  }
  const answer = await fetch(path, how).catch(() => {
    throw new Error("the studio does not answer; is `farm studio` still running?");
  });
  if (answer.ok) return answer;
  const told = await answer.json().catch(() => ({}));
  throw Object.assign(new Error(told.error ?? `${path.split("?")[0]}: ${answer.status}`), { status: answer.status });
}
