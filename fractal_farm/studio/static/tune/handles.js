// Handles on the shape: drag the dot of a map to move its copy, the small knob on its ring to turn it.

import { element } from "../design/kit.js";
import { image, moved, turnedAbout } from "./genes.js";
import { MAP_COLOURS } from "./controls.js";

const RING = 30;
const NUDGE = 4; // pixels a key
const TURN = Math.PI / 60;

/** An overlay over a shape view; hand = {now(), live(change), letGo()}. Returns {root, place(), destroy()}. */
export function handles(view, hand, allowed) {
  const svg = element("svg", { class: "handles" });
  const many = hand.now().genes.length;
  let centre = view.controller.frame?.centre ?? [0, 0, 0];
  let dragging = null;
  const groups = hand.now().genes.map((_, map) => {
    const colour = MAP_COLOURS[map % MAP_COLOURS.length];
    const ring = element("circle", { class: "ring", r: RING, stroke: colour });
    const line = element("line", { stroke: colour, "stroke-width": 1.5, opacity: 0.6 });
    const knob = element("g", { class: "knob", tabindex: 0, role: "button", "data-knob": map, "aria-label": `Map ${map + 1}: drag to move its copy; arrow keys move, Shift and arrows turn` },
      element("circle", { r: 11, fill: colour }), element("text", {}, String(map + 1)));
    const turn = element("g", { class: "turn", "data-turn": map, "aria-hidden": "true" }, element("circle", { r: 12, fill: "transparent" }), element("circle", { r: 6, fill: colour, stroke: "#fff", "stroke-width": 1.5 }));
    const group = element("g", {}, ring, line, knob, turn);
    svg.append(group);
    const one = { map, ring, line, knob, turn, angle: -Math.PI / 4 };
    listen(one);
    return one;
  });

  const phenotype = () => hand.now().phenotype ?? {};
  const screenOf = (map) => view.controller.project(image(hand.now().genes[map], centre, phenotype()));

  function listen(one) {
    const { knob, turn, map } = one;
    for (const [target, kind] of [[knob, "move"], [turn, "turn"]]) {
      target.addEventListener("pointerdown", (event) => {
        if (!allowed(map, kind)) return;
        event.preventDefault();
        event.stopPropagation();
        target.setPointerCapture(event.pointerId);
        view.controller.held = true;
        dragging = { one, kind, x: event.clientX, y: event.clientY, row: hand.now().genes[map], angle: one.angle };
        dragging.from = angleAt(event, map);
        if (kind === "move") knob.focus({ preventScroll: true });
      });
      target.addEventListener("pointermove", (event) => dragging?.one === one && drag(event));
      for (const end of ["pointerup", "pointercancel"]) {
        target.addEventListener(end, () => {
          if (dragging?.one !== one) return;
          dragging = null;
          view.controller.held = false;
          hand.letGo();
        });
      }
    }
    knob.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!step || !allowed(map, event.shiftKey ? "turn" : "move")) return;
      event.preventDefault();
      event.stopPropagation();
      const row = hand.now().genes[map];
      if (event.shiftKey) rotate(map, row, (step[0] || step[1]) * TURN);
      else shift(map, row, [NUDGE * step[0], NUDGE * step[1]]);
    });
    knob.addEventListener("keyup", (event) => event.key.startsWith("Arrow") && hand.letGo());
  }

  function angleAt(event, map) {
    const box = svg.getBoundingClientRect();
    const [x, y] = screenOf(map);
    return Math.atan2(event.clientY - box.top - y, event.clientX - box.left - x);
  }

  function drag(event) {
    const { one, kind, x, y, row, from } = dragging;
    if (kind === "move") return shift(one.map, row, [event.clientX - x, event.clientY - y]);
    const by = angleAt(event, one.map) - from;
    one.angle = dragging.angle + by;
    rotate(one.map, row, by);
  }

  function shift(map, row, [x, y]) {
    const move = view.controller.unproject([x, y, 0]);
    hand.live((genome) => withRow(genome, map, moved(row, move, phenotype())));
  }

  /** Clockwise on the screen by an angle, about the line of sight. */
  function rotate(map, row, angle) {
    const near = view.controller.unproject([0, 0, 1]);
    const length = Math.hypot(...near);
    const axis = near.map((value) => value / length);
    hand.live((genome) => withRow(genome, map, turnedAbout(row, axis, -angle, centre, phenotype())));
  }

  return {
    root: svg,
    place() {
      if (!dragging) centre = view.controller.frame?.centre ?? centre;
      for (const { map, ring, line, knob, turn, angle } of groups.slice(0, many)) {
        const [x, y] = screenOf(map);
        const [c, s] = [Math.cos(angle), Math.sin(angle)];
        ring.setAttribute("cx", x);
        ring.setAttribute("cy", y);
        knob.setAttribute("transform", `translate(${x} ${y})`);
        turn.setAttribute("transform", `translate(${x + RING * c} ${y + RING * s})`);
        Object.entries({ x1: x + 11 * c, y1: y + 11 * s, x2: x + RING * c, y2: y + RING * s }).forEach(([key, value]) => line.setAttribute(key, value));
      }
    },
    get busy() {
      return dragging !== null;
    },
  };
}

const withRow = (genome, map, row) => ({ ...genome, genes: genome.genes.map((one, i) => (i === map ? row : one)) });
