// A histogram of one score with a brush over it, and a number field for each end.

import { el, number } from "../core/dom.js";
import { BINS } from "./query.js";

const HIGH = 44; // pixels
const GRIP = 9;
const DAY = 86_400;

export class Brush {
  #counts = null;
  #extent = [0, 1];
  #range = [null, null];
  #drag = null;

  /** column as in catalogue.json; changed(range) while somebody drags or types, range [low | null, high | null]. */
  constructor(column, changed) {
    this.column = column;
    this.changed = changed;
    this.dated = column.name === "created";
    this.canvas = el("canvas", { class: "histogram", "aria-hidden": "true", title: "Drag to choose a range; twice to clear it" });
    this.fields = ["least", "most"].map((end, i) =>
      el("input", {
        class: "field",
        type: this.dated ? "date" : "number",
        step: this.dated ? null : "any",
        inputmode: this.dated ? null : "decimal",
        "aria-label": `${column.label}, ${end}`,
        onchange: (event) => this.#typed(i, event.target),
      }),
    );
    this.clear = el("button", { class: "clear", type: "button", hidden: true, "aria-label": `Clear ${column.label}`, onclick: () => this.#set([null, null]) }, "×");
    const unit = column.unit && !this.dated ? ` ${column.unit}` : "";
    this.element = el(
      "section",
      { class: "score" },
      el("div", { class: "head" }, el("h3", { title: column.help }, column.label, unit ? el("small", {}, unit) : null), this.clear),
      this.canvas,
      el("div", { class: "ends" }, this.fields[0], this.fields[1]),
    );
    this.canvas.addEventListener("pointerdown", (event) => this.#grip(event));
    this.canvas.addEventListener("pointermove", (event) => this.#pull(event));
    this.canvas.addEventListener("pointerup", () => (this.#drag = null));
    this.canvas.addEventListener("pointercancel", () => (this.#drag = null));
    this.canvas.addEventListener("dblclick", () => this.#set([null, null]));
  }

  /** What to show: a histogram of the query, and the range that is chosen. */
  update({ low, high, counts }, range) {
    [this.#counts, this.#extent, this.#range] = [counts, [low, high], range];
    this.element.hidden = !(high > low);
    this.#write();
    this.paint();
  }

  setRange(range) {
    this.#range = range;
    this.#write();
    this.paint();
  }

  paint() {
    const sharp = Math.min(globalThis.devicePixelRatio || 1, 2);
    const width = this.canvas.clientWidth;
    if (!width || !this.#counts) return;
    [this.canvas.width, this.canvas.height] = [width * sharp, HIGH * sharp];
    const context = this.canvas.getContext("2d");
    const style = getComputedStyle(this.canvas);
    const [gold, line] = ["--gold", "--bar"].map((name) => style.getPropertyValue(name));
    context.scale(sharp, sharp);
    const most = Math.max(1, ...this.#counts);
    const [from, to] = this.#range.map((end, i) => (end === null ? (i ? width : 0) : this.#place(end)));
    const wide = width / BINS;
    for (let i = 0; i < BINS; i++) {
      if (!this.#counts[i]) continue;
      const tall = Math.max(1.5, (HIGH - 4) * Math.sqrt(this.#counts[i] / most));
      const middle = (i + 0.5) * wide;
      context.fillStyle = middle >= from && middle <= to ? gold : line;
      context.fillRect(i * wide + 0.5, HIGH - tall, Math.max(1, wide - 1), tall);
    }
    context.fillStyle = gold;
    this.#range.forEach((end, i) => {
      if (end !== null) context.fillRect(Math.min(width - 2, Math.max(0, (i ? to : from) - 1)), 0, 2, HIGH);
    });
  }

  #place(value) {
    const [low, high] = this.#extent;
    return (Math.min(1, Math.max(0, (value - low) / (high - low))) * this.canvas.clientWidth) | 0;
  }

  #value(event) {
    const box = this.canvas.getBoundingClientRect();
    const [low, high] = this.#extent;
    const share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    if (this.dated) return Math.round(low + share * (high - low));
    const digits = Math.max(0, this.column.digits);
    return Number((low + share * (high - low)).toFixed(digits));
  }

  #grip(event) {
    this.canvas.setPointerCapture(event.pointerId);
    const x = event.clientX - this.canvas.getBoundingClientRect().left;
    const ends = this.#range.map((end, i) => (end === null ? (i ? this.canvas.clientWidth : 0) : this.#place(end)));
    const near = ends.map((end) => Math.abs(end - x));
    const which = near[0] <= near[1] ? 0 : 1;
    const active = this.#range[0] !== null || this.#range[1] !== null;
    if (near[which] <= GRIP) this.#drag = { which };
    else if (active && x > ends[0] && x < ends[1]) this.#drag = { from: this.#value(event), range: [...this.#bounds()] };
    else this.#drag = { start: this.#value(event) };
  }

  #bounds() {
    return this.#range.map((end, i) => end ?? this.#extent[i]);
  }

  #pull(event) {
    if (!this.#drag) return;
    const value = this.#value(event);
    const { which, start, from, range } = this.#drag;
    if (which !== undefined) {
      const next = [...this.#range];
      next[which] = value;
      if (next[0] !== null && next[1] !== null && next[0] > next[1]) {
        next.reverse();
        this.#drag.which = 1 - which;
      }
      this.#set(next);
    } else if (start !== undefined) {
      if (start !== value) this.#set([Math.min(start, value), Math.max(start, value)]);
    } else {
      const [low, high] = this.#extent;
      const move = Math.min(high - range[1], Math.max(low - range[0], value - from));
      this.#set(range.map((end) => Number((end + move).toPrecision(9))));
    }
  }

  /** An end that lies at the border of all numbers is none. */
  #set([low, high]) {
    const [least, most] = this.#extent;
    this.setRange([low !== null && low <= least ? null : low, high !== null && high >= most ? null : high]);
    this.changed(this.#range);
  }

  #typed(which, field) {
    const next = [...this.#range];
    if (field.value === "") next[which] = null;
    else next[which] = this.dated ? Date.parse(field.value) / 1000 + (which ? DAY - 1 : 0) : Number(field.value);
    this.setRange(next);
    this.changed(this.#range);
  }

  #write() {
    this.clear.hidden = this.#range[0] === null && this.#range[1] === null;
    this.fields.forEach((field, i) => {
      const end = this.#range[i];
      if (this.dated) field.value = end === null ? "" : new Date(end * 1000).toISOString().slice(0, 10);
      else {
        field.placeholder = number(this.#extent[i], this.column.digits);
        if (document.activeElement !== field || end === null) field.value = end === null ? "" : String(end);
      }
    });
  }
}
