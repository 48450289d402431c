// Saved views: a name and what stands in the address. A server keeps them with the catalogue, else the browser does.

import { el } from "../core/dom.js";

const HERE = "farm-views";

export class Views {
  /** current() gives the query that would be saved; open(query) shows another. */
  constructor(studio, current, open) {
    [this.studio, this.current, this.open] = [studio, current, open];
    this.list = el("select", { class: "field", "aria-label": "Saved views", onchange: () => this.#chosen() });
    this.save = el("button", { class: "button quiet", type: "button", title: "Save this view", onclick: () => this.#ask() }, "Save view");
    this.name = el("input", { class: "field", type: "text", maxlength: "60", placeholder: "Name of the view", "aria-label": "Name of the view" });
    this.form = el("form", { class: "naming", hidden: true, onsubmit: (event) => this.#save(event) }, this.name, el("button", { class: "button", type: "submit" }, "Save"));
    this.element = el("div", { class: "views" }, this.list, this.save, this.form);
    this.#read();
  }

  get #key() {
    return `${HERE} ${this.studio.catalogue.title}`;
  }

  async #read() {
    let views = [];
    try {
      const told = this.studio.can ? await this.studio.api.get("views") : JSON.parse(localStorage.getItem(this.#key) ?? "[]");
      views = Array.isArray(told) ? told : (told.views ?? []);
    } catch {
      views = [];
    }
    this.views = views;
    this.list.replaceChildren(el("option", { value: "" }, "Saved views"), ...views.map(({ name }, i) => el("option", { value: String(i) }, name)));
    this.list.hidden = !views.length;
  }

  #chosen() {
    const view = this.views[this.list.value];
    if (view) this.open(view.query);
    this.list.value = "";
  }

  #ask() {
    this.form.hidden = !this.form.hidden;
    if (!this.form.hidden) this.name.focus();
  }

  async #save(event) {
    event.preventDefault();
    const view = { name: this.name.value.trim(), query: this.current() };
    if (!view.name) return;
    try {
      if (this.studio.can) await this.studio.api.post("views", view);
      else localStorage.setItem(this.#key, JSON.stringify([...this.views.filter(({ name }) => name !== view.name), view]));
      this.studio.tell(`The view ${view.name} is saved`);
    } catch (error) {
      this.studio.tell(error.message, "bad");
    }
    this.name.value = "";
    this.form.hidden = true;
    await this.#read();
  }
}
