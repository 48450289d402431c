// A grid of pictures of any length from as many elements as are seen.
//
// The layer sticks to the window of the scroller, and cells are moved in it: what is seen is never blank because the
// page was moved faster than it was drawn. Above MOST_HEIGHT pixels, as browsers cannot scroll further, a long way of
// the scroll bar is stretched, while wheel and keys move pixel by pixel.

import { el, number } from "../core/dom.js";

const MOST_HEIGHT = 8_000_000;
const CAPTION = 44;
const GAP = 14;
const NARROW = 560;

export class Grid {
  #cells = [];
  #order = new Uint32Array(0);
  #offset = 0; // pixels from the top of all rows
  #scrolled = 0;
  #current = 0; // place of the cell that has the focus
  #frame = 0;
  #layout = { across: 1, side: 160, tall: 200, total: 0 };
  #settled = 0;

  /** actions: {describe(row), how(row), key(row), open(row), judge(row, change), choose(row), chosen(row), ready()}. */
  constructor(studio, actions) {
    this.studio = studio;
    this.actions = actions;
    this.longestEmpty = 0;
    this.layer = el("div", { class: "layer", role: "list", "aria-label": "Designs" });
    this.spacer = el("div", { class: "spacer" });
    this.element = el("div", { class: "grid" }, this.layer, this.spacer);
    this.element.addEventListener("scroll", () => this.#onScroll(), { passive: true });
    this.layer.addEventListener("keydown", (event) => this.#onKey(event));
    this.layer.addEventListener("focusin", (event) => {
      const cell = this.#cells.find((one) => one.element.contains(event.target));
      if (cell) this.#current = cell.place;
    });
    this.resized = new ResizeObserver(() => this.#measure());
    this.resized.observe(this.element);
    studio.thumbnails.onpicture = (key) => this.#onPicture(key);
  }

  get order() {
    return this.#order;
  }

  /** Show these rows, from the top unless `keep`. */
  show(order, keep = false) {
    this.#order = order;
    if (!keep) {
      this.#offset = 0;
      this.#current = 0;
    }
    this.#measure(true);
    if (!keep) this.element.scrollTop = this.#scrolled = 0;
  }

  /** Where the grid stands, to come back to. */
  get position() {
    return { offset: this.#offset, current: this.#current };
  }

  restore({ offset, current }) {
    this.#current = Math.min(current, Math.max(0, this.#order.length - 1));
    this.#moveTo(offset);
  }

  /** Captions and marks anew. */
  refresh() {
    for (const cell of this.#cells) if (cell.row >= 0) this.#describe(cell);
  }

  /** All pictures anew (their colours have changed). */
  repaint() {
    for (const cell of this.#cells) cell.key = "";
    this.#place();
  }

  focus() {
    this.#cells.find((cell) => cell.place === this.#current)?.link.focus({ preventScroll: true });
  }

  destroy() {
    this.resized.disconnect();
    cancelAnimationFrame(this.#frame);
    clearTimeout(this.#settled);
    this.studio.thumbnails.onpicture = () => {};
    this.studio.thumbnails.want([]);
  }

  #measure(anew = false) {
    const width = this.element.clientWidth - 2 * GAP;
    if (width <= 0) return;
    const wanted = this.element.clientWidth < NARROW ? 148 : 184;
    const across = Math.max(2, Math.floor((width + GAP) / (wanted + GAP)));
    const side = Math.floor((width - GAP * (across - 1)) / across);
    const before = this.#layout;
    const first = Math.floor(this.#offset / before.tall) * before.across;
    const tall = side + CAPTION + GAP;
    const total = Math.ceil(this.#order.length / across) * tall + GAP;
    this.#layout = { across, side, tall, total, high: this.element.clientHeight };
    this.layer.style.setProperty("--side", `${side}px`);
    this.layer.style.height = `${this.element.clientHeight}px`;
    this.spacer.style.height = `${Math.max(0, Math.min(total, MOST_HEIGHT) - this.element.clientHeight)}px`;
    if (across !== before.across && !anew) this.#offset = Math.floor(first / across) * tall;
    this.#moveTo(this.#offset);
  }

  get #most() {
    return Math.max(0, this.#layout.total - this.element.clientHeight);
  }

  get #ratio() {
    const scrolls = Math.min(this.#layout.total, MOST_HEIGHT) - this.element.clientHeight;
    return scrolls > 0 ? this.#most / scrolls : 1;
  }

  #moveTo(offset) {
    this.#offset = Math.min(Math.max(0, offset), this.#most);
    this.#scrolled = Math.round(this.#offset / this.#ratio);
    this.element.scrollTop = this.#scrolled;
    this.#place();
  }

  #onScroll() {
    const top = this.element.scrollTop;
    const move = top - this.#scrolled;
    if (Math.abs(move) < 1) return;
    const stretched = this.#ratio > 1;
    const end = top >= this.element.scrollHeight - this.element.clientHeight - 1;
    if (!stretched || Math.abs(move) > 2 * this.#layout.high || end) this.#offset = end ? this.#most : top * this.#ratio;
    else this.#offset = Math.min(this.#most, Math.max(0, this.#offset + move));
    this.#scrolled = top;
    this.#frame ||= requestAnimationFrame(() => ((this.#frame = 0), this.#place()));
    if (stretched) {
      clearTimeout(this.#settled);
      this.#settled = setTimeout(() => {
        this.#scrolled = Math.round(this.#offset / this.#ratio);
        this.element.scrollTop = this.#scrolled;
      }, 160);
    }
  }

  /** Give each place that is seen a cell, those that it had if it can be. */
  #place() {
    const { across, side, tall, high } = this.#layout;
    if (!high) return;
    const first = Math.floor(this.#offset / tall) * across;
    const last = Math.min(this.#order.length, (Math.floor((this.#offset + high) / tall) + 1) * across);
    const need = last - first;
    while (this.#cells.length < need) this.#cells.push(this.#newCell());
    const free = [];
    const held = new Map();
    for (const cell of this.#cells) {
      if (cell.place >= first && cell.place < last && this.#order[cell.place] === cell.row) held.set(cell.place, cell);
      else free.push(cell);
    }
    const now = performance.now();
    for (let place = first; place < last; place++) {
      const cell = held.get(place) ?? free.pop();
      const row = this.#order[place];
      if (cell.row !== row || cell.place !== place) {
        [cell.row, cell.place] = [row, place];
        this.#describe(cell);
      }
      const key = `${this.actions.key(row)}|${side}`;
      if (cell.key !== key) {
        cell.key = key;
        cell.since = now;
        this.#paint(cell);
      }
      const x = GAP + (place % across) * (side + GAP);
      const y = GAP + Math.floor(place / across) * tall - this.#offset;
      cell.element.style.transform = `translate(${x}px, ${Math.round(y)}px)`;
      cell.element.hidden = false;
      cell.link.tabIndex = place === this.#current ? 0 : -1;
    }
    for (const cell of free) {
      if (cell.element.hidden) continue;
      cell.element.hidden = true;
      [cell.row, cell.place, cell.key] = [-1, -1, ""];
    }
    if (!this.#cells.some((cell) => cell.place === this.#current) && need > 0) {
      const top = this.#cells.find((cell) => cell.place === first);
      if (top) top.link.tabIndex = 0;
    }
    this.#want(first, last);
  }

  #want(first, last) {
    const { across, side, high, tall } = this.#layout;
    const sharp = Math.min(globalThis.devicePixelRatio || 1, 2);
    const size = Math.min(400, Math.round(side * sharp));
    const wish = (place, seen) => {
      const row = this.#order[place];
      return { key: `${this.actions.key(row)}|${side}`, row, seen, size, ...this.actions.how(row) };
    };
    const wishes = [];
    for (let place = first; place < last; place++) wishes.push(wish(place, true));
    const ahead = across * Math.ceil(high / tall);
    for (let place = last; place < Math.min(this.#order.length, last + ahead); place++) wishes.push(wish(place, false));
    for (let place = first - 1; place >= Math.max(0, first - across * 2); place--) wishes.push(wish(place, false));
    this.studio.thumbnails.want(wishes);
  }

  #onPicture(key) {
    const cell = this.#cells.find((one) => one.key === key);
    if (cell) this.#paint(cell);
    if (this.#cells.every((one) => one.row < 0 || one.drawn)) this.actions.ready();
  }

  #paint(cell) {
    const picture = this.studio.thumbnails.get(cell.key);
    cell.drawn = Boolean(picture);
    cell.element.dataset.drawn = picture ? (picture.fine ? "fine" : "sketch") : "no";
    const context = cell.context;
    if (!picture) return context.clearRect(0, 0, cell.canvas.width, cell.canvas.height);
    this.longestEmpty = Math.max(this.longestEmpty, performance.now() - cell.since);
    cell.since = performance.now();
    const { width } = picture.image;
    if (cell.canvas.width !== width) cell.canvas.width = cell.canvas.height = width;
    context.putImageData(picture.image, 0, 0);
  }

  #newCell() {
    const cell = { row: -1, place: -1, key: "", since: 0, drawn: false };
    cell.canvas = el("canvas", { "aria-hidden": "true" });
    cell.context = cell.canvas.getContext("2d");
    cell.code = el("span", { class: "code" });
    cell.facts = el("span", { class: "facts" });
    cell.group = el("button", { class: "group", type: "button", tabIndex: -1 });
    cell.heart = el("button", { class: "heart", type: "button", tabIndex: -1 });
    cell.pick = el("button", { class: "pick", type: "button", tabIndex: -1, title: "Choose, to breed or to blend (space)" });
    cell.stars = [1, 2, 3, 4, 5].map((stars) =>
      el("button", { class: "star", type: "button", tabIndex: -1, onclick: () => this.actions.judge(cell.row, "rating", stars) }, "★"),
    );
    cell.link = el("a", { class: "picture" }, cell.canvas);
    cell.element = el(
      "div",
      { class: "cell", role: "listitem", hidden: true },
      cell.link,
      cell.heart,
      cell.pick,
      cell.group,
      el("div", { class: "caption" }, cell.code, el("span", { class: "stars" }, cell.stars), cell.facts),
    );
    cell.heart.addEventListener("click", () => this.actions.judge(cell.row, "favourite"));
    cell.pick.addEventListener("click", () => this.actions.choose(cell.row));
    cell.link.addEventListener("click", (event) => {
      if (!event.shiftKey) return;
      event.preventDefault();
      this.actions.choose(cell.row);
    });
    cell.group.addEventListener("click", () => this.actions.unfold(cell.row));
    this.layer.append(cell.element);
    return cell;
  }

  #describe(cell) {
    const { row, place } = cell;
    const told = this.actions.describe(row);
    cell.link.href = `#/design/${told.id}`;
    cell.link.setAttribute("aria-label", told.spoken);
    cell.element.dataset.row = row;
    cell.element.setAttribute("aria-posinset", place + 1);
    cell.element.setAttribute("aria-setsize", this.#order.length);
    const chosen = this.actions.chosen(row);
    cell.element.classList.toggle("chosen", chosen);
    cell.pick.setAttribute("aria-pressed", String(chosen));
    cell.pick.setAttribute("aria-label", `Choose ${told.code}`);
    cell.code.textContent = told.code;
    cell.facts.textContent = told.facts;
    cell.element.classList.toggle("rated", told.rating > 0);
    cell.stars.forEach((star, i) => {
      star.setAttribute("aria-pressed", String(i < told.rating));
      star.setAttribute("aria-label", `${i + 1} stars for ${told.code}`);
      star.disabled = !this.studio.can;
    });
    cell.heart.classList.toggle("on", told.favourite);
    cell.heart.setAttribute("aria-pressed", String(told.favourite));
    cell.heart.setAttribute("aria-label", told.favourite ? "Take from favourites" : "Add to favourites");
    cell.heart.disabled = !this.studio.can;
    cell.group.hidden = told.alike < 2;
    cell.group.textContent = `${number(told.alike)} alike`;
    cell.group.setAttribute("aria-label", `Show the ${told.alike} designs of this shape`);
  }

  #onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || !this.#order.length) return;
    const { across, tall, high } = this.#layout;
    const page = across * Math.max(1, Math.floor(high / tall));
    const moves = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -across, ArrowDown: across, PageUp: -page, PageDown: page };
    const row = this.#order[this.#current];
    if (event.key in moves) this.#moveFocus(this.#current + moves[event.key], Math.abs(moves[event.key]) >= across);
    else if (event.key === "Home") this.#moveFocus(0);
    else if (event.key === "End") this.#moveFocus(this.#order.length - 1);
    else if (event.key === "f" || event.key === "F") this.actions.judge(row, "favourite");
    else if (/^[0-5]$/.test(event.key)) this.actions.judge(row, "rating", Number(event.key));
    else if (event.key === " ") this.actions.choose(row);
    else if (event.key === "Enter") {
      if (event.target.tagName === "BUTTON") return;
      this.actions.open(row);
    } else return;
    event.preventDefault();
  }

  #moveFocus(place, whole = false) {
    const { across, tall, high } = this.#layout;
    const last = this.#order.length - 1;
    if (whole && place < 0) place = this.#current % across;
    this.#current = Math.min(last, Math.max(0, place));
    const top = Math.floor(this.#current / across) * tall;
    if (top < this.#offset) this.#moveTo(top);
    else if (top + tall + GAP > this.#offset + high) this.#moveTo(top + tall + GAP - high);
    else this.#place();
    this.focus();
  }
}
