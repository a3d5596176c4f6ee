"use strict";
// The drawings of the page, the unfinished drawing (draft), the selection, and the steps that can be undone.

const drawingModel = (size, least) => {
  const MOST_STEPS = 300;
  let state = { drawings: [], draft: null, next: 1 }, selected = null;
  const [past, future] = [[], []];
  const copy = () => JSON.stringify(state);
  const inside = ([x, y]) => [x, y].map((v, i) => Math.min(size[i] - 0.5, Math.max(-0.5, v)));

  // Saves the state before a change, so that the change can be undone. `before` is an earlier copy.
  const step = (before = copy()) => {
    past.push(before);
    if (past.length > MOST_STEPS) past.shift();
    future.length = 0;
  };
  const move = (from, to) => {
    if (!from.length) return;
    to.push(copy());
    state = JSON.parse(from.pop());
    selected = null;
  };
  const byId = (id) => state.drawings.find((drawing) => drawing.id === id);
  const freeName = (kind) => {
    const taken = new Set(state.drawings.map(({ name }) => name));
    let i = 1;
    while (taken.has(`${kind} ${i}`)) i++;
    return `${kind} ${i}`;
  };
  const push = (drawing) => {
    const made = { ...drawing, id: state.next++, name: drawing.name ?? freeName(drawing.kind), points: drawing.points.map(inside) };
    state.drawings.push(made);
    return made;
  };

  return {
    get drawings() { return state.drawings; },
    get draft() { return state.draft; },
    get selected() { return selected && byId(selected.id) ? selected : null; },
    get chosen() { return selected ? byId(selected.id) ?? null : null; },
    get canUndo() { return past.length > 0; },
    get canRedo() { return future.length > 0; },
    byId, copy, step, inside,
    undo: () => move(past, future),
    redo: () => move(future, past),
    select: (id, point = null) => { selected = id === null ? null : { id, point }; },
    // Adds a point to the draft, or starts a draft.
    extend: (point) => {
      step();
      state.draft = [...(state.draft ?? []), inside(point)];
    },
    cancel: () => { step(); state.draft = null; },
    // Turns the draft into a drawing. Returns it, or null if it has too few points.
    finish: (kind, fields) => {
      if (!state.draft || state.draft.length < least[kind]) return null;
      step();
      const made = push({ kind, points: state.draft, ...fields });
      state.draft = null;
      selected = { id: made.id, point: null };
      return made;
    },
    // Adds drawings of a file.
    load: (drawings) => {
      step();
      state.draft = null;
      return drawings.map(push);
    },
    put: (id, index, point) => { (id === null ? state.draft : byId(id).points)[index] = inside(point); },
    insert: (id, index, point) => {
      byId(id).points.splice(index, 0, inside(point));
      selected = { id, point: index };
    },
    reverse: (id) => { step(); byId(id).points.reverse(); selected = { id, point: null }; },
    // Removes the draft's last point, the selected point, or the selected drawing.
    remove: () => {
      const drawing = state.draft ? null : byId(selected?.id);
      if (!state.draft && !drawing) return;
      step();
      if (state.draft) {
        state.draft = state.draft.length > 1 ? state.draft.slice(0, -1) : null;
      } else if (selected.point !== null && drawing.points.length > least[drawing.kind]) {
        drawing.points.splice(selected.point, 1);
        selected = { id: drawing.id, point: null };
      } else {
        state.drawings = state.drawings.filter((other) => other !== drawing);
        selected = null;
      }
    },
  };
};
