// What a gesture does to a genome. Pure: each edit is a function from the genome before the gesture to the next one.

import { resolve } from "../core/ifs.js";
import { GENES, bounded, toShown, toStored, withProbability } from "./genes.js";

/**
 * Edits that mind locks and followers. `follow` () is "stay", "same" or "mirror": what the same gene of other maps does
 * when one is moved; locks is a Set of "map:gene" (gene "p" for the probability).
 */
export function editsOf(locks, follow) {
  return {
    /** Set a gene (or "p") of a map to what somebody reads on a slider. */
    set: (map, gene, value) => (genome) => {
      if (gene === "p") return { ...genome, probabilities: withProbability(Array.from(resolve(genome).probabilities), map, value) };
      const before = toShown(gene, genome.genes[map][gene]);
      const genes = genome.genes.map((row, other) => {
        if (other !== map && (follow() === "stay" || locks.has(`${other}:${gene}`))) return row;
        const next = other === map ? value : toShown(gene, row[gene]) + (follow() === "mirror" ? -1 : 1) * (value - before);
        return row.map((allele, i) => (i === gene ? inside(gene, next) : allele));
      });
      return { ...genome, genes };
    },
    symmetry: (name) => (genome) => {
      const { symmetry: _, ...rest } = genome;
      return name === "none" ? rest : { ...rest, symmetry: name };
    },
    /** Probabilities by eqs 3.3 and 3.4 again. */
    automatic: () => (genome) => {
      const { probabilities: _, ...rest } = genome;
      return rest;
    },
  };
}

/** rho stops at the ends of its slider where mutations would be reflected. */
function inside(gene, value) {
  const { kind, low, high } = GENES[gene];
  if (kind === "ratio") return Math.min(high, Math.max(low, value));
  return bounded(gene, toStored(gene, value));
}
