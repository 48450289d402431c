// What designs can be chosen by: histograms of the scores, chips of what there are few kinds of.

import { el, number } from "../core/dom.js";
import { SYMMETRIES } from "../core/copies.js";
import { Brush } from "./brush.js";
import { SCORES } from "./state.js";

export class Panel {
  /** changed(changes): a part of the state, as somebody chose it. */
  constructor(studio, state, changed) {
    this.changed = changed;
    const columns = new Map(studio.catalogue.columns.map((column) => [column.name, column]));
    this.brushes = new Map();
    for (const name of SCORES) {
      if (!columns.has(name)) continue;
      this.brushes.set(name, new Brush(columns.get(name), (range) => changed({ range: [name, range] })));
    }
    this.favourite = this.#toggle("♥ Favourites", () => ({ favourite: !this.state.favourite }));
    this.hand = this.#toggle("By hand", () => ({ hand: !this.state.hand }));
    this.rejected = this.#toggle("With rejected", () => ({ rejected: !this.state.rejected }));
    this.stars = [1, 2, 3, 4, 5].map((stars) =>
      el("button", { class: "star", type: "button", "aria-label": `${stars} stars or more`, onclick: () => changed({ rating: this.state.rating === stars ? 0 : stars }) }, "★"),
    );
    this.maps = el("div", { class: "chips", role: "group", "aria-label": "Number of maps" });
    this.symmetry = el("div", { class: "chips", role: "group", "aria-label": "Symmetry" });
    this.niche = el("input", { class: "field", type: "number", min: "0", step: "1", placeholder: "any", "aria-label": "Niche", onchange: ({ target }) => changed({ niche: target.value === "" ? null : Math.max(0, Math.round(target.valueAsNumber)) }) });
    const kinds = (name, content) => el("section", { class: "kinds" }, el("h3", {}, name), content);
    this.mapsSection = kinds("Maps", this.maps);
    this.symmetrySection = kinds("Symmetry", this.symmetry);
    this.nicheSection = kinds("Niche", this.niche);
    this.element = el(
      "aside",
      { class: "panel", "aria-label": "Filters" },
      el("section", { class: "kinds" }, el("h3", {}, "Yours"), el("div", { class: "chips" }, this.favourite, this.hand, this.rejected), el("div", { class: "rate", role: "group", "aria-label": "Rating" }, this.stars)),
      ...[...this.brushes.values()].map((brush) => brush.element),
      this.mapsSection,
      this.symmetrySection,
      this.nicheSection,
    );
    this.update(state);
  }

  #toggle(text, change) {
    return el("button", { class: "chip", type: "button", onclick: () => this.changed(change()) }, text);
  }

  /** Show what is chosen. */
  update(state) {
    this.state = state;
    const pressed = (button, on) => button.setAttribute("aria-pressed", String(on));
    pressed(this.favourite, state.favourite);
    pressed(this.hand, state.hand);
    pressed(this.rejected, state.rejected);
    this.stars.forEach((star, i) => pressed(star, i < state.rating));
    for (const [name, brush] of this.brushes) brush.setRange(state.ranges[name] ?? [null, null]);
    this.niche.value = state.niche ?? "";
    for (const [list, chosen] of [[this.maps, state.maps], [this.symmetry, state.symmetry]]) {
      for (const chip of list.children) pressed(chip, chosen.includes(Number(chip.value)));
    }
  }

  /** Show how many there are of each, by the query. */
  recount(query) {
    for (const [name, brush] of this.brushes) brush.update(query.histogram(name), this.state.ranges[name] ?? [null, null]);
    this.#chips(this.maps, this.mapsSection, "maps", query.tally("n_maps"), (value) => `${value}`);
    this.#chips(this.symmetry, this.symmetrySection, "symmetry", query.tally("symmetry"), (value) => SYMMETRIES[value]?.name ?? "?");
    const [low, high] = query.extent("niche");
    this.nicheSection.hidden = low === high;
  }

  #chips(list, section, name, counts, label) {
    const chosen = this.state[name];
    const known = new Set([...list.children].map((chip) => Number(chip.value)));
    counts.forEach((count, value) => {
      if (!count || known.has(value)) return;
      const change = () => {
        const now = this.state[name];
        this.changed({ [name]: now.includes(value) ? now.filter((one) => one !== value) : [...now, value].sort((a, b) => a - b) });
      };
      list.append(el("button", { class: "chip", type: "button", value: String(value), onclick: change }, label(value), " ", el("small", {})));
    });
    const chips = [...list.children].sort((a, b) => a.value - b.value);
    if (chips.some((chip, i) => chip !== list.children[i])) list.append(...chips);
    for (const chip of chips) {
      chip.querySelector("small").textContent = number(counts[chip.value]);
      chip.setAttribute("aria-pressed", String(chosen.includes(Number(chip.value))));
    }
    section.hidden = chips.length < 2;
  }
}
