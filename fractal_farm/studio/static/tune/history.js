// Undo and redo by gesture: one entry for each drag, not for each move of the mouse.

/** {now, commit(state), undo(), redo(), canUndo, canRedo, depth} over states that nobody changes afterwards. */
export function history(first, limit = 500) {
  const states = [first];
  let place = 0;
  return {
    get now() {
      return states[place];
    },
    get canUndo() {
      return place > 0;
    },
    get canRedo() {
      return place < states.length - 1;
    },
    get depth() {
      return place;
    },
    /** A new state after the present one; what was undone is forgotten. Equal states are one. */
    commit(state) {
      if (JSON.stringify(state) === JSON.stringify(states[place])) return false;
      states.splice(place + 1, Infinity, state);
      if (states.length > limit) states.shift();
      place = states.length - 1;
      return true;
    },
    undo: () => (place > 0 ? states[--place] : null),
    redo: () => (place < states.length - 1 ? states[++place] : null),
  };
}
