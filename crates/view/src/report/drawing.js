"use strict";
// The drawing part: input of the user, and files. It needs no framework and loads nothing.

(() => {
  const data = JSON.parse(document.getElementById("draw-data").textContent);
  const box = document.getElementById("draw"), $ = (selector) => box.querySelector(selector);
  const MODES = {
    gates: {
      kinds: ["gate", "zone"], file: "gates.geojson", type: "application/geo+json", option: "roadplane traffic … --gates",
      hint: "Click two or more points of a line and then Enter or “Finish gate”: a gate. Click three or more points and then the first one again: a zone. The arrow shows the direction that is called forward; the other one is called backward.",
    },
    lengths: {
      kinds: ["length"], file: "lengths.csv", type: "text/csv", option: "roadplane run … --known",
      hint: "Click the two ends of a length on the ground, and enter its metres. Without an sd, the file gets 2 % of the length. Zoom in to set the ends exactly.",
    },
    points: {
      kinds: ["point"], file: "points.csv", type: "text/csv", option: "roadplane run … --geo",
      hint: "Click a surveyed point, and enter its latitude and longitude (WGS 84) and its height above the ground. You can paste “latitude, longitude” into the first field. Three or more points are needed.",
    },
  };
  const KEYS = "Move a point by dragging it, or with the arrow keys. Delete removes it, and Escape cancels. Without a mouse: arrow keys move a cross, and the space bar sets a point.";
  const files = drawingFiles(data.size), model = drawingModel(data.size, files.LEAST);
  const svg = $("#draw-picture svg"), picture = drawingPicture(svg, data.size);
  let mode = "gates", still = data.stills[0], cursor = null, cross = null, grip = null, said = "", typing = null, before = null, saved = model.copy();

  // Drawings on frames with equal pixels belong together. If the camera moves, each frame has its own.
  const viewOf = (frame) => {
    const own = data.stills.find((other) => other.frame === frame);
    return data.moving ? `frame ${frame}` : `segment ${own?.segment ?? 0}`;
  };
  const ofMode = () => model.drawings.filter(({ kind }) => MODES[mode].kinds.includes(kind));
  const shown = () => ofMode().filter(({ frame }) => viewOf(frame) === viewOf(still.frame));
  // Lengths and surveyed points hold for the camera's first segment only.
  const usable = () => (mode === "gates" ? data.stills : data.stills.filter(({ segment }) => !segment));
  const counted = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
  const clock = (time) => `${Math.floor(time / 60)}:${(time % 60).toFixed(1).padStart(4, "0")}`;

  const render = () => {
    const drawings = shown(), faults = model.draft ? [] : files.faults(mode === "gates" ? drawings : ofMode());
    picture.picture(still.picture);
    picture.show({ drawings, draft: model.draft, selected: model.selected, cursor, cross, colour: MODES[mode].kinds[0] });
    list.show(drawings, model.selected, new Set(faults.map(([drawing]) => drawing?.id)));
    for (const button of box.querySelectorAll("[data-mode]")) button.setAttribute("aria-pressed", button.dataset.mode === mode);
    const count = model.draft?.length ?? 0, can = {
      gate: mode === "gates" && count >= 2, zone: mode === "gates" && count >= 3, undo: model.canUndo, redo: model.canRedo,
      remove: count > 0 || model.chosen !== null, save: drawings.length > 0 && !faults.length && !count, open: true,
    };
    for (const button of box.querySelectorAll("[data-do]")) button.disabled = !can[button.dataset.do];
    for (const name of ["gate", "zone"]) $(`[data-do=${name}]`).hidden = mode !== "gates";
    const own = model.chosen, isPoint = model.draft || (own && model.selected.point !== null && own.points.length > files.LEAST[own.kind]);
    const chosen = isPoint ? "point" : own?.kind;
    $("[data-do=remove]").textContent = chosen ? `Delete ${chosen}` : "Delete";
    $("[data-do=save]").textContent = `Save ${MODES[mode].file}`;
    $("#draw-hint").firstElementChild.textContent = MODES[mode].hint;
    $("#draw-hint").lastElementChild.textContent = KEYS;
    $("#draw-said").textContent = said || faults[0]?.[1] || "";
    $("#draw-said").classList.toggle("wrong", !said && faults.length > 0);
    $("#draw-picture figcaption").textContent = cursor || cross ? (cursor ?? cross).map((v) => v.toFixed(1)).join(", ") + " px" : `frame ${still.frame}`;
  };
  const say = (words) => { said = words; render(); };
  const list = drawingList($("#draw-list"), picture.COLOURS, {
    focus: (id) => { before = model.copy(); if (model.selected?.id !== id) { model.select(id); render(); } },
    input: (id, key, value) => {
      const drawing = model.byId(id), pair = /^\s*([-−\d.]+)[,;\s]+([-−\d.]+)\s*$/.exec(value.replaceAll("−", "-"));
      typing = key;
      said = "";
      if (key === "latitude" && pair && pair[1].includes(".") && pair[2].includes(".")) {
        Object.assign(drawing, { latitude: pair[1], longitude: pair[2] });
        typing = null;
      } else drawing[key] = value;
      render();
      typing = null;
    },
    change: () => { if (before && before !== model.copy()) { model.step(before); before = null; render(); } },
    typing: () => typing,
    select: (id) => { model.select(id); render(); },
    remove: (id) => { model.select(id); act.remove(); },
    reverse: (id) => { model.reverse(id); render(); },
  });

  // Precision of a click: half a pixel of the screen on each side, and at least a pixel of the frame.
  const precision = () => Math.max(1, Math.ceil(10 / picture.scale()) / 10);
  const finish = (kind, pointer) => {
    const fields = {
      gate: {}, zone: {}, length: { metres: "", sd: "", pixelSd: precision() }, point: { latitude: "", longitude: "", height: "" },
    }[kind];
    const made = model.finish(kind, { ...fields, frame: still.frame });
    cursor = null;
    render();
    // On a phone, the keyboard of the screen would cover the frame.
    const first = { length: "metres", point: "latitude" }[kind];
    if (made && first && pointer === "mouse") list.enter(made.id, first);
  };
  const tap = (pixel, pointer) => {
    said = "";
    if (model.draft && mode === "gates") {
      const end = picture.onDraft(pixel, model.draft, pointer);
      if (end === 0 && model.draft.length >= 3) return finish("zone", pointer);
      if (end === model.draft.length - 1 && model.draft.length >= 2) return finish("gate", pointer);
      if (end !== null) return render();
    }
    const line = model.draft ? null : picture.hit(pixel, shown(), model.selected, pointer);
    if (line) { model.select(line.id, line.point ?? null); return render(); }
    model.select(null);
    model.extend(pixel);
    if (mode === "points") return finish("point", pointer);
    if (mode === "lengths" && model.draft.length === 2) return finish("length", pointer);
    render();
  };

  const act = {
    gate: () => finish("gate", "mouse"),
    zone: () => finish("zone", "mouse"),
    undo: () => { model.undo(); say(""); },
    redo: () => { model.redo(); say(""); },
    remove: () => { model.remove(); say(""); },
    save: () => {
      const drawings = mode === "gates" ? shown() : ofMode(), { file, type, option } = MODES[mode];
      const text = { gates: () => files.geojson(drawings, still), lengths: () => files.lengths(drawings, data.moving), points: () => files.survey(drawings, data.moving) }[mode]();
      const link = Object.assign(document.createElement("a"), { download: file, href: URL.createObjectURL(new Blob([text], { type })) });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
      saved = model.copy();
      const others = ofMode().length - drawings.length;
      say(`Saved ${file}. Use it with: ${option} ${file}${others ? `. ${counted(others, "drawing")} of other frames left out.` : ""}`);
    },
    open: () => $("input[type=file]").click(),
  };
  const open = async (file) => {
    try {
      const text = await file.text();
      if (/\.csv$/i.test(file.name)) {
        const drawings = files.tableOf(text), first = data.stills[0].frame;
        if (!drawings.length) throw new Error("The table has no rows.");
        choose(drawings[0].kind === "length" ? "lengths" : "points");
        model.load(drawings.map((drawing) => ({ ...drawing, frame: drawing.frame ?? first })));
        return say(`${file.name}: ${counted(drawings.length, "row")}.`);
      }
      const { drawings, frame } = files.gatesOf(text);
      choose("gates");
      const own = data.stills.find((other) => other.frame === frame);
      if (own) still = own;
      $("#draw-frame select").value = still.frame;
      model.load(drawings.map((drawing) => ({ ...drawing, frame: still.frame })));
      say(`${file.name}: ${counted(drawings.length, "drawing")}.${own || (!data.moving && usable().length === data.stills.length && data.stills.every(({ segment }) => segment === still.segment)) ? "" : ` Frame ${frame} of the file is not in this report: check the drawings.`}`);
    } catch (error) {
      say(`${file.name} was not opened. ${error.message}`);
    }
  };

  // Input with a mouse or a finger.
  const release = () => { grip = null; svg.classList.remove("moving"); };
  svg.addEventListener("pointerdown", (event) => {
    if (event.button > 0 || !event.isPrimary) return;
    const pixel = picture.pixelAt(event);
    const hit = model.draft ? null : picture.hit(pixel, shown(), model.selected, event.pointerType);
    const held = hit && (hit.point !== undefined || hit.insert !== undefined) ? hit : null;
    grip = { at: [event.clientX, event.clientY], view: picture.view, held, moved: false, before: model.copy() };
    cross = null;
    svg.focus({ preventScroll: true });
    if (held || picture.view.zoom > 1) svg.setPointerCapture(event.pointerId);
    if (held) svg.style.touchAction = "none";
  });
  svg.addEventListener("pointermove", (event) => {
    const pixel = model.inside(picture.pixelAt(event));
    if (!grip) {
      cursor = event.pointerType === "mouse" ? pixel : null;
      const hit = model.draft ? null : picture.hit(pixel, shown(), model.selected, event.pointerType);
      svg.style.cursor = hit ? (hit.point === undefined && hit.insert === undefined ? "pointer" : "move") : "crosshair";
      return render();
    }
    const [dx, dy] = [event.clientX - grip.at[0], event.clientY - grip.at[1]];
    if (!grip.moved && Math.hypot(dx, dy) < (event.pointerType === "mouse" ? 3 : 8)) return;
    const { held } = grip;
    if (held) {
      if (!grip.moved && held.insert !== undefined) {
        model.insert(held.id, held.insert, pixel);
        held.point = held.insert;
      }
      model.put(held.id, held.point, pixel);
      model.select(held.id, held.point);
      cursor = pixel;
    } else if (grip.view.zoom > 1) {
      picture.pan(grip.view, dx, dy);
    }
    grip.moved = true;
    render();
  });
  svg.addEventListener("pointerup", (event) => {
    if (!grip) return;
    const { held, moved, before } = grip;
    release();
    if (!moved) return held?.point !== undefined ? (model.select(held.id, held.point), say("")) : tap(picture.pixelAt(event), event.pointerType);
    if (held) model.step(before);
    render();
  });
  svg.addEventListener("pointercancel", () => { release(); render(); });
  svg.addEventListener("pointerleave", () => { if (!grip) { cursor = null; render(); } });
  // A finger that touches a handle moves it, and does not scroll the page.
  svg.addEventListener("touchstart", (event) => {
    const touch = event.touches[0];
    if (!model.draft && event.touches.length === 1 && picture.hit(picture.pixelAt(touch), shown(), model.selected, "touch")?.point !== undefined) event.preventDefault();
  }, { passive: false });

  // Input with the keyboard.
  box.addEventListener("keydown", (event) => {
    const isField = ["INPUT", "SELECT"].includes(event.target.tagName), isButton = ["BUTTON", "SUMMARY"].includes(event.target.tagName);
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
    let action = null;
    if (event.ctrlKey || event.metaKey) {
      if (!isField) action = { z: event.shiftKey ? act.redo : act.undo, y: act.redo }[key];
    } else if (key === "Escape") {
      action = () => {
        if (isField) svg.focus({ preventScroll: true });
        else if (grip?.moved && grip.held) { const { before } = grip; release(); model.step(before); model.undo(); }
        else if (model.draft) model.cancel();
        else if (model.selected) model.select(null);
        else cross = null;
        say("");
      };
    } else if (!isField && (key === "Delete" || key === "Backspace")) action = act.remove;
    else if (event.target === svg && arrow) {
      const by = event.shiftKey ? 10 : 1, chosen = model.selected;
      action = chosen && chosen.point !== null && !model.draft
        ? () => { model.step(); const [x, y] = model.chosen.points[chosen.point]; model.put(chosen.id, chosen.point, [x + by * arrow[0], y + by * arrow[1]]); render(); }
        : () => { const [x, y] = cross ?? picture.centre(), far = (event.shiftKey ? 1 : 12) / picture.scale(); cursor = null; cross = model.inside([x + far * arrow[0], y + far * arrow[1]]); render(); };
    } else if (event.target === svg && key === " ") action = () => { cross ??= picture.centre(); tap(cross, "keyboard"); };
    else if (!isField && !isButton && key === "Enter") action = () => (model.draft && mode === "gates" ? finish("gate", "keyboard") : null);
    if (!action) return;
    event.preventDefault();
    action();
  });

  const choose = (name) => {
    if (model.draft) model.cancel();
    model.select(null);
    mode = name;
    if (!usable().includes(still)) [still] = usable();
    const select = $("#draw-frame select");
    select.replaceChildren(...usable().map(({ frame, time }) => new Option(`${frame} at ${clock(time)}`, frame, false, frame === still.frame)));
    $("#draw-frame").hidden = usable().length < 2;
    say("");
  };
  $("#draw-frame select").onchange = (event) => {
    if (model.draft && viewOf(Number(event.target.value)) !== viewOf(still.frame)) model.cancel();
    still = data.stills.find(({ frame }) => frame === Number(event.target.value));
    render();
  };
  for (const button of box.querySelectorAll("[data-mode]")) button.onclick = () => choose(button.dataset.mode);
  for (const button of box.querySelectorAll("[data-do]")) button.onclick = () => act[button.dataset.do]();
  for (const button of box.querySelectorAll("[data-zoom]")) button.onclick = () => { picture.zoom(Number(button.dataset.zoom)); render(); };
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return; // the wheel alone scrolls the page
    event.preventDefault();
    picture.zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, picture.pixelAt(event));
    render();
  }, { passive: false });
  $("input[type=file]").onchange = async (event) => {
    const [file] = event.target.files;
    if (file) await open(file);
    event.target.value = "";
  };
  addEventListener("beforeunload", (event) => { if (model.drawings.length && model.copy() !== saved) event.preventDefault(); });
  box.addEventListener("toggle", render);
  new ResizeObserver(render).observe(svg);
  box.hidden = false;
  choose(mode);
})();
