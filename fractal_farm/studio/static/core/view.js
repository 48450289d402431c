// Where to look from (fractal_farm/picture/view.py), and from points to pixels.

const TILT = (16 * Math.PI) / 180;
const SAMPLE = 800;
const TURNS = 20;
const WORTH_A_TURN = 0.9;
const ROOM = 0.88; // of the shorter side, that a shape fills
const UPRIGHT = [1, 0, 0, 0, 0, 1, 0, -1, 0]; // x to the right, z up, seen along y

/** {centre, radius, view, low, high}: the middle of a cloud, the ball about it, a good direction and its box. */
export function frameOf(points, { choose = true } = {}) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i += 3) {
    for (let k = 0; k < 3; k++) {
      const value = points[i + k];
      if (value < low[k]) low[k] = value;
      if (value > high[k]) high[k] = value;
    }
  }
  const centre = low.map((value, k) => (value + high[k]) / 2);
  let square = 0;
  for (let i = 0; i < points.length; i += 3) {
    const x = points[i] - centre[0];
    const y = points[i + 1] - centre[1];
    const z = points[i + 2] - centre[2];
    square = Math.max(square, x * x + y * y + z * z);
  }
  const frame = { centre, radius: Math.sqrt(square) || 1, view: UPRIGHT, low, high };
  return choose ? { ...frame, view: chooseView(points, centre) } : frame;
}

/** The frame with a middle and a radius such that the shape, seen along its view, fills the picture; it may not turn. */
export function fitted(frame, points) {
  const { view } = frame;
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i += 3) {
    for (let k = 0; k < 3; k++) {
      const at = view[3 * k] * points[i] + view[3 * k + 1] * points[i + 1] + view[3 * k + 2] * points[i + 2];
      if (at < low[k]) low[k] = at;
      if (at > high[k]) high[k] = at;
    }
  }
  const middle = low.map((value, k) => (value + high[k]) / 2);
  const centre = [0, 1, 2].map((k) => view[k] * middle[0] + view[3 + k] * middle[1] + view[6 + k] * middle[2]);
  return { ...frame, centre, radius: Math.max(high[0] - low[0], high[1] - low[1]) / 2 || 1 };
}

/** Rotation, scale (pixels a unit) and middle (pixels) of {turn: [yaw, pitch], zoom, pan, frame, width, height}. */
export function cameraOf({ turn = [0, 0], zoom = 1, pan = [0, 0], frame, width, height }) {
  const [cy, sy, cp, sp] = [Math.cos(turn[0]), Math.sin(turn[0]), Math.cos(turn[1]), Math.sin(turn[1])];
  const spin = [cy, 0, sy, sp * sy, cp, -sp * cy, -cp * sy, sp, cp * cy];
  return {
    rotation: product(spin, frame.view ?? UPRIGHT),
    scale: (zoom * 0.5 * ROOM * Math.min(width, height)) / frame.radius,
    middle: [width * (0.5 + pan[0]), height * (0.5 + pan[1])],
  };
}

/** Where a point lies in a picture: [x, y] in pixels, y downwards, and depth in pixels towards the viewer. */
export function project(point, options) {
  const { rotation: r, scale, middle } = cameraOf(options);
  const q = point.map((value, k) => value - options.frame.centre[k]);
  const [x, y, z] = [0, 3, 6].map((k) => scale * (r[k] * q[0] + r[k + 1] * q[1] + r[k + 2] * q[2]));
  return [middle[0] + x, middle[1] - y, z];
}

/** The direction in the units of points of a move on the screen by [x, y] pixels, and towards the viewer by z. */
export function unproject([x, y, z = 0], options) {
  const { rotation: r, scale } = cameraOf(options);
  return [0, 1, 2].map((k) => (r[k] * x - r[3 + k] * y + r[6 + k] * z) / scale);
}

/** Rows right, up and towards the viewer: along the axis of least variance, tilted, turned to fill the frame. */
function chooseView(points, centre) {
  const step = 3 * Math.max(1, Math.ceil(points.length / 3 / SAMPLE));
  const sample = new Float64Array(3 * Math.ceil(points.length / step));
  for (let i = 0, o = 0; i < points.length; i += step, o += 3) {
    for (let k = 0; k < 3; k++) sample[o + k] = points[i + k] - centre[k];
  }
  const mean = [0, 0, 0];
  for (let i = 0; i < sample.length; i++) mean[i % 3] += (3 * sample[i]) / sample.length;
  const axes = principalAxes(sample, mean);
  let up = axes[2];
  let right = axes[1];
  let near = cross(right, up);
  if (dot(mean, near) < 0) [right, near] = [right.map((v) => -v), near.map((v) => -v)];
  if (dot(mean, up) > 0) [right, up] = [right.map((v) => -v), up.map((v) => -v)];
  const [c, s] = [Math.cos(TILT), Math.sin(TILT)];
  const tilted = [right, up.map((v, k) => c * v + s * near[k]), up.map((v, k) => c * near[k] - s * v)];
  const angle = fillingTurn(sample, tilted);
  return product([Math.cos(angle), -Math.sin(angle), 0, Math.sin(angle), Math.cos(angle), 0, 0, 0, 1], tilted.flat());
}

function fillingTurn(sample, [right, up]) {
  const count = sample.length / 3;
  const xs = new Float64Array(count);
  const ys = new Float64Array(count);
  for (let p = 0, i = 0; p < count; p++, i += 3) {
    xs[p] = sample[i] * right[0] + sample[i + 1] * right[1] + sample[i + 2] * right[2];
    ys[p] = sample[i] * up[0] + sample[i + 1] * up[1] + sample[i + 2] * up[2];
  }
  const extents = [];
  const angleOf = (turn) => -Math.PI / 4 + (Math.PI / 2) * (turn / TURNS);
  for (let turn = 0; turn <= TURNS; turn++) {
    const c = Math.cos(angleOf(turn));
    const s = Math.sin(angleOf(turn));
    let left = Infinity;
    let most = -Infinity;
    let bottom = Infinity;
    let top = -Infinity;
    for (let p = 0; p < count; p++) {
      const u = c * xs[p] - s * ys[p];
      const v = s * xs[p] + c * ys[p];
      if (u < left) left = u;
      if (u > most) most = u;
      if (v < bottom) bottom = v;
      if (v > top) top = v;
    }
    extents.push(Math.max(most - left, top - bottom));
  }
  const best = extents.indexOf(Math.min(...extents));
  return extents[best] < WORTH_A_TURN * extents[TURNS / 2] ? angleOf(best) : 0;
}

/** Three axes of a cloud (3 * n) of this mean, of ascending variance (Jacobi's method). */
function principalAxes(sample, mean) {
  const a = [0, 1, 2].map(() => [0, 0, 0]);
  for (let p = 0; p < sample.length; p += 3) {
    for (let i = 0; i < 3; i++) {
      for (let j = 0; j <= i; j++) a[i][j] += (sample[p + i] - mean[i]) * (sample[p + j] - mean[j]);
    }
  }
  for (const [i, j] of [[0, 1], [0, 2], [1, 2]]) a[i][j] = a[j][i];
  const v = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]; // columns are axes
  for (let sweep = 0; sweep < 12; sweep++) {
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]]) {
      if (Math.abs(a[p][q]) < 1e-12 * (Math.abs(a[p][p]) + Math.abs(a[q][q]))) continue;
      const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const t = (Math.sign(theta) || 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
      const c = 1 / Math.sqrt(t * t + 1);
      const s = t * c;
      for (let k = 0; k < 3; k++) [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
      for (let k = 0; k < 3; k++) [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
      for (let k = 0; k < 3; k++) [v[k][p], v[k][q]] = [c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]];
    }
  }
  const order = [0, 1, 2].sort((i, j) => a[i][i] - a[j][j]);
  return order.map((k) => [v[0][k], v[1][k], v[2][k]]);
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function product(a, b) {
  const out = [];
  for (let i = 0; i < 9; i += 3) {
    for (let j = 0; j < 3; j++) out.push(a[i] * b[j] + a[i + 1] * b[3 + j] + a[i + 2] * b[6 + j]);
  }
  return out;
}
