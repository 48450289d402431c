// The large view of a design's points: density of random iteration or the even cover, colourings, orbit.
//
// const view = shapeView({genome, metal: {show(), hide()} | reason, onview}); view.show(genome, {live: true}) while
// something is dragged, view.show(genome) when it is let go. view.root is the element; view.controller as `orbit` says.

import { evenPoints, randomIteration, resolve, seedOf } from "../core/ifs.js";
import { PALETTES, frameOf, orbit } from "../core/splat.js";
import { choice, element } from "./kit.js";

export const FULL_COUNT = 100000;
const LEAST_COUNT = 12000;
const LIVE_EVEN = 30000; // to begin with: covers cost more
const LONGEST_FRAME = 14; // milliseconds of points and pixels: above, fewer points while dragging
const SHORTEST_FRAME = 9;

export function shapeView({ genome, metal = null, onview = () => {}, label = "Shape", keepView = false }) {
  const settings = remembered();
  const canvas = element("canvas", { class: "shape", "aria-label": `${label}. Arrow keys turn it, plus and minus zoom, 0 resets.` });
  const buffer = new Float32Array(3 * FULL_COUNT);
  const state = { genome, points: null, count: { density: FULL_COUNT, even: LIVE_EVEN }, view: null, even: settings.even, milliseconds: 0 };
  let controller = null;

  function pointsOf(live) {
    const { maps, probabilities } = resolve(state.genome);
    const symmetry = state.genome.symmetry ?? "none";
    const seed = seedOf(state.genome, "display");
    const count = live ? state.count[kindOf()] : FULL_COUNT;
    if (state.even) return evenPoints(maps, count, { symmetry, probabilities, seed });
    return randomIteration(maps, probabilities, count, seed, symmetry, buffer.subarray(0, 3 * count));
  }

  const kindOf = () => (state.even ? "even" : "density");

  /** A frame whose directions stay while one design is tuned, so that it does not jump. */
  function frame() {
    if (!keepView || !state.view) {
      const chosen = frameOf(state.points);
      state.view = chosen.view;
      return chosen;
    }
    return { ...frameOf(state.points, { choose: false }), view: state.view };
  }

  const view = {
    canvas,
    get points() {
      return state.points;
    },
    get controller() {
      return controller;
    },
    /** Draw a genome; live: it is being dragged, so that the frame stays and points may be fewer. */
    show(next, { live = false } = {}) {
      const begun = performance.now();
      state.genome = next;
      state.points = pointsOf(live);
      const points = performance.now() - begun;
      requestAnimationFrame((now) => (drawing = { live, points, begun: Math.max(now, performance.now()) }));
      controller.set(live ? {} : { frame: frame() });
    },
    /** Milliseconds of the latest live picture's points and pixels. */
    get cost() {
      return state.milliseconds;
    },
    destroy: () => controller.destroy(),
  };

  let drawing = null;
  function drawn(of) {
    if (drawing?.live) {
      state.milliseconds = drawing.points + performance.now() - drawing.begun;
      const count = state.count[kindOf()];
      if (state.milliseconds > LONGEST_FRAME) state.count[kindOf()] = Math.max(LEAST_COUNT, Math.round(count * 0.8));
      else if (state.milliseconds < SHORTEST_FRAME) state.count[kindOf()] = Math.min(FULL_COUNT, Math.round(count * 1.15));
    }
    drawing = null;
    onview(of);
  }

  const colour = swatches(settings, (chosen) => {
    Object.assign(settings, chosen);
    remember(settings);
    controller?.set(chosen);
  });
  const kinds = [["density", "Density"], ["even", "As it prints"]];
  if (metal) kinds.push(["metal", "Metal", metal.reason]);
  const kind = choice("What is shown", kinds, settings.even ? "even" : "density", (chosen) => {
    const solid = chosen === "metal";
    canvas.hidden = solid;
    colour.hidden = solid;
    if (solid) return metal.show();
    metal?.hide?.();
    settings.even = state.even = chosen === "even";
    remember(settings);
    view.show(state.genome);
  });
  view.kind = kind;
  view.stage = element("div", { class: "stage" }, canvas);
  view.root = element("section", { class: "viewer", "aria-label": label }, view.stage,
    element("div", { class: "viewer-bar" }, kind, colour));

  state.points = pointsOf(false);
  controller = orbit(canvas, () => state.points, { colouring: settings.colouring, palette: settings.palette, frame: frame(), onview: drawn });
  return view;
}

/** Round buttons for the paper's gradient and for pairs of tones. */
function swatches(settings, onchange) {
  const names = ["gradient", ...Object.keys(PALETTES)];
  const now = () => (settings.colouring === "gradient" ? "gradient" : settings.palette);
  const group = choice("Colours", names.map((name) => [name, ""]), now(), (name) =>
    onchange(name === "gradient" ? { colouring: "gradient" } : { colouring: "dual", palette: name }));
  group.classList.add("swatches");
  for (const one of group.children) {
    const name = one.dataset.value;
    one.setAttribute("aria-label", `${name[0].toUpperCase()}${name.slice(1)}`);
    one.title = one.getAttribute("aria-label");
    one.style.background = name === "gradient"
      ? "conic-gradient(from 210deg, #e2556b, #e8c15a, #6fd08c, #56b7e6, #8a6be8, #e2556b)"
      : `linear-gradient(135deg, ${css(PALETTES[name].first)}, ${css(minus(PALETTES[name]))})`;
  }
  return group;
}

const css = (colour) => `rgb(${colour.map((value) => Math.round(255 * Math.min(1, Math.max(0, value))))})`;
const minus = ({ first, second }) => first.map((value, k) => value - second[k]);

const KEY = "shape-view";
const PLAIN = { even: true, colouring: "gradient", palette: "amber" };

function remembered() {
  try {
    return { ...PLAIN, ...JSON.parse(localStorage.getItem(KEY) ?? "{}") };
  } catch {
    return { ...PLAIN };
  }
}

function remember(settings) {
  try {
    localStorage.setItem(KEY, JSON.stringify(settings));
  } catch {
    // A browser that keeps nothing shows the usual colours.
  }
}
