// Points of a cut set of the address tree: every place of the attractor alike, however rarely random iteration would
// visit it (fractal_farm/ifs/cover.py and picture/points.py).

import { contraction, determinant, compose, fixedPoint } from "./algebra.js";
import { placeCopies, symmetryOf } from "./copies.js";
import { randomIteration } from "./ifs.js";

const TRIALS = 6;
const ENOUGH = 0.6; // of the points asked for
const CROWDED = 2.5; // similarity dimension from which pieces lie one over the other
const ALIKE = 1e-6; // relative difference of norm and cube root of determinant of a similarity, in float32

/**
 * About `count` points (0.6 to 2 times as many) of the attractor and its copies, one for each of its pieces of a size.
 *
 * Where the maps overlap heavily, pieces of a size crowd in places: half of the points are then drawn by random
 * iteration, and all of them where no cut set has the size. options: {symmetry, probabilities, seed}.
 */
export function evenPoints(maps, count, { symmetry = "none", probabilities, seed = 1 } = {}) {
  const n = maps.length / 12;
  const shares = probabilities ?? new Float64Array(n).fill(1 / n);
  const tree = treeOf(maps, n);
  const crowded = tree.dimension > CROWDED;
  const wanted = crowded ? count >> 1 : count;
  const copies = placeCopies(symmetry, maps, n);
  const pieces = cutSet(tree, Math.max(1, Math.floor(wanted / symmetryOf(symmetry).copies)));
  if (!pieces) return randomIteration(maps, shares, count, seed, symmetry);
  const covered = copied(pieces, copies);
  if (!crowded) return covered;
  const filled = new Float32Array(covered.length + 3 * (count - wanted));
  filled.set(covered);
  filled.set(randomIteration(maps, shares, count - wanted, seed, symmetry), covered.length);
  return filled;
}

/** s with sum of contraction^s = 1, the similarity dimension (an upper estimate for affine maps). */
export function similarityDimension(maps) {
  return treeOf(maps, maps.length / 12).dimension;
}

// Room that is used again and again.
let points = new Float32Array(0);
let stack = new Float64Array(13 * 256);

function lengthen() {
  const longer = new Float64Array(2 * stack.length);
  longer.set(stack);
  stack = longer;
}

function treeOf(maps, n) {
  const sizes = new Float64Array(n);
  let exact = true;
  for (let i = 0; i < n; i++) {
    const norm = contraction(maps, 12 * i);
    sizes[i] = Math.min(norm, 1 - 1e-9);
    exact &&= Math.abs(Math.cbrt(Math.abs(determinant(maps, 12 * i))) - norm) <= ALIKE * norm;
  }
  let [low, high] = [0, 64];
  for (let step = 0; step < 60; step++) {
    const middle = (low + high) / 2;
    if (sizes.reduce((sum, size) => sum + size ** middle, 0) > 1) low = middle;
    else high = middle;
  }
  return { maps: Float64Array.from(maps), n, sizes, exact, dimension: low, anchor: anchorOf(maps, n) };
}

/** A cut set of about `count` words as points, or null where its size cannot be met. */
function cutSet(tree, count) {
  const step = Math.log(2) / Math.max(tree.dimension, 1e-3);
  let logarithm = -Math.log(count) / Math.max(tree.dimension, 1e-3);
  for (let trial = 0; trial < TRIALS; trial++) {
    const small = Math.exp(logarithm);
    // Of similarities the words can be counted without their maps.
    const words = tree.exact ? wordsBelow(tree, small, 2 * count) : count;
    const pieces = words >= ENOUGH * count && words <= 2 * count ? piecesBelow(tree, small, 2 * count) : null;
    const found = pieces ? pieces.length / 3 : words;
    if (pieces && found >= ENOUGH * count) return pieces;
    if (found > 2 * count || (!pieces && !tree.exact)) logarithm += step;
    else logarithm += (step * Math.log(found / count)) / Math.log(2);
  }
  return null;
}

/** How many first pieces, down the tree, are no larger than `small` times the whole; more than `most` are not counted. */
function wordsBelow({ n, sizes }, small, most) {
  stack[0] = 1;
  let count = 0;
  for (let height = 1; height > 0 && count <= most; ) {
    const size = stack[--height];
    if (size <= small) {
      count++;
      continue;
    }
    if (height + n > stack.length) lengthen();
    for (let i = 0; i < n; i++) stack[height++] = size * sizes[i];
  }
  return count;
}

/** One point of each first piece, down the tree, that is no larger than `small` times the whole; null if too many. */
function piecesBelow({ maps, n, sizes, exact, anchor: [x, y, z] }, small, most) {
  if (points.length < 3 * most) points = new Float32Array(3 * most);
  stack.fill(0, 0, 12);
  stack[0] = stack[5] = stack[10] = stack[12] = 1;
  const word = new Float64Array(13);
  let count = 0;
  for (let height = 1; height > 0; ) {
    height--;
    for (let k = 0, from = 13 * height; k < 13; k++) word[k] = stack[from + k];
    const size = exact ? word[12] : Math.min(word[12], contraction(word));
    if (size <= small) {
      if (count === most) return null;
      points[3 * count] = word[0] * x + word[1] * y + word[2] * z + word[3];
      points[3 * count + 1] = word[4] * x + word[5] * y + word[6] * z + word[7];
      points[3 * count + 2] = word[8] * x + word[9] * y + word[10] * z + word[11];
      count++;
      continue;
    }
    if (13 * (height + n) > stack.length) lengthen();
    for (let i = 0; i < n; i++, height++) {
      compose(word, 0, maps, 12 * i, stack, 13 * height);
      stack[13 * height + 12] = size * sizes[i];
    }
  }
  return points.slice(0, 3 * count);
}

/** A point of the attractor near its middle: of the images of a fixed point the one nearest to their mean. */
function anchorOf(maps, n) {
  let images = Float64Array.from(fixedPoint(maps, 0));
  while ((images.length / 3) * n <= 256) {
    const next = new Float64Array(images.length * n);
    for (let p = 0, o = 0; p < images.length; p += 3) {
      for (let m = 0; m < 12 * n; m += 4, o++) {
        next[o] = maps[m] * images[p] + maps[m + 1] * images[p + 1] + maps[m + 2] * images[p + 2] + maps[m + 3];
      }
    }
    images = next;
  }
  const mean = [0, 0, 0];
  for (let k = 0; k < images.length; k++) mean[k % 3] += (3 * images[k]) / images.length;
  let best = 0;
  let closest = Infinity;
  for (let p = 0; p < images.length; p += 3) {
    const away = (images[p] - mean[0]) ** 2 + (images[p + 1] - mean[1]) ** 2 + (images[p + 2] - mean[2]) ** 2;
    if (away < closest) [best, closest] = [p, away];
  }
  return images.subarray(best, best + 3);
}

function copied(points, copies) {
  const count = points.length;
  const out = new Float32Array((copies.length / 12) * count);
  for (let k = 0, o = 0; k < copies.length; k += 12) {
    for (let i = 0; i < count; i += 3, o += 3) {
      for (let row = 0; row < 3; row++) {
        const c = k + 4 * row;
        out[o + row] = copies[c] * points[i] + copies[c + 1] * points[i + 1] + copies[c + 2] * points[i + 2] + copies[c + 3];
      }
    }
  }
  return out;
}
