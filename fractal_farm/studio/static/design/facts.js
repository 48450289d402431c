// Numbers of a design with their meaning: scores, resolved maps and probabilities, certificate with remedies.

import { resolve } from "../core/ifs.js";
import { element, shown } from "./kit.js";

export const SCORES = [
  { key: "fitness", name: "Fitness", digits: 3, full: 1, meaning: "How close the scores are to what people prefer (eq. 3.7); 0 to 1." },
  { key: "d0", name: "D0", digits: 2, full: 3, meaning: "Capacity dimension: how much space the shape fills, from a dust (0) over curves (1) and surfaces (2) to a body (3)." },
  { key: "d2", name: "D2", digits: 2, full: 3, meaning: "Correlation dimension: the same, weighed by how often places are visited." },
  { key: "lle", name: "LLE", digits: 2, meaning: "Lyapunov exponent, nats a step: how fast the copies shrink." },
  { key: "gap", name: "Gap", digits: 4, meaning: "Widest gap between pieces over the size: below wall / size the design prints in one piece." },
  { key: "similarity_dimension", name: "Similarity dim.", digits: 2, full: 3, meaning: "Dimension that the contraction ratios alone foresee." },
  { key: "grams", name: "Silver", digits: 1, unit: "g", meaning: "Estimated weight at 30 mm in sterling silver." },
];

/** Tiles of the scores: {root, update(scores, errors, {stale, before})}. */
export function scoreTiles(scores, errors = {}) {
  const root = element("dl", { class: "scores" });
  const tiles = new Map(SCORES.map((score) => {
    const value = element("dd", {});
    const bar = element("span", { class: "meter", "aria-hidden": "true" }, element("i"));
    const tile = element("div", { class: "score", title: score.meaning, "data-score": score.key },
      element("dt", {}, score.name), value, score.full ? bar : null);
    root.append(tile);
    return [score.key, { score, value, bar, tile }];
  }));
  root.update = (now, margins = {}, { stale = false, before = null } = {}) => {
    root.classList.toggle("stale", stale);
    for (const { score, value, bar, tile } of tiles.values()) {
      const number = now?.[score.key];
      tile.hidden = number === undefined;
      const margin = margins?.[score.key];
      const was = before?.[score.key];
      const change = Number.isFinite(was) && Number.isFinite(number) ? number - was : 0;
      const small = 0.5 * 10 ** -score.digits;
      value.replaceChildren(shown(number, score.digits), score.unit ? ` ${score.unit}` : "",
        margin ? element("small", {}, ` ± ${shown(margin, score.digits)}`) : "",
        Math.abs(change) > small ? element("small", { class: change > 0 ? "up" : "down" }, ` ${change > 0 ? "▲" : "▼"} ${shown(Math.abs(change), score.digits)}`) : "");
      if (score.full) bar.firstChild.style.width = `${100 * Math.min(1, Math.max(0, (number ?? 0) / score.full))}%`;
    }
  };
  root.update(scores, errors);
  return root;
}

/** Maps x -> A x + b and how often each is drawn. */
export function numbersTable(design) {
  const own = resolve(design.genome);
  const matrices = own.probabilities.length;
  const rows = [];
  for (let map = 0; map < matrices; map++) {
    for (let line = 0; line < 3; line++) {
      const numbers = Array.from(own.maps.subarray(12 * map + 4 * line, 12 * map + 4 * line + 4), (value) => element("td", {}, shown(value, 4)));
      rows.push(element("tr", { class: line === 0 ? "first" : undefined },
        line === 0 && element("th", { rowspan: 3, scope: "row" }, `w${map + 1}`), numbers,
        line === 0 && element("td", { rowspan: 3 }, shown(own.probabilities[map], 4))));
    }
  }
  return element("div", { class: "scroll" }, element("table", { class: "numbers" },
    element("caption", { class: "soft" }, "Each copy is A x + b, drawn with probability P."),
    element("thead", {}, element("tr", {}, ["map", "A", "", "", "b", "P"].map((text) => element("th", { scope: "col" }, text)))),
    element("tbody", {}, rows)));
}

/** What the certificate of a solid says, with a remedy for each finding. */
export function certificateTable(certificate) {
  const facts = [
    ["Material", certificate.material_title ?? certificate.material],
    ["Size", certificate.box_mm ? `${certificate.box_mm.map((side) => shown(side, 1)).join(" × ")} mm` : "–"],
    ["Weight", Number.isFinite(certificate.grams) ? `${shown(certificate.grams, 2)} g` : "–"],
    ["Volume", Number.isFinite(certificate.volume_mm3) ? `${shown(certificate.volume_mm3, 0)} mm³` : "–"],
    ["Thinnest wall", Number.isFinite(certificate.wall_mm) ? `${shown(certificate.wall_mm, 2)} mm` : "–"],
    ["Bodies", certificate.n_bodies],
    ["Watertight", certificate.closed ? "yes" : "no"],
    ["Triangles", certificate.faces?.toLocaleString()],
  ].filter(([, value]) => value !== undefined && value !== null);
  const passed = certificate.verdict === "pass";
  return element("div", { class: "certificate" },
    element("p", { class: `verdict ${passed ? "good" : "bad"}` }, passed ? "✓ May go to the shop" : "✗ Not yet fit to be made"),
    element("dl", { class: "certified" }, facts.map(([name, value]) => [element("dt", {}, name), element("dd", {}, String(value))])),
    element("ul", { class: "remedies" }, (certificate.findings ?? []).map((finding) =>
      element("li", { class: finding.severity === "failure" ? "severe" : undefined }, element("strong", {}, finding.what), ` ${finding.how_much ?? ""}`,
        finding.remedy && element("span", { class: "remedy" }, `Remedy: ${finding.remedy}`)))));
}
