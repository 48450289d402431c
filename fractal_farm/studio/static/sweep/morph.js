// From one design to another: a slider, a row of pictures, a film.

import { designOf, directoryOf, folded, panel } from "../design/design.js";
import { button, commandLine, complaint, element, ensureStyles, heading, save, say } from "../design/kit.js";
import { shapeView } from "../design/shape_view.js";
import { paintGenome } from "../design/strip.js";
import { rememberDraft } from "../tune/draft.js";
import { filmKind, filmOf, sheetOf } from "./film.js";
import { morphOf, unlike } from "./steps.js";

const STEPS = 9;
const SECONDS = 6;

export async function show(main, { a, b }, studio) {
  await ensureStyles();
  const [first, second] = await Promise.all([designOf(studio, a), designOf(studio, b)]);
  const against = unlike(first.genome, second.genome);
  const title = heading(first.design_id, `${first.code} → ${second.code}`, "morph");
  if (against) {
    main.replaceChildren(element("article", { class: "design-page" }, title,
      element("p", { class: "bad" }, `These two cannot be morphed: ${against}.`)));
    return () => {};
  }
  const along = morphOf(first.genome, second.genome);
  let t = 0;
  let frame = 0;
  const view = shapeView({ genome: along(0), label: "Morph", keepView: true });
  const slider = element("input", { type: "range", min: 0, max: 1, step: 0.005, value: 0, "aria-label": "From the first design to the second", id: "morph" });
  slider.addEventListener("input", () => move(slider.valueAsNumber, true));
  slider.addEventListener("change", () => move(slider.valueAsNumber, false));
  const play = button("▶ Play", () => (frame ? stop() : start()), { "aria-pressed": "false" });
  const tune = button("Tune from here", () => {
    rememberDraft(first.design_id, along(t));
    studio.go("tune", first.design_id);
  });
  const cells = Array.from({ length: STEPS }, (_, i) => i / (STEPS - 1));
  const png = button("Save as PNG", async () =>
    save(await sheetOf([{ cells: cells.map((share) => ({ genome: along(share), caption: share.toFixed(2) })) }], view.controller.frame.view, look()), `${first.code}-${second.code}.png`));
  const kind = filmKind();
  const film = button("Save as film", async () => {
    film.disabled = true;
    try {
      const blob = await filmOf(along, view.controller.frame.view, { seconds: SECONDS, ...look(), ontime: (share) => (film.textContent = `Filming ${Math.round(100 * share)} %`) });
      save(blob, `${first.code}-${second.code}.${kind.includes("mp4") ? "mp4" : "webm"}`);
    } catch (error) {
      say(complaint(error), "error");
    }
    film.textContent = "Save as film";
    film.disabled = false;
  }, { disabled: !kind, reason: "This browser cannot record films; use farm morph." });

  const look = () => ({ more: { colouring: view.controller.options.colouring, palette: view.controller.options.palette } });

  function move(share, live) {
    t = share;
    view.show(along(t), { live });
  }

  function start() {
    const begun = performance.now() - (t * SECONDS * 1000) / 2;
    const paint = (now) => {
      const phase = ((now - begun) / (SECONDS * 1000)) % 1;
      slider.value = phase < 0.5 ? 2 * phase : 2 - 2 * phase;
      move(slider.valueAsNumber, true);
      frame = requestAnimationFrame(paint);
    };
    frame = requestAnimationFrame(paint);
    play.textContent = "❚❚ Pause";
    play.setAttribute("aria-pressed", "true");
  }

  function stop() {
    cancelAnimationFrame(frame);
    frame = 0;
    play.textContent = "▶ Play";
    play.setAttribute("aria-pressed", "false");
    move(t, false);
  }

  const strip = element("div", { class: "tiles" }, cells.map((share) => {
    const canvas = element("canvas", { width: 200, height: 200, "aria-hidden": "true" });
    paintGenome(canvas, along(share), studio, { view: view.controller.frame?.view });
    const tile = element("button", { type: "button", "aria-label": `At ${share.toFixed(2)}` }, canvas, share.toFixed(2));
    tile.addEventListener("click", () => ((slider.value = share), move(share, false)));
    return tile;
  }));
  main.replaceChildren(element("article", { class: "design-page" }, title, view.root,
    element("div", { class: "toolbar morphing" }, play, slider, tune, png, film),
    panel("On the way", strip),
    folded("On the command line", commandLine(`farm morph ${directoryOf(first)} ${first.design_id} ${second.design_id} --out morph.mp4`, "a film"))));
  return () => {
    cancelAnimationFrame(frame);
    view.destroy();
  };
}
