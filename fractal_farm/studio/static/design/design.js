// The page of one design: look at it, know its scores, have it made, see where it comes from and what is like it.

import { shapeView } from "./shape_view.js";
import { NO_SERVER, button, commandLine, complaint, element, ensureStyles, heading, say, shown } from "./kit.js";
import { numbersTable, scoreTiles } from "./facts.js";
import { pictureStrip } from "./strip.js";
import { solidPanel } from "./solid.js";

export async function show(main, { id }, studio) {
  await ensureStyles();
  const design = await designOf(studio, id);
  const page = element("article", { class: "design-page" });
  const solid = solidPanel(design, studio);
  const view = shapeView({
    genome: design.genome,
    label: `Design ${design.code}`,
    metal: { reason: solid.reason, show: () => solid.showMetal(view.stage), hide: () => solid.hideMetal() },
  });
  solid.onready = () => view.kind.querySelector("[data-value=metal]").click();

  const lineage = panel("Lineage");
  const similar = panel("Similar designs");
  page.append(
    heading(design.design_id, design.code, "design", judging(design, studio)),
    element("div", { class: "beside" },
      view.root,
      element("div", { class: "panels" },
        panel("Scores", scoreTiles(design.scores, design.errors), origin(design)),
        solid.root)),
    lineage,
    similar,
    folded("Maps and probabilities", numbersTable(design)),
    folded("On the command line", ...Object.entries(design.commands ?? {}).map(([what, line]) => commandLine(line, what))),
  );
  main.replaceChildren(page);
  family(design, studio, lineage);
  alike(design, studio, similar);
  return () => {
    view.destroy();
    solid.destroy();
  };
}

/** Everything about a design: from the server, or from an exported gallery. */
export async function designOf(studio, id) {
  if (studio.can) return studio.api.get(`design/${id}`);
  const row = studio.rowOf(id);
  if (row === undefined) throw new Error(`design ${id} is not in this gallery`);
  return studio.details(row);
}

/** The directory of the catalogue as its commands name it. */
export const directoryOf = (design) => design.commands?.show?.match(/^farm show (.+) \S+$/)?.[1] ?? "DIR";

export const panel = (title, ...children) =>
  element("section", { class: "panel", "aria-label": title }, element("h2", {}, title), children);

export const folded = (title, ...children) =>
  element("details", { class: "panel" }, element("summary", {}, element("h2", {}, title)), children);

function origin(design) {
  const parts = [];
  if (design.operator) parts.push(`made by ${design.operator}`);
  const born = design.born ?? {};
  if (Number.isFinite(born.island) && born.run_id && born.run_id !== "hand") {
    parts.push(`island ${born.island}, epoch ${born.epoch}, generation ${born.generation}`);
  }
  if (design.symmetry && design.symmetry !== "none") parts.push(`symmetry ${design.symmetry}`);
  return element("p", { class: "soft small" }, parts.join(" · "), " ", element("code", { class: "identity" }, design.design_id));
}

function judging(design, studio) {
  const judgement = { favourite: false, rating: 0, ...design.judgement };
  const send = async (change) => {
    Object.assign(judgement, change);
    paint();
    try {
      if (studio.rowOf(design.design_id) !== undefined) await studio.judge({ design_id: design.design_id, ...change });
      else await studio.api.post("judge", { design_id: design.design_id, ...change });
    } catch (error) {
      say(complaint(error), "error");
    }
  };
  const off = { disabled: !studio.can, reason: NO_SERVER };
  const heart = button("♥", () => send({ favourite: !judgement.favourite }), { ...off, class: "button quiet liking", title: "Favourite" });
  const stars = [1, 2, 3, 4, 5].map((n) =>
    button("★", () => send({ rating: judgement.rating === n ? 0 : n }), { ...off, class: "rating-star", "aria-label": `${n} of 5 stars` }));
  function paint() {
    heart.setAttribute("aria-pressed", Boolean(judgement.favourite));
    heart.textContent = judgement.favourite ? "♥ Favourite" : "♡ Favourite";
    stars.forEach((star, i) => {
      const on = i < (judgement.rating ?? 0);
      star.setAttribute("aria-pressed", on);
      star.textContent = on ? "★" : "☆";
    });
  }
  paint();
  return element("div", { class: "judging", role: "group", "aria-label": "Your judgement" }, heart, stars);
}

async function family(design, studio, into) {
  const relatives = [
    ...(design.parents ?? []).map((one) => ({ ...one, caption: "parent" })),
    { design_id: design.design_id, row: design.row, genome: design.genome, caption: "this design", here: true },
    ...(design.children ?? []).map((one) => ({ ...one, caption: "child" })),
  ];
  let older = [];
  if (studio.can && design.parents?.length) {
    const near = new Set(relatives.map((one) => one.design_id));
    const { nodes } = await studio.api.get(`design/${design.design_id}/lineage`).catch(() => ({ nodes: [] }));
    older = nodes.filter((one) => !near.has(one.design_id)).slice(0, 10).map((one) => ({ ...one, caption: "ancestor" }));
  }
  into.append(pictureStrip([...older.reverse(), ...relatives], studio, "Lineage: ancestors, parents, this design, children"));
}

async function alike(design, studio, into) {
  const found = studio.can
    ? await studio.api.get(`design/${design.design_id}/similar?limit=12`).catch(() => [])
    : (design.similar ?? []);
  into.hidden = !found.length;
  const pictures = found.filter((one) => one.design_id !== design.design_id)
    .map((one) => ({ ...one, caption: `apart ${shown(one.aligned_distance ?? one.distance, 2)}`, link: `#/morph/${design.design_id}/${one.design_id}` }));
  into.append(pictureStrip(pictures, studio, "Similar designs and their distance"));
}
