// Genomes in the hand: names and ranges of genes, steps, and turns of a map about an axis. Pure; rows of seven numbers.

export const GENES = [
  { key: "alpha_p", name: "pitch", kind: "angle", low: -180, high: 180, step: 0.5, help: "turn about x" },
  { key: "alpha_y", name: "yaw", kind: "angle", low: -180, high: 180, step: 0.5, help: "turn about y" },
  { key: "alpha_r", name: "roll", kind: "angle", low: -180, high: 180, step: 0.5, help: "turn about z" },
  { key: "rho", name: "rho", kind: "ratio", low: 0.001, high: 0.999, step: 0.001, help: "size of the copy" },
  { key: "d1", name: "d1", kind: "offset", low: -3, high: 3, step: 0.005, help: "offset along x" },
  { key: "d2", name: "d2", kind: "offset", low: -3, high: 3, step: 0.005, help: "offset along y" },
  { key: "d3", name: "d3", kind: "offset", low: -3, high: 3, step: 0.005, help: "offset along z" },
];
export const RHO = 3;
const DEGREE = Math.PI / 180;

/** {genes, probabilities, symmetry, phenotype}: the parts of a genome that pages change, each its own copy. */
export function copyOf(genome) {
  const copy = { genes: genome.genes.map((row) => Array.from(row)) };
  if (genome.probabilities) copy.probabilities = Array.from(genome.probabilities);
  if (genome.symmetry && genome.symmetry !== "none") copy.symmetry = genome.symmetry;
  if (genome.phenotype) copy.phenotype = { ...genome.phenotype };
  return copy;
}

/** Whether rows have names: affine maps have twelve numbers without any. */
export const isSimilarity = (genome) => genome.genes[0].length === 7;

/** A gene as people read it: angles in degrees. */
export const toShown = (gene, value) => (GENES[gene].kind === "angle" ? value / DEGREE : value);

/** The number to store for what somebody set: angles wrapped, rho within (0, 1). */
export function toStored(gene, value) {
  return bounded(gene, GENES[gene].kind === "angle" ? value * DEGREE : value);
}

/** A stored number brought into the range of its gene, as fractal_farm does after mutation. */
export function bounded(gene, value) {
  if (GENES[gene].kind === "angle") return wrapped(value);
  if (GENES[gene].kind !== "ratio") return value;
  const { low, high } = GENES[gene];
  const span = high - low;
  const folded = Math.abs((((value - low) % (2 * span)) + 2 * span) % (2 * span));
  return low + (folded <= span ? folded : 2 * span - folded);
}

export function wrapped(angle) {
  if (angle >= -Math.PI && angle <= Math.PI) return angle;
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}

/** Probabilities of sum 1 with one of them set; the others keep their proportions. */
export function withProbability(probabilities, index, value) {
  const least = 0.005;
  const set = Math.min(1 - least * (probabilities.length - 1), Math.max(least, value));
  const rest = probabilities.reduce((sum, share, i) => (i === index ? sum : sum + share), 0);
  const out = probabilities.map((share, i) => (i === index ? set : Math.max(least, (share * (1 - set)) / rest)));
  const total = out.reduce((sum, share) => sum + share, 0);
  return out.map((share) => share / total);
}

/** Rows of R = R_z(roll) R_x(pitch) R_y(yaw), nine numbers. */
export function rotationOf([pitch, yaw, roll]) {
  const [cp, sp, cy] = [Math.cos(pitch), Math.sin(pitch), Math.cos(yaw)];
  const [sy, cr, sr] = [Math.sin(yaw), Math.cos(roll), Math.sin(roll)];
  return [
    cr * cy - sr * sp * sy, -sr * cp, cr * sy + sr * sp * cy,
    sr * cy + cr * sp * sy, cr * cp, sr * sy - cr * sp * cy,
    -cp * sy, sp, cp * cy,
  ];
}

/** Pitch, yaw and roll of a rotation; of the two triples that there are, the one nearer to `near`. */
export function anglesOf(r, near = [0, 0, 0]) {
  const pitch = Math.asin(Math.min(1, Math.max(-1, r[7])));
  if (Math.abs(r[7]) > 1 - 1e-12) {
    // Yaw and roll turn about one axis: yaw stays, roll takes the rest.
    const whole = Math.atan2(r[3], r[0]);
    return [pitch, near[1], wrapped(whole - Math.sign(r[7]) * near[1])];
  }
  const first = [pitch, Math.atan2(-r[6], r[8]), Math.atan2(-r[1], r[4])];
  const second = [wrapped(Math.PI - pitch), wrapped(first[1] + Math.PI), wrapped(first[2] + Math.PI)];
  const away = (angles) => angles.reduce((sum, angle, i) => sum + wrapped(angle - near[i]) ** 2, 0);
  return away(first) <= away(second) ? first : second;
}

/** The rotation by an angle about a unit vector, nine numbers. */
export function about([x, y, z], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const t = 1 - c;
  return [
    c + t * x * x, t * x * y - s * z, t * x * z + s * y,
    t * x * y + s * z, c + t * y * y, t * y * z - s * x,
    t * x * z - s * y, t * y * z + s * x, c + t * z * z,
  ];
}

export function times(a, b) {
  const out = [];
  for (let i = 0; i < 9; i += 3) {
    for (let j = 0; j < 3; j++) out.push(a[i] * b[j] + a[i + 1] * b[3 + j] + a[i + 2] * b[6 + j]);
  }
  return out;
}

const apply = (m, v) => [0, 3, 6].map((i) => m[i] * v[0] + m[i + 1] * v[1] + m[i + 2] * v[2]);
const back = (m, v) => [0, 1, 2].map((i) => m[i] * v[0] + m[3 + i] * v[1] + m[6 + i] * v[2]);

/** Where a map takes a point. */
export function image(row, point, phenotype = {}) {
  const { rotation, inside } = reading(row, phenotype);
  const d = row.slice(4);
  const turned = apply(rotation, inside ? point.map((value, k) => value + d[k]) : point);
  return turned.map((value, k) => row[RHO] * value + (inside ? 0 : d[k]));
}

/** The row of a map whose copy lies further by `move` (units of points). */
export function moved(row, move, phenotype = {}) {
  const { rotation, inside } = reading(row, phenotype);
  const by = inside ? back(rotation, move).map((value) => value / row[RHO]) : move;
  return [...row.slice(0, 4), ...row.slice(4).map((value, k) => value + by[k])];
}

/** The row of a map whose copy is turned about an axis through the image of `centre`, which stays. */
export function turnedAbout(row, axis, angle, centre, phenotype = {}) {
  const { rotation, sign } = reading(row, phenotype);
  const before = image(row, centre, phenotype);
  const angles = anglesOf(times(about(axis, angle), rotation), row.slice(0, 3).map((value) => sign * value));
  const out = [...angles.map((value) => sign * value), ...row.slice(RHO)];
  const after = image(out, centre, phenotype);
  return moved(out, before.map((value, k) => value - after[k]), phenotype);
}

function reading(row, { rotation_sign: sign = 1, map_form: form = "rho R (x + d)" }) {
  return { rotation: rotationOf(row.slice(0, 3).map((value) => sign * value)), inside: form === "rho R (x + d)", sign };
}
