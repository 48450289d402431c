// Symmetries and the copies of an attractor that they ask for: fractal_farm/ifs/symmetry.py and copies.py.

import { determinant, fixedPoint } from "./algebra.js";

const TURNS = 1e-6; // of a map's contraction: with less of a turn it has no axis of its own
const range = (from, to) => Array.from({ length: to - from + 1 }, (_, i) => from + i);
const symmetry = (name, copies, turn, mirrored, carried) => ({ name, copies, turn, mirrored, carried });

/** In the order of their codes, which stand in columns. */
export const SYMMETRIES = [
  symmetry("none", 1, 0, false, false),
  ...range(2, 12).map((n) => symmetry(`rotation:${n}`, n, 1 / n, false, false)),
  symmetry("mirror", 2, 0, true, false),
  ...range(2, 6).map((n) => symmetry(`dihedral:${n}`, 2 * n, 1 / n, true, false)),
  ...range(2, 8).map((n) => symmetry(`helix:${n}`, n, 1 / 6, false, true)),
];

/** A symmetry by its name or code; an unknown one raises RangeError. */
export function symmetryOf(name) {
  const found = typeof name === "number" ? SYMMETRIES[name] : SYMMETRIES.find((one) => one.name === (name ?? "none"));
  if (!found) throw new RangeError(`symmetry is ${name}; allowed: none, rotation:2-12, mirror, dihedral:2-6, helix:2-8`);
  return found;
}

/** The isometries of a symmetry, Float64Array (copies * 12), the identity first; maps in canonical order. */
export function placeCopies(name, maps, n) {
  const { copies: count, turn, mirrored, carried } = symmetryOf(name);
  const copies = new Float64Array(12 * count);
  copies[0] = copies[5] = copies[10] = 1;
  if (count === 1) return copies;
  const { begin, end, axis, across } = frame(maps, n);
  for (let k = 1; k < count; k++) {
    const m = copies.subarray(12 * k, 12 * k + 12);
    turned(2 * Math.PI * turn * (mirrored ? k >> 1 : k), axis, m);
    if (mirrored && k % 2 === 1) reflectFirst(across, m);
    const before = copies.subarray(12 * k - 12, 12 * k);
    for (let r = 0; r < 12; r += 4) {
      // What goes to where: p stays, or the p of this copy goes to the q of the one before.
      const target = carried ? dot(before, r, end) + before[r + 3] : begin[r / 4];
      m[r + 3] = target - dot(m, r, begin);
    }
  }
  return copies;
}

function frame(maps, n) {
  let least = 0;
  let most = 0;
  const sizes = range(0, n - 1).map((i) => Math.abs(determinant(maps, 12 * i)));
  sizes.forEach((size, i) => {
    if (size < sizes[least]) least = i;
    if (size > sizes[most]) most = i;
  });
  const [begin, end] = [fixedPoint(maps, 12 * least), fixedPoint(maps, 12 * most)];
  const m = maps.subarray(12 * least, 12 * least + 12);
  const size = largest([m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]);
  const axis = normalised([m[9] - m[6], m[2] - m[8], m[4] - m[1]], TURNS * size) ?? [0, 0, 1];
  const between = end.map((value, i) => value - begin[i]);
  const aside = Math.abs(axis[2]) < Math.abs(axis[0]) ? [0, 0, 1] : [1, 0, 0];
  const across = normalised(cross(axis, between), TURNS * largest(between)) ?? normalised(cross(axis, aside), 0);
  return { begin, end, axis, across };
}

const dot = (m, at, v) => m[at] * v[0] + m[at + 1] * v[1] + m[at + 2] * v[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const largest = (values) => Math.max(...values.map(Math.abs));

function normalised(vector, least) {
  const size = largest(vector);
  if (!(size > least)) return null;
  const scaled = vector.map((value) => value / size);
  const length = Math.sqrt(scaled[0] ** 2 + scaled[1] ** 2 + scaled[2] ** 2);
  return scaled.map((value) => value / length);
}

/** The rotation about a unit vector through the origin (Rodrigues). */
function turned(angle, [x, y, z], out) {
  const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
  const rest = 1 - cosine;
  out[0] = cosine + rest * x * x;
  out[1] = rest * x * y - sine * z;
  out[2] = rest * x * z + sine * y;
  out[4] = rest * x * y + sine * z;
  out[5] = cosine + rest * y * y;
  out[6] = rest * y * z - sine * x;
  out[8] = rest * x * z - sine * y;
  out[9] = rest * y * z + sine * x;
  out[10] = cosine + rest * z * z;
}

/** Make m do the reflection in the plane through the origin with this unit normal first. */
function reflectFirst(normal, m) {
  for (let row = 0; row < 12; row += 4) {
    const along = dot(m, row, normal);
    for (let column = 0; column < 3; column++) m[row + column] -= 2 * along * normal[column];
  }
}
