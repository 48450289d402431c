// What is tuned or bred but not kept yet, for this session: it survives a reload and goes from page to page.

const key = (id) => `draft:${id}`;

/** The genome that was left unfinished for a design, or null. */
export function draftOf(id) {
  try {
    return JSON.parse(sessionStorage.getItem(key(id)) ?? "null");
  } catch {
    return null;
  }
}

export function rememberDraft(id, genome) {
  try {
    sessionStorage.setItem(key(id), JSON.stringify(genome));
  } catch {
    // Without storage a draft lasts as long as its page.
  }
}

export function forgetDraft(id) {
  sessionStorage.removeItem(key(id));
}
