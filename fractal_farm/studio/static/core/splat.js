// Points -> pixels: a depth buffer of small discs, shaded by the depth around them (fractal_farm/picture/splat.py).
//
// draw(target, points, options) fills a canvas or an ImageData; the ground stays transparent unless `ground` is given.
// Options: colouring "gradient" | "dual", palette (name or {first, second}), turn [yaw, pitch] in radians, zoom,
// pan [x, y] in parts of the picture, frame (as frameOf gives it), fine (false: half the work, for what moves),
// disc (radius in pixels), shading, fog, fit (true: the frame is fitted to this view), ground [r, g, b] in 0-255.

import { painter } from "./colours.js";
import { cameraOf, fitted, frameOf } from "./view.js";

export { PALETTES } from "./colours.js";
export { fitted, frameOf, project, unproject } from "./view.js";
export { orbit } from "./orbit.js";

const PAD = 12;
const COVERAGE = 0.1; // of a square picture by the discs, if none lay over another
const LARGEST_DISC = 8;
const EMPTY = -1e30;
const RINGS = [[2, 0], [-2, 0], [0, 2], [0, -2], [5, 5], [-5, 5], [5, -5], [-5, -5], [12, 0], [-12, 0], [0, 12], [0, -12]];

let depth = new Float32Array(0);
let owner = new Int32Array(0);

/** Draw points (3 * n) into a canvas or an ImageData; returns the frame that was used. */
export function draw(target, points, options = {}) {
  const { width, height } = target;
  let frame = options.frame ?? frameOf(points);
  if (options.fit) frame = fitted(frame, points);
  const context = target.data ? null : target.getContext("2d");
  const image = context ? imageFor(context, width, height) : target;
  paint(image, points, frame, options);
  context?.putImageData(image, 0, 0);
  return frame;
}

const images = new WeakMap();

function imageFor(context, width, height) {
  let image = images.get(context);
  if (!image || image.width !== width || image.height !== height) {
    image = context.createImageData(width, height);
    images.set(context, image);
  }
  return image;
}

function paint(image, points, frame, options) {
  const { shading = 1.6, fog = 0.35, fine = true, ground = null } = options;
  const { width, height } = image;
  const grain = fine ? 2 : 1;
  const columns = width * grain + 2 * PAD;
  const rows = height * grain + 2 * PAD;
  if (depth.length < columns * rows) {
    depth = new Float32Array(columns * rows);
    owner = new Int32Array(columns * rows);
  }
  depth.fill(EMPTY, 0, columns * rows);
  const side = Math.min(width, height) * grain;
  const by_number = Math.sqrt(COVERAGE / Math.max(1, points.length / 3)) * side * Math.max(1, Math.sqrt(options.zoom ?? 1));
  const disc = Math.min(Math.max(options.disc ? options.disc * grain : by_number, fine ? 1 : 0.8), LARGEST_DISC);
  const spread = scatter(points, frame, { ...options, width, height }, { grain, columns, rows, disc });
  const lit = { shading, fog, grain, columns, spread, rings: ringsOf(fine, columns) };
  compose(image, points, frame, painter(options.colouring, options.palette), lit, ground);
}

/** Fill `depth` and `owner` with the nearest points; returns the depth of the nearest and of the farthest. */
function scatter(points, frame, view, { grain, columns, rows, disc }) {
  const { rotation: r, scale: size, middle } = cameraOf({ ...view, frame });
  const scale = size * grain;
  const [cx, cy, cz] = frame.centre;
  const [r0, r1, r2, r3, r4, r5, r6, r7, r8] = r.map((value) => value * scale);
  const [left, top] = [middle[0] * grain + PAD, middle[1] * grain + PAD];
  const offsets = discOffsets(disc, columns);
  const [edge, right, bottom] = [Math.ceil(disc), columns - Math.ceil(disc), rows - Math.ceil(disc)];
  let nearest = EMPTY;
  let farthest = -EMPTY;
  const single = offsets.length === 1;
  for (let i = 0; i < points.length; i += 3) {
    const x = points[i] - cx;
    const y = points[i + 1] - cy;
    const z = points[i + 2] - cz;
    const column = (left + r0 * x + r1 * y + r2 * z) | 0;
    const row = (top - (r3 * x + r4 * y + r5 * z)) | 0;
    const near = Math.fround(r6 * x + r7 * y + r8 * z);
    if (near > nearest) nearest = near;
    if (near < farthest) farthest = near;
    if (column < edge || row < edge || column >= right || row >= bottom) continue;
    const place = row * columns + column;
    if (single) {
      if (near > depth[place]) {
        depth[place] = near;
        owner[place] = i;
      }
      continue;
    }
    for (let k = 0; k < offsets.length; k++) {
      const here = place + offsets[k];
      if (near > depth[here]) {
        depth[here] = near;
        owner[here] = i;
      }
    }
  }
  return [nearest, farthest];
}

function compose(image, points, frame, paintAt, { shading, fog, grain, columns, spread, rings }, ground) {
  const { width, height } = image;
  const words = new Uint32Array(image.data.buffer, image.data.byteOffset, width * height);
  const [lx, ly, lz] = frame.low;
  const [sx, sy, sz] = [0, 1, 2].map((k) => (frame.high[k] > frame.low[k] ? 1 / (frame.high[k] - frame.low[k]) : 0));
  const haze = fog / Math.max(spread[0] - spread[1], 1e-20);
  const [first, share] = [spread[0], 1 / (grain * grain)];
  const [backRed, backGreen, backBlue] = ground ?? [0, 0, 0];
  const empty = ground ? packed(backRed, backGreen, backBlue, 255) : 0;
  const { offsets, steepness } = rings;
  const count = offsets.length;
  const colour = new Float64Array(3);
  for (let y = 0, pixel = 0; y < height; y++) {
    const line = (y * grain + PAD) * columns + PAD;
    for (let x = 0; x < width; x++, pixel++) {
      const corner = line + x * grain;
      let light = -1;
      let red = 0;
      let green = 0;
      let blue = 0;
      let weight = 0;
      for (let row = 0, start = corner; row < grain; row++, start += columns) {
        for (let place = start; place < start + grain; place++) {
          const here = depth[place];
          if (here === EMPTY_32) continue;
          if (light < 0) {
            let hidden = 0;
            for (let k = 0; k < count; k++) {
              const rise = (depth[place + offsets[k]] - here) * steepness[k];
              if (rise > 0) hidden += rise < 1 ? rise : 1;
            }
            light = 1 / (1 + (shading * hidden) / count);
          }
          const i = owner[place];
          paintAt((points[i] - lx) * sx, (points[i + 1] - ly) * sy, (points[i + 2] - lz) * sz, colour);
          const presence = 1 - haze * (first - here);
          red += presence * colour[0];
          green += presence * colour[1];
          blue += presence * colour[2];
          weight += presence;
        }
      }
      if (weight === 0) {
        words[pixel] = empty;
        continue;
      }
      const alpha = weight * share;
      if (ground) {
        const lit = 255 * light * share;
        const rest = 1 - alpha;
        words[pixel] = packed(backRed * rest + lit * red, backGreen * rest + lit * green, backBlue * rest + lit * blue, 255);
      } else {
        const lit = (255 * light) / weight;
        words[pixel] = packed(lit * red, lit * green, lit * blue, 255 * alpha);
      }
    }
  }
}

/** One pixel as a little-endian word; numbers in [0, 255]. */
const packed = (red, green, blue, alpha) => ((alpha + 0.5) << 24) | ((blue + 0.5) << 16) | ((green + 0.5) << 8) | (red + 0.5);

const EMPTY_32 = Math.fround(EMPTY);

function discOffsets(disc, columns) {
  const reach = Math.floor(disc);
  const offsets = [];
  for (let row = -reach; row <= reach; row++) {
    for (let column = -reach; column <= reach; column++) {
      if (row * row + column * column <= disc * disc) offsets.push(row * columns + column);
    }
  }
  return Int32Array.from(offsets);
}

function ringsOf(fine, columns) {
  const rings = fine ? RINGS : RINGS.slice(0, 8);
  return {
    offsets: Int32Array.from(rings, ([down, right]) => down * columns + right),
    steepness: Float32Array.from(rings, ([down, right]) => 1 / (4 * Math.max(Math.abs(down), Math.abs(right)))),
  };
}
