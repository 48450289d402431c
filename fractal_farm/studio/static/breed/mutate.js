// Children of chosen parents: block crossover (eq 3.5) and normal mutation (eq 3.6) with strength and locks. Pure.

import { scramble } from "../core/ifs.js";
import { bounded, copyOf, isSimilarity, RHO } from "../tune/genes.js";

const CROSSOVER = 0.6; // of the children of two or more parents
const ALLELES = 0.5; // share of alleles that mutate
const RHO_SHARE = 0.35; // of the strength: rho spans 1 where angles span 2 pi
const AFFINE_SHARE = 0.25;

/** A stream of uniform numbers in [0, 1) from a seed: the same children again for the same generation. */
export function uniform(seed) {
  let counter = seed >>> 0;
  return () => scramble((counter = (counter + 0x9e3779b9) >>> 0)) / 4294967296;
}

function normal(draw) {
  return Math.sqrt(-2 * Math.log(1 - draw())) * Math.cos(2 * Math.PI * draw());
}

/**
 * `count` children of parents (genomes of any N); {strength, seed, locks: Set of genes (0-6), maps: Set of locked maps}.
 * Each tells its `parents` (places in the list).
 */
export function childrenOf(parents, { count = 16, strength = 0.1, seed = 1, locks = new Set(), maps = new Set() } = {}) {
  return Array.from({ length: count }, (_, index) => {
    const draw = uniform(scramble(seed * 65537 + index));
    const first = index % parents.length;
    let child = copyOf(parents[first]);
    delete child.probabilities; // shares follow from rho: what breeds has none by hand
    const made = [first];
    const mates = parents.map((_, i) => i).filter((i) => i !== first && parents[i].genes[0].length === child.genes[0].length);
    if (mates.length && draw() < CROSSOVER) {
      const second = mates[Math.floor(draw() * mates.length)];
      child = crossed(child, parents[second], draw, locks, maps);
      made.push(second);
    }
    return { genome: mutated(child, strength, draw, locks, maps), parents: made };
  });
}

function crossed(child, other, draw, locks, maps) {
  const rows = 1 + Math.floor(draw() * Math.min(child.genes.length, other.genes.length));
  const columns = 1 + Math.floor(draw() * (child.genes[0].length - 1));
  const genes = child.genes.map((row, i) =>
    row.map((allele, j) => (i < rows && j < columns && !locks.has(j) && !maps.has(i) ? other.genes[i][j] : allele)));
  return { ...child, genes };
}

function mutated(genome, strength, draw, locks, maps) {
  const named = isSimilarity(genome);
  const genes = genome.genes.map((row, i) => row.map((allele, j) => {
    const chosen = draw() < ALLELES;
    const step = strength * normal(draw); // drawn always, so that a lock changes nothing else
    if (!chosen || locks.has(j) || maps.has(i)) return allele;
    if (!named) return allele + AFFINE_SHARE * step * (j % 4 === 3 ? 4 : 0.5);
    return bounded(j, allele + (j === RHO ? RHO_SHARE : 1) * step);
  }));
  return { ...genome, genes };
}
