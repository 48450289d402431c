// The gallery: what the address says is chosen, in which order, as a grid of pictures.

import { digitsOf } from "../core/code.js";
import { SYMMETRIES } from "../core/copies.js";
import { el, number } from "../core/dom.js";
import { PALETTES } from "../core/colours.js";
import { Grid } from "./grid.js";
import { Panel } from "./panel.js";
import { Query } from "./query.js";
import { readState, written } from "./state.js";
import { Views } from "./views.js";

const SORTS = { fitness: "Fitness", d0: "D0", d2: "D2", lle: "LLE", gap: "Gap", similarity_dimension: "Similarity dimension", grams: "Weight", n_maps: "Maps", rating: "Rating", group_size: "Alike", created: "Made" };
const MOST_CHOSEN = 8;
const MANY = 200_000; // rows above which histograms are counted less often
let left = null; // where the last gallery stood, to come back to

export async function show(main, params, studio) {
  const page = new GalleryPage(main, params.query, studio);
  const end = () => page.destroy();
  end.followed = ({ query }) => page.follow(query);
  return end;
}

class GalleryPage {
  #fresh = 0;
  #recount = 0;
  #address = 0;
  #ready = false;

  constructor(main, query, studio) {
    this.studio = studio;
    this.state = readState(query);
    this.clock = { filter: [], sort: [] };
    studio.clock = this.clock;
    this.chosen = studio.chosen ??= new Set();
    this.query = new Query(studio.table);
    this.grid = new Grid(studio, {
      describe: (row) => this.#describe(row),
      how: (row) => this.#how(row),
      key: (row) => `${row}|${this.state.points}|${this.state.colours}`,
      open: (row) => studio.go("design", studio.idOf(row)),
      judge: (row, what, value) => this.#judge(row, what, value),
      choose: (row) => this.#choose(row),
      chosen: (row) => this.chosen.has(row),
      unfold: (row) => this.change({ like: studio.columns.representative[row], folded: false }),
      ready: () => this.#isReady(),
    });
    this.panel = new Panel(studio, this.state, (changes) => this.change(changes));
    this.#build(main);
    this.#applyAll();
    this.#show(left?.query === written(this.state) ? left.position : null);
    this.endings = [
      studio.on("grown", ({ added }) => this.#grown(added)),
      studio.on("judged", () => this.#judged()),
    ];
    this.repaint = () => requestAnimationFrame(() => this.panel.brushes.forEach((brush) => brush.paint()));
    document.addEventListener("themed", this.repaint);
  }

  #build(main) {
    const { studio } = this;
    this.count = el("p", { class: "count", role: "status", "aria-live": "polite" });
    this.fresh = el("button", { class: "button fresh", type: "button", hidden: true, onclick: () => this.#takeFresh() });
    this.search = el("input", { class: "field search", type: "search", placeholder: "Code or id", "aria-label": "Search by design code or id", spellcheck: "false", oninput: () => this.change({ text: this.search.value.trim() }) });
    const known = new Set(studio.catalogue.columns.map(({ name }) => name));
    const options = Object.entries(SORTS).filter(([name]) => known.has(name));
    this.sort = el("select", { class: "field", "aria-label": "Sort by", onchange: () => this.change({ sort: this.sort.value }) }, options.map(([name, label]) => el("option", { value: name }, label)));
    this.direction = el("button", { class: "button quiet icon", type: "button", onclick: () => this.change({ descending: !this.state.descending }) });
    this.folded = el("button", { class: "chip", type: "button", title: "One design of each shape, the others of its group folded behind it", onclick: () => this.change({ folded: !this.state.folded, like: null }) }, "One of each shape");
    this.points = el("button", { class: "chip", type: "button", title: "Even: every place of the shape alike, as it will print. Otherwise by probability, as in the paper", onclick: () => this.change({ points: this.state.points === "even" ? "density" : "even" }) }, "Even points");
    const tones = [["gradient", "Gradient"], ...Object.keys(PALETTES).map((name) => [`dual:${name}`, name[0].toUpperCase() + name.slice(1)])];
    this.colours = el("select", { class: "field", "aria-label": "Colours", onchange: () => this.change({ colours: this.colours.value }) }, tones.map(([value, label]) => el("option", { value }, label)));
    this.clear = el("button", { class: "button quiet", type: "button", onclick: () => this.#open("") }, "Clear all");
    this.views = new Views(studio, () => written(this.state), (query) => this.#open(query));
    this.filters = el("button", { class: "button quiet filters", type: "button", "aria-expanded": "false", onclick: () => this.#togglePanel() }, "Filters");
    this.tray = el("div", { class: "tray", hidden: true });
    this.nothing = el("div", { class: "nothing", hidden: true }, el("p", {}, "No design is like that."), el("button", { class: "button", type: "button", onclick: () => this.#open("") }, "Show all"));
    this.element = el(
      "div",
      { class: "gallery" },
      this.panel.element,
      el(
        "div",
        { class: "stage" },
        el("div", { class: "bar" }, this.filters, this.count, this.fresh, el("span", { class: "gap" }), this.search, this.folded, this.points, this.colours, el("span", { class: "sorting" }, this.sort, this.direction), this.clear, this.views.element),
        this.grid.element,
        this.nothing,
        this.tray,
      ),
    );
    main.append(this.element);
    this.#controls();
    this.#drawTray();
  }

  /** Some of the state has changed by somebody's hand. */
  change(changes) {
    const start = performance.now();
    if (changes.range) {
      const [name, range] = changes.range;
      this.state = { ...this.state, ranges: { ...this.state.ranges, [name]: range } };
      this.#applyRange(name);
    } else {
      this.state = { ...this.state, ...changes };
      this.#apply(changes);
      this.panel.update(this.state);
      this.#controls();
    }
    const only = Object.keys(changes);
    if (only.every((name) => ["points", "colours"].includes(name))) this.grid.repaint();
    else this.#show(null, start, only.includes("sort") || only.includes("descending"));
    clearTimeout(this.#address);
    this.#address = setTimeout(() => this.#write(), changes.range || "text" in changes ? 300 : 0);
  }

  /** Another address of the gallery, by Back or a link. */
  follow(query) {
    clearTimeout(this.#address);
    if (query === written(this.state)) return true;
    this.state = readState(query);
    this.#applyAll();
    this.panel.update(this.state);
    this.#controls();
    this.#show();
    return true;
  }

  destroy() {
    clearTimeout(this.#address);
    clearTimeout(this.#recount);
    left = { query: written(this.state), position: this.grid.position };
    this.endings.forEach((end) => end());
    document.removeEventListener("themed", this.repaint);
    this.grid.destroy();
  }

  #open(query) {
    location.hash = query ? `#/?${query}` : "#/";
  }

  #write() {
    const query = written(this.state);
    const hash = query ? `#/?${query}` : "#/";
    if (hash !== location.hash && !(query === "" && location.hash === "")) history.pushState(null, "", hash);
  }

  #applyAll() {
    for (const name of this.panel.brushes.keys()) this.#applyRange(name);
    this.#apply(this.state);
  }

  #applyRange(name) {
    const [low, high] = this.state.ranges[name] ?? [null, null];
    this.query.range(name, low, high);
  }

  #apply(changes) {
    const { query, state } = this;
    const { representative } = this.studio.columns;
    if ("maps" in changes) query.among("n_maps", state.maps.length ? state.maps : null);
    if ("symmetry" in changes) query.among("symmetry", state.symmetry.length ? state.symmetry : null);
    if ("favourite" in changes) query.among("favourite", state.favourite ? [1] : null);
    if ("rating" in changes) query.range("rating", state.rating || null, null);
    if ("rejected" in changes && this.studio.columns.rejected) query.among("rejected", state.rejected ? null : [0]);
    if ("hand" in changes && this.studio.columns.by_hand) query.among("by_hand", state.hand ? [1] : null);
    if ("niche" in changes) query.range("niche", state.niche, state.niche);
    if ("folded" in changes) query.where("folded", state.folded ? (row) => representative[row] === row : null);
    if ("like" in changes) query.where("like", state.like === null ? null : (row) => representative[row] === state.like);
    if ("text" in changes) this.#find();
  }

  #find() {
    const { text } = this.state;
    if (!text) return this.query.only("text", null);
    const digits = digitsOf(text);
    this.query.only("text", digits === null ? [] : this.studio.table.rowsBeginning(digits));
  }

  #controls() {
    const { state } = this;
    if (document.activeElement !== this.search) this.search.value = state.text;
    this.sort.value = state.sort;
    this.direction.textContent = state.descending ? "↓" : "↑";
    this.direction.setAttribute("aria-label", state.descending ? "Greatest first; change" : "Least first; change");
    this.colours.value = state.colours;
    this.folded.setAttribute("aria-pressed", String(state.folded));
    this.points.setAttribute("aria-pressed", String(state.points === "even"));
  }

  #show(position = null, start = performance.now(), sorting = false) {
    const sort = this.studio.columns[this.state.sort] ? this.state.sort : "fitness";
    const order = this.query.shown(sort, this.state.descending);
    this.grid.show(order, Boolean(position));
    if (position) this.grid.restore(position);
    this.clock[sorting ? "sort" : "filter"].push(performance.now() - start);
    const all = number(this.query.rows);
    this.count.replaceChildren(el("b", {}, number(order.length)), order.length === this.query.rows ? " designs" : ` of ${all} designs`);
    this.count.dataset.count = order.length;
    this.clear.hidden = written(this.state) === "";
    this.nothing.hidden = order.length > 0;
    // After the pictures have been asked for, and not at each step of a brush: nobody waits for a count.
    this.#recount ||= setTimeout(() => {
      this.#recount = 0;
      if (this.element.isConnected) this.panel.recount(this.query);
    }, this.query.rows > MANY ? 160 : 30);
  }

  #describe(row) {
    const { columns } = this.studio;
    const id = this.studio.idOf(row);
    const code = this.studio.codeOf(row);
    const { sort } = this.state;
    const digits = this.studio.catalogue.columns.find(({ name }) => name === sort)?.digits ?? 3;
    const other = sort === "fitness" || !columns[sort] || ["rating", "group_size"].includes(sort) ? null : `${SORTS[sort]} ${sort === "created" ? new Date(columns.created[row] * 1000).toISOString().slice(0, 10) : number(columns[sort][row], digits)}`;
    const symmetry = columns.symmetry[row] ? SYMMETRIES[columns.symmetry[row]]?.name : null;
    const favourite = columns.favourite[row] === 1;
    const rating = columns.rating[row];
    const fitness = number(columns.fitness[row], 3);
    return {
      id,
      code: code.slice(3, 12),
      favourite,
      rating,
      alike: this.state.folded ? columns.group_size[row] : 1,
      facts: [other ?? fitness, other ? null : `${columns.n_maps[row]} maps`, symmetry].filter(Boolean).join(" · "),
      spoken: [`Design ${code}`, `fitness ${fitness}`, other, `${columns.n_maps[row]} maps`, symmetry, rating ? `${rating} stars` : null, favourite ? "favourite" : null].filter(Boolean).join(", "),
    };
  }

  #how(row) {
    const [colouring, palette] = this.state.colours.split(":");
    return { symmetry: this.studio.columns.symmetry[row], seed: this.studio.idOf(row), colouring, palette, even: this.state.points === "even" };
  }

  #judge(row, what, value) {
    const { studio } = this;
    if (!studio.can) return studio.tell("This is a copy to look at: favourites need the studio on your own machine");
    const { favourite, rating } = studio.columns;
    const design_id = studio.idOf(row);
    if (what === "favourite") return studio.judge({ design_id, favourite: !favourite[row] });
    return studio.judge({ design_id, rating: rating[row] === value ? 0 : value });
  }

  #judged() {
    if (this.query.table !== this.studio.table) {
      this.#anew();
      return this.#show(this.grid.position);
    }
    this.query.forget();
    this.#apply({ favourite: 1, rating: 1, rejected: 1 });
    this.grid.refresh();
  }

  #grown(added) {
    this.#fresh += added;
    this.fresh.textContent = `${number(this.#fresh)} new ${this.#fresh === 1 ? "design" : "designs"}: show`;
    this.fresh.hidden = false;
  }

  #takeFresh() {
    this.#fresh = 0;
    this.fresh.hidden = true;
    this.#anew();
    this.#show();
  }

  #anew() {
    this.query = new Query(this.studio.table);
    this.#applyAll();
  }

  #choose(row) {
    if (!this.chosen.delete(row) && this.chosen.size < MOST_CHOSEN) this.chosen.add(row);
    this.grid.refresh();
    this.#drawTray();
  }

  /** Designs that were chosen with the space bar, to breed or to blend. */
  #drawTray() {
    const rows = [...this.chosen];
    this.tray.hidden = !rows.length;
    const pictures = rows.map((row) => {
      const canvas = el("canvas", { width: 56, height: 56 });
      this.studio.thumbnail(canvas, { row, ...this.#how(row) });
      return el("button", { class: "taken", type: "button", "aria-label": `Take out ${this.studio.codeOf(row)}`, onclick: () => this.#choose(row) }, canvas);
    });
    const ids = rows.map((row) => this.studio.idOf(row));
    const morph = rows.length === 2 ? el("a", { class: "button quiet", href: `#/morph/${ids[0]}/${ids[1]}` }, "Blend") : null;
    const breed = this.studio.can ? el("a", { class: "button", href: `#/breed?ids=${ids.join(",")}` }, "Breed") : null;
    this.tray.replaceChildren(...pictures, el("span", { class: "gap" }), ...[morph, breed].filter(Boolean));
  }

  #togglePanel() {
    const open = this.element.classList.toggle("filtering");
    this.filters.setAttribute("aria-expanded", String(open));
    this.panel.brushes.forEach((brush) => brush.paint());
  }

  #isReady() {
    if (this.#ready) return;
    this.#ready = true;
    if (!performance.getEntriesByName("farm:ready").length) performance.mark("farm:ready");
    this.studio.fetchAhead();
  }
}
