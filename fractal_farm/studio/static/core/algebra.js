// 3 x 3 linear algebra of maps (12 numbers, row-major 3 x 4 [A | b]), as fractal_farm/ifs/linear_algebra.py has it.

/** Determinant of the A of the map that begins at `at`. */
export function determinant(m, at = 0) {
  return det(m[at], m[at + 1], m[at + 2], m[at + 4], m[at + 5], m[at + 6], m[at + 8], m[at + 9], m[at + 10]);
}

/** The point that a map leaves where it is: (I - A) x = b by Cramer's rule. */
export function fixedPoint(m, at = 0) {
  const [a, b, c, x, d, e, f, y, g, h, i, z] = Array.from({ length: 12 }, (_, k) => m[at + k]);
  const [p, q, r] = [1 - a, 1 - e, 1 - i];
  const whole = det(p, -b, -c, -d, q, -f, -g, -h, r);
  return [
    det(x, -b, -c, y, q, -f, z, -h, r) / whole,
    det(p, x, -c, -d, y, -f, -g, z, r) / whole,
    det(p, -b, x, -d, q, y, -g, -h, z) / whole,
  ];
}

/** Spectral norm of the A of the map that begins at `at`: the largest eigenvalue of A^T A in closed form (Smith 1961). */
export function contraction(m, at = 0) {
  const a = m[at];
  const b = m[at + 1];
  const c = m[at + 2];
  const d = m[at + 4];
  const e = m[at + 5];
  const f = m[at + 6];
  const g = m[at + 8];
  const h = m[at + 9];
  const i = m[at + 10];
  const xx = a * a + d * d + g * g;
  const yy = b * b + e * e + h * h;
  const zz = c * c + f * f + i * i;
  const xy = a * b + d * e + g * h;
  const xz = a * c + d * f + g * i;
  const yz = b * c + e * f + h * i;
  const mean = (xx + yy + zz) / 3;
  const u = xx - mean;
  const v = yy - mean;
  const w = zz - mean;
  const spread = Math.sqrt((u * u + v * v + w * w + 2 * (xy * xy + xz * xz + yz * yz)) / 6);
  if (spread <= 1e-300) return Math.sqrt(Math.max(mean, 0));
  const half = (u * (v * w - yz * yz) - xy * (xy * w - yz * xz) + xz * (xy * yz - v * xz)) / (2 * spread ** 3);
  const angle = Math.acos(Math.min(1, Math.max(-1, half))) / 3;
  return Math.sqrt(Math.max(mean + 2 * spread * Math.cos(angle), 0));
}

/** out[to...] = first after second: what `second` does, then `first`. No arrays are made: this is the inner loop. */
export function compose(first, a, second, b, out, to) {
  for (let row = 0; row < 12; row += 4) {
    const x = first[a + row];
    const y = first[a + row + 1];
    const z = first[a + row + 2];
    out[to + row] = x * second[b] + y * second[b + 4] + z * second[b + 8];
    out[to + row + 1] = x * second[b + 1] + y * second[b + 5] + z * second[b + 9];
    out[to + row + 2] = x * second[b + 2] + y * second[b + 6] + z * second[b + 10];
    out[to + row + 3] = x * second[b + 3] + y * second[b + 7] + z * second[b + 11] + first[a + row + 3];
  }
}

function det(a, b, c, d, e, f, g, h, i) {
  return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
}
