// The paper's two colourings of a point by its place (fractal_farm/picture/colours.py), and tones for the second.

const LEAST_VALUE = 0.5; // brightness that the darkest colour is raised to
const GREY = 0.12;

/** Pairs of tones C1, C2 of the dual colouring: C = C1 - C2 (x, y, z) / range. */
export const PALETTES = {
  amber: { first: [1.0, 0.88, 0.52], second: [0.35, 0.72, 0.22] },
  silver: { first: [0.98, 0.98, 1.0], second: [0.42, 0.4, 0.32] },
  rose: { first: [1.0, 0.82, 0.8], second: [0.1, 0.62, 0.38] },
  jade: { first: [0.82, 1.0, 0.86], second: [0.72, 0.24, 0.4] },
  sapphire: { first: [0.8, 0.94, 1.0], second: [0.72, 0.5, 0.08] },
};

/** A function (x, y, z in [0, 1], out) that writes red, green and blue in [0, 1]. */
export function painter(colouring = "gradient", palette = "amber") {
  if (colouring === "dual") {
    const { first, second } = typeof palette === "string" ? (PALETTES[palette] ?? PALETTES.amber) : palette;
    return (x, y, z, out) => {
      out[0] = clamp(first[0] - second[0] * x);
      out[1] = clamp(first[1] - second[1] * y);
      out[2] = clamp(first[2] - second[2] * z);
    };
  }
  return (x, y, z, out) => {
    // Dark colours are brightened in their own hue, so that none sinks into a dark ground.
    const value = Math.max(x, y, z);
    const lift = (LEAST_VALUE + (1 - LEAST_VALUE) * value) / (value + GREY);
    out[0] = clamp((x + GREY) * lift);
    out[1] = clamp((y + GREY) * lift);
    out[2] = clamp((z + GREY) * lift);
  };
}

const clamp = (value) => (value < 0 ? 0 : value > 1 ? 1 : value);
