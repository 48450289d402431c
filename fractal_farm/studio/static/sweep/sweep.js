// Parameter sweeps (paper Fig 10): a row of pictures for the steps of each parameter of a map.

import { designOf, directoryOf, folded } from "../design/design.js";
import { button, choice, commandLine, element, ensureStyles, heading, save, say } from "../design/kit.js";
import { draftOf, rememberDraft } from "../tune/draft.js";
import { copyOf, isSimilarity, toShown } from "../tune/genes.js";
import { paintGenome } from "../design/strip.js";
import { directionOf, sheetOf } from "./film.js";
import { SWEEPS, sweepOf } from "./steps.js";

const COUNT = 9;

export async function show(main, { id }, studio) {
  await ensureStyles();
  const design = await designOf(studio, id);
  const genome = copyOf(draftOf(design.design_id) ?? design.genome);
  if (!isSimilarity(genome)) throw new Error("only similarities (rows of seven genes) can be swept");
  const view = directionOf(genome);
  let map = 0;
  let stride = 1;
  let rows = [];

  const table = element("div", { class: "design-rows" });
  const maps = choice("Map", genome.genes.map((_, i) => [i, `Map ${i + 1}`]), 0, (chosen) => ((map = Number(chosen)), fill()));
  const strides = choice("Step", [[1, "paper's steps"], [3, "× 3"], [6, "× 6"]], 1, (chosen) => ((stride = Number(chosen)), fill()));
  const png = button("Save as PNG", async () => {
    png.disabled = true;
    const sheet = rows.map(({ sweep, steps }) => ({ title: sweep.name, cells: steps.map((step) => ({ genome: step.genome, caption: read(sweep, step.value) })) }));
    save(await sheetOf(sheet, view), `${design.code}-sweep-map${map + 1}.png`);
    say("The rows are saved as one picture");
    png.disabled = false;
  }, { id: "save-png" });
  const commands = element("div", {});

  function fill() {
    rows = SWEEPS.map((sweep) => ({ sweep, steps: sweepOf(genome, map, sweep, COUNT, stride) }));
    table.replaceChildren(...rows.map(line));
    const begin = `farm sweep ${directoryOf(design)} ${design.design_id}`;
    commands.replaceChildren(
      commandLine(`${begin} --paper --out sweep.png`, "figure 10"),
      ...SWEEPS.map(({ name, written }) => commandLine(`${begin} --map ${map + 1} --gene ${name} --step ${written} --steps ${COUNT} --out ${name}.png`, name)));
  }

  function line({ sweep, steps }) {
    return element("div", { class: "sweep-row" },
      element("h3", {}, sweep.name, element("small", {}, `step ${sweep.unit}${stride > 1 ? ` × ${stride}` : ""}`)),
      element("div", { class: "tiles" }, steps.map((step) => {
        const canvas = element("canvas", { width: 200, height: 200, "aria-hidden": "true" });
        paintGenome(canvas, step.genome, studio, { view }).then(() => (canvas.dataset.drawn = "true"));
        const tile = element("button", { type: "button", class: step.now ? "now" : undefined, title: "Tune from here", "aria-label": `${sweep.name} ${read(sweep, step.value)}: tune from here` }, canvas, read(sweep, step.value));
        tile.addEventListener("click", () => {
          rememberDraft(design.design_id, step.genome);
          studio.go("tune", design.design_id);
        });
        return tile;
      })));
  }

  main.replaceChildren(element("article", { class: "design-page" },
    heading(design.design_id, design.code, "sweep"),
    element("div", { class: "viewer-bar" }, maps, strides, png), table, folded("On the command line", commands)));
  fill();
  return () => {};
}

const read = (sweep, value) => (sweep.gene < 3 ? `${toShown(sweep.gene, value).toFixed(1)}°` : value.toFixed(3));
