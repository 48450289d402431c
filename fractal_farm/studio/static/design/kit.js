// Small things that the pages about one design share: elements, buttons that copy, messages, files to save.

const sheet = new URL("./pages.css", import.meta.url).href;

/** An element with properties, attributes and children: element("p", {class: "soft", onclick}, "text", child). */
export function element(name, properties = {}, ...children) {
  const made = name === "svg" || SVG.has(name) ? document.createElementNS(SVG_NAMES, name) : document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key in PROPERTIES) made[key] = value;
    else made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return made;
}

const SVG_NAMES = "http://www.w3.org/2000/svg";
const SVG = new Set(["g", "circle", "line", "path", "text"]);
const PROPERTIES = { textContent: 1, value: 1, checked: 1, disabled: 1, hidden: 1, innerText: 1 };

/** Styles of these pages, once. */
export function ensureStyles() {
  if (document.querySelector(`link[href="${sheet}"]`)) return Promise.resolve();
  return new Promise((done) => {
    const link = element("link", { rel: "stylesheet", href: sheet });
    link.addEventListener("load", done);
    link.addEventListener("error", done);
    document.head.append(link);
  });
}

/** A button; without a server those that need one are disabled and say why. */
export function button(label, onclick, { quiet = true, title, disabled = false, reason, ...rest } = {}) {
  return element("button", {
    type: "button",
    class: quiet ? "button quiet" : "button",
    title: disabled && reason ? reason : title,
    disabled,
    onclick,
    ...rest,
  }, label);
}

export const NO_SERVER = "This is an exported gallery; run `farm studio` on the catalogue for this.";

/** A command line with a button that copies it. */
export function commandLine(command, label) {
  const copy = button("Copy", async () => {
    await copyText(command);
    copy.textContent = "Copied";
    setTimeout(() => (copy.textContent = "Copy"), 1500);
  }, { "aria-label": `Copy the command: ${label}` });
  return element("div", { class: "command" },
    label && element("span", { class: "soft" }, label), element("code", { tabindex: 0 }, command), copy);
}

async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const field = element("textarea", { value: text, class: "unseen" });
    document.body.append(field);
    field.select();
    document.execCommand("copy");
    field.remove();
  }
}

let messages = null;

/** A line at the foot of the page, read aloud by screen readers. */
export function say(text, kind = "note") {
  messages ??= element("div", { class: "messages", role: "status", "aria-live": "polite" });
  if (!messages.isConnected) document.body.append(messages);
  const line = element("div", { class: `message ${kind}` }, text);
  messages.append(line);
  setTimeout(() => line.remove(), kind === "error" ? 8000 : 4000);
}

/** What an API call that failed says. */
export const complaint = (error) => error?.error ?? error?.message ?? String(error);

/** Offer bytes as a download. */
export function save(blob, name) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** A group of buttons of which one is on; onchange(value). */
export function choice(label, options, value, onchange) {
  const group = element("div", { class: "choice", role: "radiogroup", "aria-label": label });
  const select = (chosen, tell = true) => {
    for (const one of group.children) {
      const on = one.dataset.value === String(chosen);
      one.setAttribute("aria-checked", on);
      one.tabIndex = on ? 0 : -1;
    }
    if (tell) onchange(chosen);
  };
  for (const [key, text, reason] of options) {
    const one = element("button", {
      type: "button", role: "radio", "data-value": key, title: reason, disabled: Boolean(reason), onclick: () => select(key),
    }, text);
    group.append(one);
  }
  group.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const able = [...group.children].filter((one) => !one.disabled);
    const next = able[(able.indexOf(document.activeElement) + step + able.length) % able.length];
    next?.focus();
    next?.click();
  });
  select(value, false);
  group.select = (chosen) => select(chosen, false);
  return group;
}

/** A number as people read it; an em dash if it is unknown. */
export function shown(value, digits = 3) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(digits);
}

/** A title with links to the other pages of a design. */
export function heading(id, title, here, extras = []) {
  const pages = [["design", "Look"], ["tune", "Tune"], ["breed", "Breed"], ["sweep", "Sweep"]];
  const link = ([page, text]) => element("a", {
    href: page === "breed" ? `#/breed?ids=${id}` : `#/${page}/${id}`, class: "tab", "aria-current": page === here ? "page" : undefined,
  }, text);
  return element("header", { class: "heading" },
    element("a", { href: "#/", class: "back", "aria-label": "Back to the gallery" }, "‹ Gallery"),
    element("h1", {}, title),
    element("nav", { class: "tabs", "aria-label": "This design" }, pages.map(link)), extras);
}
