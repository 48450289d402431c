// Have it made: a solid by a preset, with progress and cancel; its certificate, its files, and how it looks in metal.

import { NO_SERVER, button, choice, complaint, element, say, shown } from "./kit.js";
import { certificateTable } from "./facts.js";

const LOOK = 250; // milliseconds between looks at a job
const FORMATS = ["glb", "3mf", "stl", "ply", "obj"];
const FORMAT_USE = { glb: "view", "3mf": "print", stl: "print", ply: "colour", obj: "model" };
const OVER = ["done", "failed", "cancelled"];
const METAL_OF = { gold: "gold", silver: "silver", steel: "steel" };

/** {root, reason (why there is no metal view, if so), showMetal(stage), hideMetal(), onready, destroy()}. */
export function solidPanel(design, studio) {
  const state = { job: null, bytes: null, metal: "silver", view: null, host: null, over: false };
  const panel = { root: null, reason: studio.can ? undefined : NO_SERVER, onready: () => {} };
  const heading = element("h2", {}, "Have it made");
  const result = element("div", { class: "made" });
  const bar = element("progress", { max: 1, value: 0, "aria-label": "Progress of the solid" });
  const stage = element("span", { class: "soft", role: "status" });
  const cancel = button("Cancel", () => ((state.unwanted = true), cancelled()));
  const progress = element("div", { class: "progress", hidden: true }, bar, stage, cancel);
  const preset = element("select", { "aria-label": "Purpose and material", id: "preset" });
  const size = element("input", { type: "number", min: 1, max: 1000, step: 1, placeholder: "as usual", id: "size-mm" });
  const wall = element("input", { type: "number", min: 0.1, max: 100, step: 0.1, placeholder: "as usual", id: "wall-mm" });
  const make = button("Make the solid", start, { quiet: false, disabled: !studio.can, reason: NO_SERVER, id: "make-solid" });
  panel.root = element("section", { class: "panel solid", "aria-label": "Have it made" }, heading,
    studio.can
      ? element("form", { class: "form", onsubmit: (event) => (event.preventDefault(), start()) },
          element("label", { class: "wide" }, "Purpose", preset),
          element("label", {}, "Longest side, mm", size), element("label", {}, "Wall, mm", wall), make)
      : element("p", { class: "soft" }, NO_SERVER),
    progress, result, madeBefore(design));
  if (studio.can) fill();

  async function fill() {
    try {
      const { presets } = await studio.api.get("presets");
      preset.replaceChildren(...presets.map((one) => element("option", { value: one.name ?? one }, one.title ?? one.name ?? one)));
      preset.addEventListener("change", () => usual(presets));
      usual(presets);
    } catch (error) {
      say(complaint(error), "error");
    }
  }

  function usual(presets) {
    const one = presets.find((each) => (each.name ?? each) === preset.value) ?? {};
    const values = { ...one, ...one.values, ...one.parameters };
    size.placeholder = values.size_mm ? shown(values.size_mm, 0) : "as usual";
    wall.placeholder = values.wall_mm ? shown(values.wall_mm, 1) : "as the material asks";
    const material = one.material?.name ?? one.material ?? "";
    state.metal = METAL_OF[material] ?? "silver";
  }

  async function start() {
    const parameters = {};
    if (size.value) parameters.size_mm = Number(size.value);
    if (wall.value) parameters.wall_mm = Number(wall.value);
    state.job = null;
    state.unwanted = false;
    make.disabled = true;
    progress.hidden = false;
    result.replaceChildren();
    bar.removeAttribute("value");
    stage.textContent = "asking";
    try {
      const { job } = await studio.api.post("solid", { design_id: design.design_id, preset: preset.value || undefined, parameters });
      state.job = job;
      if (state.unwanted) cancelled();
      await follow(job);
    } catch (error) {
      say(complaint(error), "error");
      result.replaceChildren(element("p", { class: "bad" }, complaint(error)));
    }
    make.disabled = false;
    progress.hidden = true;
  }

  // A job has its name only when the studio has answered; who cancels before that is not forgotten.
  function cancelled() {
    stage.textContent = "cancelling";
    if (state.job) studio.api.post(`jobs/${state.job}/cancel`, {}).catch((error) => say(complaint(error), "error"));
  }

  async function follow(job) {
    for (;;) {
      const told = await studio.api.get(`jobs/${job}`);
      if (state.over) return;
      stage.textContent = told.state === "queued" ? "waiting for its turn" : (told.stage ?? "");
      if (Number.isFinite(told.share) && told.share > 0) bar.value = told.share;
      if (OVER.includes(told.state)) return finished(job, told);
      await new Promise((done) => setTimeout(done, LOOK));
    }
  }

  async function finished(job, told) {
    if (told.state !== "done") {
      result.replaceChildren(element("p", { class: told.state === "failed" ? "bad" : "soft" }, told.message || told.state));
      return;
    }
    const names = told.files ?? [];
    const links = FORMATS.filter((format) => names.includes(`solid.${format}`)).map((format) =>
      element("a", { class: "button quiet download", href: `api/jobs/${job}/files/solid.${format}`, download: `${design.code}.${format}`, "data-format": format },
        format.toUpperCase(), element("small", {}, ` ${FORMAT_USE[format]}`)));
    const papers = names.filter((name) => name.startsWith("certificate.")).map((name) =>
      element("a", { class: "small", href: `api/jobs/${job}/files/${name}`, target: "_blank", rel: "noopener" }, name));
    result.replaceChildren(
      told.certificate ? certificateTable(told.certificate) : "",
      element("div", { class: "downloads", role: "group", "aria-label": "Download" }, links), element("p", { class: "small soft" }, papers.flatMap((paper, i) => (i ? [" · ", paper] : [paper]))));
    if (names.includes("solid.glb")) {
      state.bytes = await studio.api.bytes(`jobs/${job}/files/solid.glb`);
      panel.onready();
    }
  }

  panel.showMetal = async (host) => {
    state.host = host;
    state.wanted = true;
    if (!state.bytes) {
      host.querySelector(".unmade")?.remove();
      host.append(element("p", { class: "unmade" }, "There is no solid yet: choose a purpose and press ", button("Make the solid", start, { quiet: false })));
      return;
    }
    host.querySelector(".unmade")?.remove();
    try {
      if (!state.view) {
        const { metalView, METALS } = await import("../metal/metal_view.js");
        if (!state.wanted) return;
        state.view = metalView(host, state.metal);
        state.choice = choice("Metal", Object.entries(METALS).map(([name, { title }]) => [name, title]), state.metal, (name) => state.view.setMetal(name));
        state.choice.classList.add("metals");
        host.append(state.choice);
      }
      if (state.shown !== state.bytes) await state.view.load(state.bytes);
      state.shown = state.bytes;
      state.view.setMetal(state.metal);
      state.choice.select(state.metal);
      state.view.canvas.hidden = state.choice.hidden = false;
    } catch (error) {
      host.append(element("p", { class: "unmade" }, `This browser cannot draw the solid (${error.message}); its files are there to download.`));
    }
  };

  panel.hideMetal = () => {
    state.wanted = false;
    state.host?.querySelector(".unmade")?.remove();
    if (state.view) state.view.canvas.hidden = state.choice.hidden = true;
  };

  panel.destroy = () => {
    state.over = true;
    state.view?.destroy();
  };
  return panel;
}

function madeBefore(design) {
  if (!design.solids?.length) return "";
  const lines = design.solids.map((solid) => {
    const facts = solid.facts ?? {};
    const words = [facts.preset, facts.size_mm && `${facts.size_mm} mm`, ...(solid.files ?? [])].filter(Boolean);
    return element("li", {}, words.join(" · "));
  });
  return element("details", {}, element("summary", {}, `Made before: ${design.solids.length}`), element("ul", { class: "small soft" }, lines));
}
