// Genomes along a way: steps of one parameter (paper Fig 10), or from one design to another. Pure.

import { RHO, about, anglesOf, copyOf, isSimilarity, rotationOf, times, wrapped } from "../tune/genes.js";

/** The rows of Fig 10: pitch, yaw and roll by pi / 60, d1 by 0.25 and rho by 3 %. */
export const SWEEPS = [
  { gene: 0, name: "pitch", step: Math.PI / 60, unit: "3°", written: "pi/60" },
  { gene: 1, name: "yaw", step: Math.PI / 60, unit: "3°", written: "pi/60" },
  { gene: 2, name: "roll", step: Math.PI / 60, unit: "3°", written: "pi/60" },
  { gene: 3, name: "rho", step: 0.03, factor: true, unit: "3 %", written: "3%" },
  { gene: 4, name: "d1", step: 0.25, unit: "0.25", written: "0.25" },
  { gene: 5, name: "d2", step: 0.25, unit: "0.25", written: "0.25" },
  { gene: 6, name: "d3", step: 0.25, unit: "0.25", written: "0.25" },
];

/** {genome, value} for `count` steps (an odd number) about the present value of a gene of a map, scaled by `stride`. */
export function sweepOf(genome, map, { gene, step, factor }, count = 9, stride = 1) {
  const now = genome.genes[map][gene];
  return Array.from({ length: count }, (_, i) => {
    const k = (i - (count - 1) / 2) * stride;
    let value = factor ? now * (1 + step) ** k : now + k * step;
    if (gene < 3) value = wrapped(value);
    if (gene === RHO) value = Math.min(0.999, Math.max(0.001, value));
    const copy = copyOf(genome);
    copy.genes[map][gene] = k === 0 ? now : value;
    return { genome: copy, value: copy.genes[map][gene], now: k === 0 };
  });
}

/** Why two genomes cannot be morphed into each other, or null. */
export function unlike(first, second) {
  if (!isSimilarity(first) || !isSimilarity(second)) return "only similarities (rows of seven genes) can be morphed";
  if (first.genes.length !== second.genes.length) {
    return `one design has ${first.genes.length} maps, the other ${second.genes.length}; choose two of the same number`;
  }
  if ((first.symmetry ?? "none") !== (second.symmetry ?? "none")) return "the designs differ in symmetry";
  return null;
}

/** f(t) with f(0) = first and f(1) = second: rotations by the shortest way, rho geometrically, offsets straight. */
export function morphOf(first, second) {
  const order = matching(first.genes, second.genes);
  return (t) => {
    if (t <= 0) return copyOf(first);
    const copy = copyOf(first);
    delete copy.probabilities;
    copy.genes = first.genes.map((row, i) => between(row, second.genes[order[i]], t));
    return copy;
  };
}

function between(a, b, t) {
  const [from, to] = [rotationOf(a), rotationOf(b)];
  const way = times(to, transposed(from));
  const { axis, angle } = axisOf(way);
  const angles = anglesOf(times(about(axis, angle * t), from), a.map((value, k) => value + t * wrapped(b[k] - value)));
  return [...angles, a[RHO] ** (1 - t) * b[RHO] ** t, ...[4, 5, 6].map((k) => (1 - t) * a[k] + t * b[k])];
}

/** Which map of the second becomes which of the first: the assignment of least change (N is 8 at most). */
function matching(first, second) {
  const cost = first.map((a) => second.map((b) => distance(a, b)));
  let best = null;
  const visit = (chosen, sum) => {
    if (best && sum >= best.sum) return;
    if (chosen.length === first.length) {
      best = { sum, order: chosen };
      return;
    }
    for (let j = 0; j < second.length; j++) {
      if (!chosen.includes(j)) visit([...chosen, j], sum + cost[chosen.length][j]);
    }
  };
  visit([], 0);
  return best.order;
}

function distance(a, b) {
  const { angle } = axisOf(times(rotationOf(b), transposed(rotationOf(a))));
  return angle ** 2 + Math.log(a[RHO] / b[RHO]) ** 2 + [4, 5, 6].reduce((sum, k) => sum + (a[k] - b[k]) ** 2, 0);
}

const transposed = (m) => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];

function axisOf(m) {
  const angle = Math.acos(Math.min(1, Math.max(-1, (m[0] + m[4] + m[8] - 1) / 2)));
  let axis = [m[7] - m[5], m[2] - m[6], m[3] - m[1]];
  if (Math.hypot(...axis) < 1e-9) {
    // Half a turn: the axis is the largest column of M + I.
    const columns = [0, 1, 2].map((j) => [m[j] + (j === 0), m[3 + j] + (j === 1), m[6 + j] + (j === 2)]);
    axis = columns.sort((p, q) => Math.hypot(...q) - Math.hypot(...p))[0];
  }
  const length = Math.hypot(...axis) || 1;
  return { axis: axis.map((value) => value / length), angle };
}
