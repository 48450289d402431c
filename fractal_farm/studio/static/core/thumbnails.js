// Small pictures, drawn by workers: of what is seen first a sketch of few points, then the finished picture.

const SKETCH = 1000; // points
const FINISHED = 12000;
const AT_ONCE = 3; // sketches in a message; a finished picture goes alone
const MOST_BYTES = 96 * 2 ** 20; // of pictures that are kept
const NUMBERS = 13;

export class Thumbnails {
  #idle = [];
  #tickets = new Map();
  #kept = new Map(); // key -> {image, fine, view}, least recently used first
  #bytes = 0;
  #wanted = []; // what is seen, then what will be
  #begun = new Set();
  #single = [];

  constructor(workers = Math.max(2, Math.min(6, (navigator.hardwareConcurrency || 4) - 1))) {
    this.mapsOf = () => null; // (row) -> Float32Array (13 a map), or null while it is fetched; `pump` when it is there
    this.onpicture = () => {};
    for (let i = 0; i < workers; i++) {
      const worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
      worker.onmessage = ({ data }) => this.#received(worker, data);
      this.#idle.push(worker);
    }
  }

  /** The picture of a key, {image, fine}, or undefined. */
  get(key) {
    const found = this.#kept.get(key);
    if (found) {
      this.#kept.delete(key);
      this.#kept.set(key, found);
    }
    return found;
  }

  /** Say what is wanted now, most urgent first: [{key, row, symmetry, seed, size, colouring, palette, even, seen}]. */
  want(list) {
    this.#wanted = list;
    this.pump();
  }

  /** One picture of maps that are in no catalogue, or of a row, into a canvas. */
  async draw(canvas, request) {
    const sharp = Math.min(globalThis.devicePixelRatio || 1, 2);
    const size = Math.round((canvas.clientWidth || canvas.width) * sharp);
    const maps = request.maps ? joined(request.maps, request.probabilities) : await request.fetched;
    if (!maps) return;
    const job = { seed: 1, even: true, fine: true, count: FINISHED, ...request, maps, size };
    delete job.fetched;
    delete job.probabilities;
    const { buffer } = await new Promise((done) => {
      this.#single.push({ job, done });
      this.pump();
    });
    if (!buffer) return;
    [canvas.width, canvas.height] = [size, size];
    canvas.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(buffer), size, size), 0, 0);
  }

  pump() {
    while (this.#idle.length) {
      const tasks = this.#next();
      if (!tasks.length) return;
      const worker = this.#idle.pop();
      const ticket = ++serial;
      this.#tickets.set(ticket, tasks);
      worker.postMessage({ ticket, jobs: tasks.map((task) => task.job) });
    }
  }

  #next() {
    const sketches = this.#gather((picture) => !picture, false, AT_ONCE, true);
    if (sketches.length) return sketches;
    if (this.#single.length) return [this.#single.shift()];
    const finished = this.#gather((picture) => picture && !picture.fine, true, 1, true);
    if (finished.length) return finished;
    return this.#gather((picture) => !picture, false, AT_ONCE, false);
  }

  #gather(suits, fine, most, seen) {
    const tasks = [];
    for (const wish of this.#wanted) {
      if (tasks.length === most) break;
      if (wish.seen !== seen || this.#begun.has(wish.key)) continue;
      const picture = this.#kept.get(wish.key);
      if (!suits(picture)) continue;
      const maps = this.mapsOf(wish.row);
      if (!maps) continue;
      this.#begun.add(wish.key);
      const { key, row, seen: _, ...how } = wish;
      tasks.push({ key, job: { ...how, maps, fine, count: fine ? FINISHED : SKETCH, view: picture?.view } });
    }
    return tasks;
  }

  #received(worker, { ticket, pictures }) {
    this.#idle.push(worker);
    const tasks = this.#tickets.get(ticket);
    this.#tickets.delete(ticket);
    tasks.forEach(({ key, job, done }, i) => {
      if (done) return done(pictures[i]);
      this.#begun.delete(key);
      const { buffer, view } = pictures[i];
      const size = buffer ? job.size : 1;
      const data = buffer ? new Uint8ClampedArray(buffer) : new Uint8ClampedArray(4);
      this.#keep(key, { image: new ImageData(data, size, size), fine: job.fine || !buffer, view });
      this.onpicture(key);
    });
    this.pump();
  }

  #keep(key, picture) {
    const before = this.#kept.get(key);
    if (before) this.#bytes -= before.image.data.length;
    this.#kept.delete(key);
    this.#kept.set(key, picture);
    this.#bytes += picture.image.data.length;
    for (const [oldest, { image }] of this.#kept) {
      if (this.#bytes <= MOST_BYTES) break;
      this.#kept.delete(oldest);
      this.#bytes -= image.data.length;
    }
  }
}

let serial = 0;

function joined(maps, probabilities) {
  const n = probabilities.length;
  const rows = new Float32Array(NUMBERS * n);
  for (let i = 0; i < n; i++) {
    rows.set(maps.subarray(12 * i, 12 * i + 12), NUMBERS * i);
    rows[NUMBERS * i + 12] = probabilities[i];
  }
  return rows;
}
