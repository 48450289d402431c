// Pictures to take home: rows of pictures as one PNG, and a morph as a film where the browser can record one.

import { evenPoints, resolve } from "../core/ifs.js";
import { draw, fitted, frameOf } from "../core/splat.js";

const POINTS = 10000; // as the paper's Fig 10
const FILM_POINTS = 60000;
const GROUND = [20, 21, 24];
const KINDS = ["video/webm;codecs=vp9", "video/webm", "video/mp4"];

/** Points of a genome as they print. */
export function pointsOf(genome, count = POINTS) {
  const { maps, probabilities } = resolve(genome);
  return evenPoints(maps, count, { symmetry: genome.symmetry ?? "none", probabilities, seed: 1 });
}

/** One direction for all pictures of a row, from a genome of it. */
export const directionOf = (genome) => frameOf(pointsOf(genome)).view;

/** Draw a genome into a canvas from a given direction, filling it. */
export function drawGenome(canvas, genome, view, options = {}) {
  const { count = POINTS, ...more } = options;
  const points = pointsOf(genome, count);
  const frame = { ...frameOf(points, { choose: false }), view };
  return draw(canvas, points, { frame: fitted(frame, points), ...more });
}

/** A PNG of rows [{title, cells: [{genome, caption}]}] of pictures of `side` pixels. */
export async function sheetOf(rows, view, { side = 300, more = {} } = {}) {
  const [left, foot, gap] = [rows.some((row) => row.title) ? 120 : 16, 26, 8];
  const columns = Math.max(...rows.map((row) => row.cells.length));
  const sheet = document.createElement("canvas");
  sheet.width = left + columns * (side + gap) + 8;
  sheet.height = rows.length * (side + foot + gap) + 8;
  const context = sheet.getContext("2d");
  context.fillStyle = `rgb(${GROUND})`;
  context.fillRect(0, 0, sheet.width, sheet.height);
  const cell = document.createElement("canvas");
  cell.width = cell.height = side;
  context.font = "15px system-ui, sans-serif";
  for (const [i, row] of rows.entries()) {
    const top = 8 + i * (side + foot + gap);
    context.fillStyle = "#e9e6df";
    context.textAlign = "left";
    context.fillText(row.title ?? "", 16, top + side / 2);
    for (const [j, { genome, caption }] of row.cells.entries()) {
      drawGenome(cell, genome, view, { ground: GROUND, count: 20000, ...more });
      const x = left + j * (side + gap);
      context.drawImage(cell, x, top);
      context.fillStyle = "#a5a299";
      context.textAlign = "center";
      context.fillText(caption ?? "", x + side / 2, top + side + 18);
      await new Promise((done) => setTimeout(done));
    }
  }
  return new Promise((done) => sheet.toBlob(done, "image/png"));
}

/** The kind of film that this browser can record, or null. */
export function filmKind() {
  if (!globalThis.MediaRecorder || !HTMLCanvasElement.prototype.captureStream) return null;
  return KINDS.find((kind) => MediaRecorder.isTypeSupported(kind)) ?? null;
}

/** A film there and back of `along` (t in [0, 1] -> genome), as a Blob; ontime(share) tells how far it is. */
export async function filmOf(along, view, { seconds = 6, rate = 25, side = 720, ontime = () => {}, more = {} } = {}) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = side;
  canvas.getContext("2d");
  const kind = filmKind();
  const stream = canvas.captureStream(0);
  const track = stream.getVideoTracks()[0];
  const recorder = new MediaRecorder(stream, { mimeType: kind, videoBitsPerSecond: 8_000_000 });
  const parts = [];
  recorder.ondataavailable = ({ data }) => parts.push(data);
  const over = new Promise((done) => (recorder.onstop = done));
  recorder.start();
  const many = Math.round(seconds * rate);
  for (let i = 0; i < many; i++) {
    const begun = performance.now();
    const t = 0.5 - 0.5 * Math.cos((2 * Math.PI * i) / many);
    drawGenome(canvas, along(t), view, { ground: GROUND, count: FILM_POINTS, ...more });
    track.requestFrame();
    ontime((i + 1) / many);
    await new Promise((done) => setTimeout(done, Math.max(0, 1000 / rate - (performance.now() - begun))));
  }
  recorder.stop();
  await over;
  return new Blob(parts, { type: kind });
}
