// A strip of small pictures of designs, each a link to its page.

import { resolve } from "../core/ifs.js";
import { element } from "./kit.js";

const SIDE = 112;

/** designs: [{design_id, row | genome, caption, here, link}]; those that are not in the catalogue have no picture. */
export function pictureStrip(designs, studio, label) {
  return element("ul", { class: "strip", "aria-label": label }, designs.map((design) => figure(design, studio)));
}

function figure(design, studio) {
  const canvas = element("canvas", { width: 2 * SIDE, height: 2 * SIDE, "aria-hidden": "true" });
  const row = design.row ?? studio.rowOf(design.design_id);
  const known = row !== undefined && row !== null && row < studio.catalogue.rows;
  if (known) studio.thumbnail(canvas, { row }).catch(() => {});
  else if (design.genome) paintGenome(canvas, design.genome, studio);
  const code = known ? studio.codeOf(row) : design.design_id.slice(0, 8);
  const body = [canvas, element("span", { class: "code" }, code), element("span", { class: "soft" }, design.caption ?? "")];
  const there = known || design.genome;
  return element("li", { class: design.here ? "here" : undefined },
    there && !design.here
      ? element("a", { href: `#/design/${design.design_id}`, "aria-label": `Design ${code}, ${design.caption}` }, body)
      : element("span", { "aria-current": design.here ? "true" : undefined, title: there ? undefined : "not in this catalogue" }, body),
    design.link && element("a", { class: "small soft", href: design.link }, "morph"));
}

/** Draw a genome that need not be in the catalogue into a canvas, away from the page's own thread. */
export function paintGenome(canvas, genome, studio, options = {}) {
  const { maps, probabilities } = resolve(genome);
  return studio.thumbnail(canvas, { maps, probabilities, symmetry: genome.symmetry ?? "none", seed: 1, even: true, ...options });
}
