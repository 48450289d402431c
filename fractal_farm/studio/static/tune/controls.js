// Sliders and number fields for each gene and the probability of each map, with locks.

import { SYMMETRIES } from "../core/ifs.js";
import { element } from "../design/kit.js";
import { GENES, isSimilarity, toShown } from "./genes.js";

export const MAP_COLOURS = ["#e2606f", "#4fb3e8", "#79c267", "#c08ae8", "#e8a54f", "#4fd0c0", "#d8d25a", "#e88ac0"];
const GESTURE_REST = 500; // milliseconds after which moves by keys or typing are one gesture

/**
 * A panel of controls. `hand` = {now(), live(change), letGo()}: change(genome) makes the next genome; letGo ends a
 * gesture. Change functions are made by `edits`. Returns {root, update(genome, probabilities), locked(map, gene)}.
 */
export function controls(hand, edits, locks) {
  const fields = [];
  const root = element("div", { class: "maps" });
  const genome = hand.now();
  const many = genome.genes.length;
  genome.genes.forEach((_, map) => {
    const box = element("div", { class: "map", role: "group", "aria-label": `Map ${map + 1}` }, title(map));
    if (isSimilarity(genome)) GENES.forEach((gene, index) => box.append(row(map, index, gene)));
    box.append(row(map, "p", { name: "share", low: 0.01, high: 1 - 0.01 * (many - 1), step: 0.005, help: "how often this map is drawn" }));
    root.append(box);
  });

  function title(map) {
    const dot = element("i", {});
    dot.style.background = MAP_COLOURS[map % MAP_COLOURS.length];
    return element("h3", {}, dot, `Map ${map + 1}`);
  }

  function row(map, index, gene) {
    const name = `Map ${map + 1} ${gene.name}`;
    const unit = gene.kind === "angle" ? ", degrees" : "";
    const key = `${map}-${gene.name}`;
    const slider = element("input", { type: "range", min: gene.low, max: gene.high, step: gene.step, "aria-label": `${name}${unit}`, "data-gene": key, title: gene.help });
    const number = element("input", { type: "number", step: gene.step, "aria-label": `${name}${unit}, number`, "data-number": key });
    const lock = element("button", { type: "button", class: "lock", "aria-label": `Lock ${name}`, "aria-pressed": "false", title: "Lock: followers and mutations leave it" }, "🔒\uFE0E");
    const line = element("div", { class: "gene" }, element("span", { title: gene.help }, gene.name), slider, number, lock);
    let rest = 0;
    const live = (value) => Number.isFinite(value) && hand.live(edits.set(map, index, value));
    const soon = () => {
      clearTimeout(rest);
      rest = setTimeout(hand.letGo, GESTURE_REST);
    };
    slider.addEventListener("input", () => live(slider.valueAsNumber));
    let byPointer = false;
    slider.addEventListener("pointerdown", () => (byPointer = true));
    slider.addEventListener("change", () => {
      if (byPointer) hand.letGo();
      else soon();
      byPointer = false;
    });
    number.addEventListener("input", () => (live(number.valueAsNumber), soon()));
    number.addEventListener("change", () => (clearTimeout(rest), hand.letGo()));
    number.addEventListener("blur", () => update(hand.now()));
    lock.addEventListener("click", () => {
      const id = `${map}:${index}`;
      const on = !locks.has(id);
      if (on) locks.add(id);
      else locks.delete(id);
      lock.setAttribute("aria-pressed", on);
      line.classList.toggle("locked", on);
      slider.disabled = number.disabled = on;
    });
    fields.push({ map, index, slider, number });
    return line;
  }

  function update(now, probabilities) {
    for (const { map, index, slider, number } of fields) {
      const value = index === "p" ? probabilities?.[map] : toShown(index, now.genes[map][index]);
      if (value === undefined) continue;
      if (index !== "p" && GENES[index].kind === "offset" && Math.abs(value) > Number(slider.max)) {
        slider.max = Math.ceil(Math.abs(value));
        slider.min = -slider.max;
      }
      slider.value = value;
      if (document.activeElement !== number) number.value = Number(value.toFixed(index === "p" || GENES[index].kind !== "angle" ? 4 : 2));
    }
  }

  return { root, update };
}

/** A select of all symmetries; onchange(name). */
export function symmetrySelect(value, onchange) {
  const select = element("select", { "aria-label": "Symmetry" }, SYMMETRIES.map(({ name }) => element("option", { value: name }, name === "none" ? "none" : name.replace(":", " × "))));
  select.value = value;
  select.addEventListener("change", () => onchange(select.value));
  return select;
}
