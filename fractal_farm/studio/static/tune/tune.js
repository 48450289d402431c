// Tune a design by hand (paper 3.1.3 and 5.3): sliders, handles, locks, undo by gesture, scores that follow, keep.

import { resolve } from "../core/ifs.js";
import { designOf, directoryOf, folded, panel } from "../design/design.js";
import { scoreTiles } from "../design/facts.js";
import { NO_SERVER, button, commandLine, complaint, element, ensureStyles, heading, save, say } from "../design/kit.js";
import { shapeView } from "../design/shape_view.js";
import { controls, symmetrySelect } from "./controls.js";
import { draftOf, forgetDraft, rememberDraft } from "./draft.js";
import { editsOf } from "./edits.js";
import { copyOf } from "./genes.js";
import { handles } from "./handles.js";
import { history } from "./history.js";
import { scorer } from "./scoring.js";

export async function show(main, { id }, studio) {
  await ensureStyles();
  const design = await designOf(studio, id);
  const original = copyOf(design.genome);
  const past = history(original);
  const draft = draftOf(design.design_id);
  if (draft) past.commit(copyOf(draft));
  const locks = new Set();
  let live = past.now; // what is shown
  let base = null; // the genome when a gesture began
  let comparing = false;
  let scheduled = 0;
  let overlay = null;
  let latest = null;

  const following = element("select", { "aria-label": "When one map is changed, the others" },
    [["stay", "stay"], ["same", "do the same"], ["mirror", "do the opposite"]].map(([value, text]) => element("option", { value }, text)));
  const edits = editsOf(locks, () => following.value);
  const hand = {
    now: () => live,
    live(change) {
      if (comparing) compare(false);
      base ??= past.now;
      live = change(base);
      scheduled ||= requestAnimationFrame(paintLive);
    },
    letGo() {
      if (!base) return;
      base = null;
      cancelAnimationFrame(scheduled);
      scheduled = 0;
      past.commit(live);
      settle();
    },
  };

  const view = shapeView({ genome: live, label: `Tuning ${design.code}`, keepView: true, onview: () => overlay?.place() });
  overlay = handles(view, hand, (map, kind) => !(kind === "move" ? [4, 5, 6] : [0, 1, 2]).some((gene) => locks.has(`${map}:${gene}`)));
  if (live.genes[0].length === 7) view.stage.append(overlay.root);
  const badge = element("span", { class: "badge", hidden: true }, "Before");
  const readout = element("span", { class: "readout", "aria-hidden": "true" });
  view.stage.append(badge, readout);

  const sliders = controls(hand, edits, locks);
  const symmetry = symmetrySelect(live.symmetry ?? "none", (name) => (hand.live(edits.symmetry(name)), hand.letGo()));
  const tiles = scoreTiles(design.scores, design.errors);
  const status = element("p", { class: "soft small", role: "status" }, studio.can ? "" : NO_SERVER);
  const scores = scorer(studio, {
    onwaiting: () => tiles.classList.add("stale"),
    onscores(answer, milliseconds) {
      latest = answer;
      tiles.update(answer.scores, answer.errors, { before: design.scores });
      tiles.dataset.milliseconds = milliseconds.toFixed(1);
      tiles.dataset.settled = String(Number(tiles.dataset.settled ?? 0) + 1);
      status.textContent = `scores after ${Math.round(milliseconds)} ms`;
    },
    onerror: (error) => (status.textContent = complaint(error)),
  });

  const undo = button("↶ Undo", () => step(past.undo()), { title: "Ctrl Z", id: "undo" });
  const redo = button("↷ Redo", () => step(past.redo()), { title: "Ctrl Shift Z", id: "redo" });
  const before = button("Before", () => compare(!comparing), { title: "B: see the design as it was", "aria-pressed": "false", id: "before" });
  const reset = button("Start over", () => (hand.live(() => original), hand.letGo()));
  const automatic = button("Automatic shares", () => (hand.live(edits.automatic()), hand.letGo()), { title: "Probabilities follow from rho again (eqs 3.3 and 3.4)" });
  const keep = button("Keep", keepIt, { quiet: false, disabled: !studio.can, reason: NO_SERVER, id: "keep", title: "Store this as a child of the design" });

  function paintLive() {
    scheduled = 0;
    view.show(live, { live: true });
    sliders.update(live, resolve(live).probabilities);
    readout.textContent = `${(view.points.length / 3).toLocaleString()} points in ${view.cost.toFixed(0)} ms`;
  }

  function settle() {
    view.show(live);
    sliders.update(live, resolve(live).probabilities);
    symmetry.value = live.symmetry ?? "none";
    undo.disabled = !past.canUndo;
    redo.disabled = !past.canRedo;
    automatic.disabled = !live.probabilities;
    readout.textContent = `${(view.points.length / 3).toLocaleString()} points`;
    const changed = JSON.stringify(live) !== JSON.stringify(original);
    reset.disabled = before.disabled = !changed;
    keep.disabled = !studio.can || !changed;
    if (changed) rememberDraft(design.design_id, live);
    else forgetDraft(design.design_id);
    if (studio.can) scores.ask(live);
  }

  function step(state) {
    if (!state) return;
    if (comparing) compare(false);
    live = state;
    settle();
  }

  function compare(on) {
    comparing = on;
    badge.hidden = !on;
    before.setAttribute("aria-pressed", on);
    overlay.root.style.visibility = on ? "hidden" : "";
    view.show(on ? original : live);
  }

  async function keepIt() {
    keep.disabled = true;
    try {
      const kept = await studio.api.post("keep", { genome: live, parent: design.design_id });
      forgetDraft(design.design_id);
      say(`Kept as ${kept.code ?? kept.design_id}`);
      location.hash = `#/design/${kept.design_id}`;
    } catch (error) {
      keep.disabled = false;
      say(complaint(error), "error");
    }
  }

  function keys(event) {
    if (event.altKey || event.target.matches("input[type=number], select, textarea")) return;
    const command = event.ctrlKey || event.metaKey;
    const key = event.key.toLowerCase();
    if (command && key === "z") (event.shiftKey ? redo : undo).click();
    else if (command && key === "y") redo.click();
    else if (!command && key === "b") before.click();
    else return;
    event.preventDefault();
  }
  document.addEventListener("keydown", keys);

  const asFile = button("Genome file", () => save(new Blob([genomeFile(design.code, live)], { type: "application/yaml" }), `${design.code}.yaml`), { title: "For farm score and farm keep" });
  const page = element("article", { class: "design-page" },
    heading(design.design_id, design.code, "tune"),
    element("div", { class: "beside tuning" }, view.root,
      element("div", { class: "panels" },
        element("div", { class: "toolbar", role: "toolbar", "aria-label": "Tuning" }, undo, redo, before, reset, element("span", { class: "push" }), keep),
        panel("Scores", tiles, status),
        panel("Shape",
          element("div", { class: "how" }, element("label", {}, "Symmetry", symmetry), element("label", {}, "The other maps", following)),
          sliders.root, element("div", { class: "toolbar" }, automatic, asFile)))),
    folded("On the command line",
      commandLine(`farm keep ${directoryOf(design)} ${design.code}.yaml --parent ${design.design_id}`, "keep (with the genome file)"),
      commandLine(`farm score ${design.code}.yaml`, "score")));
  main.replaceChildren(page);
  settle();
  if (!studio.can) tiles.update(design.scores, design.errors);

  return () => {
    document.removeEventListener("keydown", keys);
    scores.stop();
    cancelAnimationFrame(scheduled);
    view.destroy();
    return latest;
  };
}

/** A genome file for `farm score` and `farm keep`; JSON is YAML. */
function genomeFile(name, { phenotype, ...genome }) {
  return `${JSON.stringify({ ...(phenotype ? { phenotype } : {}), genomes: { [name]: genome } }, null, 2)}\n`;
}
