// From a genome to maps, probabilities and points: the formulas of fractal_farm/ifs, in a browser or in node.
//
// A genome is the mapping of a genome file: {genes: rows of 7 (or 12), probabilities?: [N], symmetry?: "rotation:6",
// phenotype?: {family, influence, map_form, rotation_sign}}. Maps are Float64Array (N * 12), row-major 3 x 4 [A | b].
// Points are Float32Array (3 * count), x y z of one point after the other, IFS units. Nothing here touches a page.

import { symmetryOf, placeCopies } from "./copies.js";
import { determinant, fixedPoint } from "./algebra.js";

export { SYMMETRIES, symmetryOf, placeCopies } from "./copies.js";
export { evenPoints } from "./cover.js";

const WORDS = 4294967296; // number of 32-bit words
const INCREMENT = 0x9e3779b9;
const OTHER_STREAM = 0x5851f42d; // sets the draws of copies apart from those of maps
const PURPOSES = { fitness: 0, display: 1, repeat: 2 };
const PHENOTYPE = { family: "similarity", influence: 4, map_form: "rho R (x + d)", rotation_sign: 1 };

/** Maps and selection probabilities of a genome, in the order of its rows (eqs 2.1, 3.2 to 3.4). */
export function resolve(genome) {
  const { rows, phenotype, byHand } = read(genome);
  const maps = new Float64Array(12 * rows.length);
  rows.forEach((row, i) => {
    const out = maps.subarray(12 * i, 12 * i + 12);
    if (phenotype.family === "affine") out.set(row);
    else resolveSimilarity(row, phenotype.map_form === PHENOTYPE.map_form, phenotype.rotation_sign, out);
  });
  if (byHand) return { maps, probabilities: Float64Array.from(byHand) };
  // Ties for the largest probability are broken in canonical order.
  const order = canonicalOrder(rows);
  const floored = flooredProbabilities(reordered(maps, order), rows.length, phenotype.influence);
  const probabilities = new Float64Array(rows.length);
  order.forEach((from, place) => (probabilities[from] = floored[place]));
  return { maps, probabilities };
}

/**
 * What starts a random stream: {first, second} 32-bit keys, and the canonical order of a genome's rows.
 *
 * Of a genome, with its purpose ("fitness", "display" or "repeat") and repeat, points agree with those of Python.
 * Of a design id (32 hex digits) or a number they are as good, but others.
 */
export function seedOf(source, purpose = "fitness", repeat = 0) {
  const stream = PURPOSES[purpose] + 3 * repeat;
  let keys, order;
  if (typeof source === "number") keys = [scramble(source >>> 0), scramble(~source >>> 0)];
  else if (typeof source === "string") keys = [0, 8].map((at) => parseInt(source.slice(at, at + 8) || "0", 16) >>> 0);
  else {
    const { rows } = read(source);
    order = canonicalOrder(rows);
    keys = contentKeys(order.map((i) => rows[i]));
  }
  return { first: scramble(keys[0] ^ stream), second: scramble(keys[1] + stream), order };
}

/**
 * Points of the attractor by random iteration, spread over its copies if there is a symmetry.
 *
 * maps (N * 12) and probabilities (N) as `resolve` gives them (Float32Array does); seed as `seedOf` gives it, or what
 * it takes; symmetry a name or its code; out a Float32Array to fill, if one is to be used again.
 */
export function randomIteration(maps, probabilities, count, seed, symmetry = "none", out = new Float32Array(3 * count)) {
  const stream = seed && typeof seed === "object" && "first" in seed ? seed : seedOf(seed ?? 0);
  const n = probabilities.length;
  const order = stream.order ?? Array.from({ length: n }, (_, i) => i);
  const own = reordered(maps, order);
  const shares = order.map((i) => probabilities[i]);
  const thresholds = new Uint32Array(8).fill(WORDS - 1);
  let sum = 0;
  let likeliest = 0;
  shares.forEach((share, i) => {
    sum += share;
    thresholds[i] = Math.min(sum * WORDS, WORDS - 1);
    if (share > shares[likeliest]) likeliest = i;
  });
  iterate(own, thresholds, n, fixedPoint(own, 12 * likeliest), stream, count, out);
  if (symmetryOf(symmetry).copies > 1) spreadOverCopies(placeCopies(symmetry, own, n), stream, count, out);
  return out;
}

/** A bijective 32-bit mixer of low bias. */
export function scramble(word) {
  let x = word >>> 0;
  x ^= x >>> 16;
  x = Math.imul(x, 0x21f0aaad);
  x ^= x >>> 15;
  x = Math.imul(x, 0x735a2d97);
  return (x ^ (x >>> 15)) >>> 0;
}

function iterate(maps, thresholds, n, start, stream, count, out) {
  let [x, y, z] = start;
  let counter = stream.first | 0;
  const second = stream.second | 0;
  const [t0, t1] = thresholds;
  for (let t = 0, o = 0; t < count; t++, o += 3) {
    counter = (counter + INCREMENT) | 0;
    let draw = counter ^ (counter >>> 16);
    draw = Math.imul(draw, 0x21f0aaad) ^ second;
    draw ^= draw >>> 15;
    draw = Math.imul(draw, 0x735a2d97);
    draw = (draw ^ (draw >>> 15)) >>> 0;
    let k = draw >= t0 ? 12 : 0;
    if (n > 2) {
      if (draw >= t1) k += 12;
      for (let j = 2; j < n - 1; j++) if (draw >= thresholds[j]) k += 12;
    }
    const nx = maps[k] * x + maps[k + 1] * y + maps[k + 2] * z + maps[k + 3];
    const ny = maps[k + 4] * x + maps[k + 5] * y + maps[k + 6] * z + maps[k + 7];
    z = maps[k + 8] * x + maps[k + 9] * y + maps[k + 10] * z + maps[k + 11];
    x = nx;
    y = ny;
    out[o] = x;
    out[o + 1] = y;
    out[o + 2] = z;
  }
}

function spreadOverCopies(copies, stream, count, out) {
  const n = copies.length / 12;
  let counter = (stream.first ^ OTHER_STREAM) | 0;
  for (let t = 0, o = 0; t < count; t++, o += 3) {
    counter = (counter + INCREMENT) | 0;
    const m = 12 * Math.floor((scramble(scramble(counter) ^ stream.second) * n) / WORDS);
    const x = out[o];
    const y = out[o + 1];
    const z = out[o + 2];
    for (let row = 0; row < 3; row++) {
      const c = m + 4 * row;
      out[o + row] = copies[c] * x + copies[c + 1] * y + copies[c + 2] * z + copies[c + 3];
    }
  }
}

/** Eq 3.2: row-major [rho R | rho R d] (or [rho R | d]), R = R_z(roll) R_x(pitch) R_y(yaw). */
function resolveSimilarity(gene, offsetInside, sign, out) {
  const [pitch, yaw, roll] = [sign * gene[0], sign * gene[1], sign * gene[2]];
  const rho = gene[3];
  const [cp, sp, cy] = [Math.cos(pitch), Math.sin(pitch), Math.cos(yaw)];
  const [sy, cr, sr] = [Math.sin(yaw), Math.cos(roll), Math.sin(roll)];
  out[0] = rho * (cr * cy - sr * sp * sy);
  out[1] = rho * (-sr * cp);
  out[2] = rho * (cr * sy + sr * sp * cy);
  out[4] = rho * (sr * cy + cr * sp * sy);
  out[5] = rho * (cr * cp);
  out[6] = rho * (sr * sy - cr * sp * cy);
  out[8] = rho * (-cp * sy);
  out[9] = rho * sp;
  out[10] = rho * (cp * cy);
  for (let k = 0; k < 12; k += 4) {
    out[k + 3] = offsetInside ? out[k] * gene[4] + out[k + 1] * gene[5] + out[k + 2] * gene[6] : gene[4 + k / 4];
  }
}

/** Eqs 3.3 and 3.4: proportional to |det A|, at least 1 / (influence N); the largest gives what was added to others. */
function flooredProbabilities(maps, n, influence) {
  const out = new Float64Array(n);
  let total = 0;
  for (let i = 0; i < n; i++) {
    out[i] = Math.abs(determinant(maps, 12 * i));
    total += out[i];
  }
  const floor = 1 / (influence * n);
  let debt = 0;
  for (let i = 0; i < n; i++) {
    out[i] = total > 0 ? out[i] / total : 1 / n;
    if (out[i] < floor) {
      debt += floor - out[i];
      out[i] = floor;
    }
  }
  for (let turn = 0; turn < n; turn++) {
    let largest = 0;
    for (let i = 1; i < n; i++) if (out[i] > out[largest]) largest = i;
    const payment = Math.min(debt, out[largest] - floor);
    out[largest] -= payment;
    debt -= payment;
  }
  return out;
}

/** Lexicographic order of the rows, equal ones as they stand. */
function canonicalOrder(rows) {
  const before = (a, b) => {
    const at = a.findIndex((value, i) => value !== b[i]);
    return at < 0 ? 0 : a[at] - b[at];
  };
  return rows.map((_, i) => i).sort((i, j) => before(rows[i], rows[j]) || i - j);
}

/** Two 32-bit hashes of the canonical rows, word by word. */
function contentKeys(rows) {
  const view = new DataView(new ArrayBuffer(8));
  let first = 0x8f1bbcdc;
  let second = 0xca62c1d6;
  for (const value of rows.flat()) {
    view.setFloat64(0, value, true);
    for (const at of [0, 4]) {
      const word = view.getUint32(at, true);
      first = scramble(first ^ word);
      second = scramble(second + word);
    }
  }
  return [first, second];
}

function reordered(maps, order) {
  const out = new Float64Array(12 * order.length);
  order.forEach((from, place) => out.set(maps.subarray(12 * from, 12 * from + 12), 12 * place));
  return out;
}

/** Rows (adding 0 turns -0 into 0), phenotype and probabilities by hand; a file of one named genome will do, too. */
function read(genome) {
  let body = genome;
  let shape = genome.phenotype;
  if (genome.genomes) body = Object.values(genome.genomes)[0];
  if (Array.isArray(body)) body = { genes: body };
  shape = { ...PHENOTYPE, ...(shape ?? body.phenotype) };
  const rows = body.genes.map((row) => Array.from(row, (value) => value + 0));
  const width = shape.family === "affine" ? 12 : 7;
  if (rows.some((row) => row.length !== width || !row.every(Number.isFinite))) {
    throw new RangeError(`a ${shape.family} genome has rows of ${width} finite numbers`);
  }
  return { rows, phenotype: shape, byHand: body.probabilities };
}
