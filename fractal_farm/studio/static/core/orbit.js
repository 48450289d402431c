// A view of points that turns with mouse, touch, wheel and keyboard.

import { draw, frameOf, project, unproject } from "./splat.js";

const REST = 140; // milliseconds without a move after which a picture is drawn finely
const STEP = Math.PI / 24;
const STEEPEST = Math.PI / 2;

/**
 * Keep a canvas showing points; its size follows that of its element.
 *
 * getPoints() gives a Float32Array; options are those of `draw`, and onview(controller) after each change of the view.
 * Returns {options, draw(), reframe(), set(options), project(point), unproject(move), held, destroy()}: project gives
 * pixels of the element; while `held` is true (somebody drags a handle) the mouse does not turn the view.
 */
export function orbit(canvas, getPoints, options = {}) {
  const listening = new AbortController();
  const state = { turn: [0, 0], zoom: 1, pan: [0, 0], ...options };
  const touches = new Map();
  let frame = state.frame ?? null;
  let scheduled = 0;
  let rest = 0;
  let moving = false;

  const controller = {
    options: state,
    held: false,
    get frame() {
      return frame;
    },
    draw: () => schedule(false),
    reframe() {
      frame = null;
      schedule(false);
    },
    set(changes) {
      Object.assign(state, changes);
      if ("frame" in changes) frame = changes.frame;
      schedule(true);
    },
    project: (point) => project(point, screen()),
    unproject: (move) => unproject(move, screen()),
    destroy() {
      listening.abort();
      resized.disconnect();
      cancelAnimationFrame(scheduled);
      clearTimeout(rest);
    },
  };

  const screen = () => ({ ...state, frame: frame ?? frameOf(getPoints()), width: canvas.clientWidth, height: canvas.clientHeight });

  function schedule(moves) {
    moving ||= moves;
    scheduled ||= requestAnimationFrame(paint);
  }

  function paint() {
    scheduled = 0;
    const points = getPoints();
    if (!points?.length || !canvas.clientWidth) return;
    const sharp = Math.min(globalThis.devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * sharp)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    frame ??= frameOf(points);
    draw(canvas, points, { ...state, frame, fine: !moving });
    state.onview?.(controller);
    if (moving) {
      clearTimeout(rest);
      rest = setTimeout(() => ((moving = false), schedule(false)), REST);
    }
  }

  function turnBy(x, y) {
    state.turn = [state.turn[0] + x, Math.min(STEEPEST, Math.max(-STEEPEST, state.turn[1] + y))];
    schedule(true);
  }

  function zoomBy(factor) {
    state.zoom = Math.min(40, Math.max(0.2, state.zoom * factor));
    schedule(true);
  }

  function panBy(x, y) {
    state.pan = [state.pan[0] + x / canvas.clientWidth, state.pan[1] + y / canvas.clientHeight];
    schedule(true);
  }

  const on = (kind, listener, passive = true) => canvas.addEventListener(kind, listener, { signal: listening.signal, passive });
  const spread = () => {
    const [a, b] = [...touches.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };

  on("pointerdown", (event) => {
    if (controller.held) return;
    canvas.setPointerCapture(event.pointerId);
    touches.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  on("pointermove", (event) => {
    const before = touches.get(event.pointerId);
    if (!before || controller.held) return;
    const [x, y] = [event.clientX - before.x, event.clientY - before.y];
    const apart = touches.size === 2 ? spread() : 0;
    touches.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (touches.size === 2) {
      zoomBy(spread() / Math.max(apart, 1));
      panBy(x / 2, y / 2);
    } else if (event.shiftKey || event.buttons === 2 || event.buttons === 4) panBy(x, y);
    else turnBy(x * 0.008, y * 0.008);
  });
  for (const kind of ["pointerup", "pointercancel"]) on(kind, (event) => touches.delete(event.pointerId));
  on("contextmenu", (event) => event.preventDefault(), false);
  on("dblclick", () => controller.set({ turn: [0, 0], zoom: 1, pan: [0, 0] }));
  on("wheel", (event) => (event.preventDefault(), zoomBy(Math.exp(-event.deltaY * 0.0012))), false);
  on("keydown", (event) => {
    const act = {
      ArrowLeft: () => turnBy(-STEP, 0),
      ArrowRight: () => turnBy(STEP, 0),
      ArrowUp: () => turnBy(0, -STEP),
      ArrowDown: () => turnBy(0, STEP),
      "+": () => zoomBy(1.15),
      "=": () => zoomBy(1.15),
      "-": () => zoomBy(1 / 1.15),
      0: () => controller.set({ turn: [0, 0], zoom: 1, pan: [0, 0] }),
    }[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  }, false);
  canvas.tabIndex = 0;
  canvas.style.touchAction = "none";
  if (!canvas.hasAttribute("role")) canvas.setAttribute("role", "img");
  const resized = new ResizeObserver(() => schedule(false));
  resized.observe(canvas);
  schedule(false);
  return controller;
}
