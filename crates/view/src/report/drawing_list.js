"use strict";
// The list of drawings beside the frame, with a field for each value that the user enters.

const drawingList = (box, colours, on) => {
  const FIELDS = {
    gate: [["name", "name"]],
    zone: [["name", "name"]],
    length: [["name", "name"], ["metres", "length, m"], ["sd", "sd, m"]],
    point: [["latitude", "latitude, °"], ["longitude", "longitude, °"], ["height", "height, m"]],
  };
  const EMPTY = { sd: "2 %", height: "0" };
  const WORDS = { gate: "gate", zone: "zone", length: "length", point: "point" };
  const element = (name, properties = {}, ...children) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  };
  const rows = new Map();

  const row = (drawing) => {
    const { id, kind } = drawing;
    const dot = element("span", { className: "dot" });
    dot.style.background = colours[kind];
    const fields = FIELDS[kind].map(([key, label]) => {
      const input = element("input", { type: "text", autocomplete: "off", placeholder: EMPTY[key] ?? "" });
      if (key !== "name") input.inputMode = "decimal";
      input.dataset.key = key;
      input.onfocus = () => on.focus(id);
      input.oninput = () => on.input(id, key, input.value);
      input.onchange = () => on.change();
      return element("label", { className: key }, element("span", { textContent: label }), input);
    });
    const buttons = [element("button", { type: "button", textContent: "×", title: `delete this ${WORDS[kind]}`, ariaLabel: `delete this ${WORDS[kind]}`, onclick: () => on.remove(id) })];
    if (kind === "gate") buttons.unshift(element("button", { type: "button", textContent: "⇄", title: "swap forward and backward", ariaLabel: "swap forward and backward", onclick: () => on.reverse(id) }));
    const title = element("button", { type: "button", className: "kind", onclick: () => on.select(id) }, dot, kind === "point" ? drawing.name : WORDS[kind]);
    const made = element("div", { className: `entry ${kind}` }, title, ...fields, ...buttons);
    made.dataset.id = id;
    return made;
  };

  // Shows these drawings. A field that has the focus keeps its text.
  const show = (drawings, selected, wrong) => {
    const ids = new Set(drawings.map(({ id }) => id));
    // The removal of a field with the focus ends the input there, and shows the list again.
    for (const [id, made] of [...rows]) if (!ids.has(id) && rows.delete(id)) made.remove();
    for (const drawing of drawings) {
      if (!rows.has(drawing.id)) {
        rows.set(drawing.id, row(drawing));
        box.append(rows.get(drawing.id));
      }
      const made = rows.get(drawing.id);
      made.classList.toggle("own", drawing.id === selected?.id);
      made.classList.toggle("wrong", wrong.has(drawing.id));
      for (const input of made.querySelectorAll("input")) {
        const value = drawing[input.dataset.key] ?? "";
        if (input.value !== value && (input !== document.activeElement || input.dataset.key !== on.typing())) input.value = value;
      }
    }
    box.hidden = !drawings.length;
  };
  const enter = (id, key) => rows.get(id)?.querySelector(`input[data-key=${key}]`)?.select();
  return { show, enter };
};
