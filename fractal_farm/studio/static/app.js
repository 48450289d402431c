// The pages by their address: #/ the gallery, #/design/ID, #/tune/ID, #/breed?ids=A,B, #/sweep/ID, #/morph/A/B.

import { el } from "./core/dom.js";
import { openStudio } from "./core/source.js";

const PAGES = {
  "": { module: "./gallery/gallery.js", params: (_, query) => ({ query }) },
  design: { module: "./design/design.js", params: ([id]) => ({ id }) },
  tune: { module: "./tune/tune.js", params: ([id]) => ({ id }) },
  breed: { module: "./breed/breed.js", params: (_, query) => ({ ids: idsIn(query) }) },
  sweep: { module: "./sweep/sweep.js", params: ([id]) => ({ id }) },
  morph: { module: "./sweep/morph.js", params: ([a, b]) => ({ a, b }) },
};

const main = document.querySelector("main");
const notice = document.querySelector("#notice");
let tearDown = null;
let shown = null; // address of the page that is shown
let turn = 0;
let noticeEnd = 0;

function idsIn(query) {
  return (new URLSearchParams(query).get("ids") ?? "").split(",").filter(Boolean);
}

function parsed() {
  const [path, query = ""] = location.hash.replace(/^#\/?/, "").split("?");
  const [name, ...parts] = path.split("/").map(decodeURIComponent);
  return { name: PAGES[name] ? name : "", parts, query };
}

async function route(studio) {
  const { name, parts, query } = parsed();
  const address = `${name}/${parts.join("/")}`;
  if (shown === address && tearDown?.followed?.({ query })) return;
  const mine = ++turn;
  try {
    if (tearDown) await tearDown();
  } finally {
    tearDown = null;
  }
  main.replaceChildren();
  main.className = `page-${name || "gallery"}`;
  shown = address;
  for (const link of document.querySelectorAll("header nav a")) {
    link.toggleAttribute("aria-current", link.getAttribute("href") === `#/${name}`);
  }
  try {
    const { show } = await import(PAGES[name].module);
    if (mine !== turn) return;
    const end = await show(main, PAGES[name].params(parts, query), studio);
    if (mine === turn) tearDown = end ?? null;
    else await end?.();
  } catch (error) {
    if (mine !== turn) return;
    main.replaceChildren(
      el("section", { class: "failure" }, el("h1", {}, "This page cannot be shown"), el("p", {}, error.message), el("a", { class: "button", href: "#/" }, "To the gallery")),
    );
  }
}

function tell(text, kind = "") {
  clearTimeout(noticeEnd);
  notice.textContent = text;
  notice.className = `shown ${kind}`;
  noticeEnd = setTimeout(() => (notice.className = ""), 6000);
}

function themes() {
  const button = document.querySelector("#theme");
  const system = matchMedia("(prefers-color-scheme: light)");
  const apply = () => {
    const chosen = localStorage.getItem("farm-theme") ?? (system.matches ? "light" : "dark");
    document.documentElement.dataset.theme = chosen;
    button.setAttribute("aria-pressed", String(chosen === "light"));
    document.dispatchEvent(new Event("themed"));
  };
  button.addEventListener("click", () => {
    const next = document.documentElement.dataset.theme === "light" ? "dark" : "light";
    if (next === (system.matches ? "light" : "dark")) localStorage.removeItem("farm-theme");
    else localStorage.setItem("farm-theme", next);
    apply();
  });
  system.addEventListener("change", apply);
  apply();
}

themes();
try {
  const studio = await openStudio();
  studio.tell = tell;
  globalThis.farm = studio; // for whoever opens the console
  document.title = `${studio.catalogue.title} · Fractal Farm`;
  document.querySelector("#place").textContent = studio.catalogue.title;
  studio.on("status", ({ error, quiet }) => {
    document.body.classList.toggle("offline", Boolean(error && quiet));
    if (error && !quiet) tell(error, "bad");
  });
  addEventListener("hashchange", () => route(studio));
  await route(studio);
} catch (error) {
  main.replaceChildren(el("section", { class: "failure" }, el("h1", {}, "The catalogue cannot be read"), el("p", {}, error.message)));
}
