// Scores follow what is let go: the server is asked once for the latest genome, and what comes too late is dropped.

/** scorer(studio, {onscores(answer, milliseconds), onwaiting(), onerror(error)}) -> {ask(genome), stop()}. */
export function scorer(studio, { onscores, onwaiting, onerror }) {
  const known = new Map();
  let latest = 0;
  let busy = false;
  let next = null;

  async function run() {
    busy = true;
    while (next) {
      const { genome, number, text, begun } = next;
      next = null;
      try {
        const answer = known.get(text) ?? (await studio.api.post("score", { genome }));
        known.set(text, answer);
        if (number === latest) onscores(answer, performance.now() - begun);
      } catch (error) {
        if (number === latest) onerror(error);
      }
    }
    busy = false;
  }

  return {
    ask(genome) {
      const number = ++latest;
      next = { genome, number, text: JSON.stringify(genome), begun: performance.now() };
      onwaiting();
      if (!busy) run();
    },
    stop: () => (latest = -1),
  };
}
