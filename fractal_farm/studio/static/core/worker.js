// Draws thumbnails from maps, away from the page. See thumbnails.js.

import { evenPoints, randomIteration, seedOf } from "./ifs.js";
import { draw, fitted, frameOf } from "./splat.js";

const NUMBERS = 13; // of a map in a block: [A | b] and its probability

self.onmessage = ({ data: { ticket, jobs } }) => {
  const pictures = jobs.map(picture);
  self.postMessage({ ticket, pictures }, pictures.map((one) => one.buffer).filter(Boolean));
};

function picture({ maps, symmetry, seed, size, count, view, colouring, palette, even, fine, turn, zoom }) {
  const { affine, probabilities } = split(maps);
  if (!probabilities.length) return { buffer: null, view: null };
  const stream = seedOf(seed);
  const points = even
    ? evenPoints(affine, count, { symmetry, probabilities, seed: stream })
    : randomIteration(affine, probabilities, count, stream, symmetry);
  let frame = frameOf(points, { choose: !view });
  frame = fitted({ ...frame, view: view ?? frame.view }, points);
  const image = { width: size, height: size, data: new Uint8ClampedArray(4 * size * size) };
  draw(image, points, { frame, colouring, palette, fine, turn, zoom });
  return { buffer: image.data.buffer, view: frame.view };
}

/** Maps and probabilities of a row of a block; maps that are not used are all 0. */
function split(rows) {
  let n = 0;
  while (n < rows.length / NUMBERS && rows[NUMBERS * n + 12] > 0) n++;
  const affine = new Float64Array(12 * n);
  const probabilities = new Float64Array(n);
  for (let i = 0; i < n; i++) {
    affine.set(rows.subarray(NUMBERS * i, NUMBERS * i + 12), 12 * i);
    probabilities[i] = rows[NUMBERS * i + 12];
  }
  return { affine, probabilities };
}
