// The mutation grid: sixteen children of chosen parents; choose among them, breed the next, keep, or let a run grow.

import { designOf, panel } from "../design/design.js";
import { NO_SERVER, button, complaint, element, ensureStyles, heading, say, shown } from "../design/kit.js";
import { paintGenome } from "../design/strip.js";
import { rememberDraft } from "../tune/draft.js";
import { GENES, copyOf, isSimilarity } from "../tune/genes.js";
import { childrenOf } from "./mutate.js";
import { growing } from "./grow.js";

const COUNT = 16;
const SCORED_AT_ONCE = 3;
const KEEP_PARENT = 8; // parents at most

export async function show(main, { ids }, studio) {
  await ensureStyles();
  if (!ids.length) throw new Error("choose designs to breed from: open one, or mark favourites in the gallery");
  const designs = await Promise.all(ids.slice(0, KEEP_PARENT).map((id) => designOf(studio, id)));
  const root = designs[0].design_id;
  const locks = new Set();
  const lockedMaps = new Set();
  const generations = []; // {parents, seed, strength, children, chosen}: to go back to
  let parents = designs.map((design) => ({ genome: copyOf(design.genome), design_id: design.design_id, caption: design.code }));
  let seed = 1;
  let turn = 0;
  let children = [];

  const strength = element("input", { type: "range", min: 0.01, max: 0.6, step: 0.01, value: 0.12, "aria-label": "Strength of mutation", id: "strength" });
  const told = element("output", {}, "0.12");
  strength.addEventListener("input", () => (told.textContent = Number(strength.value).toFixed(2)));
  strength.addEventListener("change", () => fill());
  const grid = element("ul", { class: "children", "aria-label": "Children" });
  const family = element("ul", { class: "strip", "aria-label": "Parents" });
  const status = element("p", { class: "soft small", role: "status" });
  const grow = growing(studio, chosenIds);

  const again = button("Other children", () => (seed++, fill()), { id: "again" });
  const next = button("Breed the next", breedNext, { quiet: false, id: "breed-next" });
  const back = button("↶ Back", goBack, { id: "back" });

  const page = element("article", { class: "design-page" },
    heading(root, designs.length > 1 ? `${designs.length} parents` : designs[0].code, "breed"),
    panel("Parents", family),
    element("section", { class: "panel", "aria-label": "How they are bred" }, element("div", { class: "controls" },
      element("label", {}, element("span", {}, "Strength ", told), strength),
      lockButtons("Locked genes", isSimilarity(designs[0].genome) ? GENES.map((gene, i) => [i, gene.name]) : [], locks),
      lockButtons("Locked maps", Array.from({ length: Math.max(...designs.map((design) => design.genome.genes.length)) }, (_, i) => [i, String(i + 1)]), lockedMaps),
      again, back, next)),
    status, grid, grow.root);
  main.replaceChildren(page);
  fill();

  function lockButtons(legend, names, set) {
    return element("fieldset", {}, element("legend", {}, legend), names.map(([key, text]) => {
      const one = element("button", { type: "button", class: "toggle", "aria-pressed": "false", "aria-label": `Lock ${legend.endsWith("maps") ? "map " : ""}${text}` }, text);
      one.addEventListener("click", () => {
        if (!set.delete(key)) set.add(key);
        one.setAttribute("aria-pressed", set.has(key));
        fill();
      });
      return one;
    }));
  }

  /** Sixteen children of the present parents, drawn and scored as they come. */
  async function fill(kept = null) {
    const mine = ++turn;
    children = kept ?? childrenOf(parents.map((one) => one.genome), { count: COUNT, strength: Number(strength.value), seed, locks, maps: lockedMaps })
      .map((child) => ({ ...child, chosen: false, scores: null }));
    family.replaceChildren(...parents.map((parent) => {
      const canvas = element("canvas", { width: 224, height: 224, "aria-hidden": "true" });
      paintGenome(canvas, parent.genome, studio);
      return element("li", {}, element("span", {}, canvas, element("span", { class: "code" }, parent.caption)));
    }));
    grid.replaceChildren(...children.map(cell));
    refresh();
    if (!studio.can) return;
    const waiting = children.filter((child) => !child.scores);
    const work = async () => {
      for (let child = waiting.shift(); child && mine === turn; child = waiting.shift()) {
        try {
          child.scores = (await studio.api.post("score", { genome: child.genome })).scores;
          child.show();
        } catch (error) {
          child.label.textContent = complaint(error);
        }
      }
    };
    await Promise.all(Array.from({ length: SCORED_AT_ONCE }, work));
  }

  function cell(child, index) {
    const canvas = element("canvas", { width: 256, height: 256, "aria-hidden": "true" });
    child.label = element("span", {}, studio.can ? "…" : `child ${index + 1}`);
    const pick = element("button", { type: "button", class: "select-child", "aria-pressed": "false", "aria-label": `Child ${index + 1}` }, canvas);
    const item = element("li", { class: "child", "data-child": index }, pick, element("footer", {}, child.label,
      button("Tune", () => tune(child), { "aria-label": `Tune child ${index + 1}` }),
      button("Keep", () => keepAndTell(child), { disabled: !studio.can, reason: NO_SERVER, "aria-label": `Keep child ${index + 1}` })));
    child.show = () => {
      if (child.scores) child.label.textContent = `fitness ${shown(child.scores.fitness, 2)} · D0 ${shown(child.scores.d0, 1)}`;
      item.dataset.chosen = child.chosen;
      pick.setAttribute("aria-pressed", child.chosen);
    };
    pick.addEventListener("click", () => {
      child.chosen = !child.chosen;
      child.show();
      refresh();
    });
    child.show();
    paintGenome(canvas, child.genome, studio).then(() => (canvas.dataset.drawn = "true"));
    return item;
  }

  function chosen() {
    return children.filter((child) => child.chosen);
  }

  function refresh() {
    const many = chosen().length;
    next.disabled = many === 0;
    back.disabled = generations.length === 0;
    status.textContent = many
      ? `${many} chosen of generation ${generations.length + 1}: they are the next parents.`
      : `Generation ${generations.length + 1}. Choose the children that you like, then breed the next.`;
    grow.refresh(many);
  }

  function breedNext() {
    generations.push({ parents, seed, children });
    parents = chosen().slice(0, KEEP_PARENT).map((child) => ({ genome: child.genome, design_id: child.kept, caption: `generation ${generations.length}` }));
    seed++;
    fill();
  }

  function goBack() {
    const before = generations.pop();
    if (!before) return;
    ({ parents, seed } = before);
    fill(before.children);
  }

  function tune(child) {
    rememberDraft(root, child.genome);
    studio.go("tune", root);
  }

  /** The id of a child in the catalogue; it is kept there first. */
  async function keep(child) {
    if (!child.kept) {
      const parent = parents[child.parents[0]].design_id ?? root;
      child.kept = (await studio.api.post("keep", { genome: child.genome, parent })).design_id;
    }
    return child.kept;
  }

  async function keepAndTell(child) {
    try {
      const id = await keep(child);
      say(`Kept as ${id.slice(0, 8)}`);
      child.label.replaceChildren(element("a", { href: `#/design/${id}` }, `kept ${id.slice(0, 8)}`));
    } catch (error) {
      say(complaint(error), "error");
    }
  }

  /** What a run grows from: the chosen children, kept; or the parents. */
  async function chosenIds() {
    const found = [];
    for (const child of chosen()) found.push(await keep(child));
    return found.length ? found : designs.map((design) => design.design_id);
  }

  return () => {
    turn++;
    grow.stop();
  };
}
