// What somebody looks at, as it stands in the address: so that Back works, and a link or a saved view is a text.

export const SCORES = ["fitness", "d0", "d2", "lle", "gap", "similarity_dimension", "grams", "created"];

export const DEFAULTS = {
  sort: "fitness",
  descending: true,
  ranges: {}, // column -> [low | null, high | null]
  maps: [],
  symmetry: [],
  favourite: false,
  rating: 0,
  rejected: false,
  hand: false,
  niche: null,
  like: null, // a representative's row: its group is shown
  folded: true,
  text: "",
  points: "even",
  colours: "gradient",
};

/** State -> the part of the hash after the question mark; what is as usual is left out. */
export function written(state) {
  const query = new URLSearchParams();
  if (state.sort !== DEFAULTS.sort || state.descending !== DEFAULTS.descending) {
    query.set("sort", `${state.descending ? "-" : ""}${state.sort}`);
  }
  for (const name of SCORES) {
    const range = state.ranges[name];
    if (range && (range[0] !== null || range[1] !== null)) query.set(name, `${range[0] ?? ""}..${range[1] ?? ""}`);
  }
  for (const name of ["maps", "symmetry"]) if (state[name].length) query.set(name, state[name].join(","));
  for (const name of ["favourite", "rejected", "hand"]) if (state[name]) query.set(name, "1");
  for (const name of ["niche", "like"]) if (state[name] !== null) query.set(name, String(state[name]));
  if (state.rating) query.set("rating", String(state.rating));
  if (!state.folded) query.set("folded", "0");
  if (state.text) query.set("find", state.text);
  for (const name of ["points", "colours"]) if (state[name] !== DEFAULTS[name]) query.set(name, state[name]);
  return query.toString().replaceAll("%2C", ",").replaceAll("%3A", ":");
}

/** The other way round; what makes no sense is taken as usual. */
export function readState(text) {
  const query = new URLSearchParams(text);
  const state = { ...DEFAULTS, ranges: {} };
  const sort = query.get("sort");
  if (sort) [state.sort, state.descending] = [sort.replace(/^-/, ""), sort.startsWith("-")];
  for (const name of SCORES) {
    const range = query.get(name)?.split("..");
    if (range?.length === 2) state.ranges[name] = range.map((end) => (end.trim() && Number.isFinite(+end) ? +end : null));
  }
  for (const name of ["maps", "symmetry"]) {
    state[name] = (query.get(name) ?? "").split(",").filter((one) => /^\d{1,3}$/.test(one)).map(Number);
  }
  for (const name of ["favourite", "rejected", "hand"]) state[name] = query.get(name) === "1";
  for (const name of ["niche", "like"]) if (/^\d+$/.test(query.get(name) ?? "")) state[name] = +query.get(name);
  state.rating = Math.min(5, Math.max(0, parseInt(query.get("rating") ?? "0", 10) || 0));
  state.folded = query.get("folded") !== "0";
  state.text = query.get("find") ?? "";
  if (query.get("points") === "density") state.points = "density";
  if (/^(gradient|dual:[a-z]+)$/.test(query.get("colours") ?? "")) state.colours = query.get("colours");
  return state;
}
