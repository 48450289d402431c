// Let a run grow from chosen designs (`farm breed`), and show how it stands.

import { NO_SERVER, button, commandLine, complaint, element, say } from "../design/kit.js";

const LOOK = 1000;
const OVER = ["done", "failed", "cancelled"];

/** {root, refresh(number of chosen children), stop()}; ids() gives the designs to breed from. */
export function growing(studio, ids) {
  let ended = false;
  let job = null;
  const says = element("span", { class: "soft", role: "status" });
  const bar = element("progress", { max: 1, "aria-label": "Progress of the run" });
  const cancel = button("Cancel", () => job && studio.api.post(`jobs/${job}/cancel`, {}).catch((error) => say(complaint(error), "error")));
  const progress = element("div", { class: "progress", hidden: true }, bar, says, cancel);
  const result = element("div", { class: "made" });
  const start = button("Grow a run from them", grow, { disabled: !studio.can, reason: NO_SERVER, id: "grow" });
  const words = element("p", { class: "soft small" });
  const root = element("section", { class: "panel", "aria-label": "Grow" }, element("h2", {}, "Grow"), words,
    element("div", { class: "toolbar" }, start), progress, result);

  async function grow() {
    start.disabled = true;
    try {
      const designs = await ids();
      const answer = await studio.api.post("breed", { design_ids: designs });
      job = answer.job;
      progress.hidden = false;
      result.replaceChildren(answer.command ? commandLine(answer.command, "the same by hand") : "");
      if (job) await follow();
    } catch (error) {
      say(complaint(error), "error");
      result.append(element("p", { class: "bad", "data-grown": "failed" }, complaint(error)));
    }
    progress.hidden = true;
    start.disabled = ended;
  }

  async function follow() {
    while (!ended) {
      const told = await studio.api.get(`jobs/${job}`);
      says.textContent = [told.state, told.stage].filter(Boolean).join(": ");
      if (Number.isFinite(told.share)) bar.value = told.share;
      if (OVER.includes(told.state)) {
        const good = told.state === "done";
        result.append(element("p", { class: good ? "good" : "bad", "data-grown": told.state }, good ? "The run has ended; its designs are in the gallery." : (told.message ?? told.state)));
        return;
      }
      await new Promise((done) => setTimeout(done, LOOK));
    }
  }

  return {
    root,
    refresh(many) {
      words.textContent = many
        ? `The ${many} chosen children are kept, and a run breeds a thousand candidates from them.`
        : "Without a choice the run breeds from the parents above.";
    },
    stop: () => (ended = true),
  };
}
