"use strict";
// Shows a frame with its drawings as SVG, and converts between the screen and pixels of the frame.

const drawingPicture = (svg, size) => {
  const COLOURS = { gate: "#4cc9f0", zone: "#ffb454", length: "#a6e36b", point: "#ff8fc7" };
  const [WIDTH, HEIGHT] = size, MOST_ZOOM = 16;
  const NEAR = { mouse: 9, touch: 22 }; // distance at which a point is hit, px of the screen
  const middle = () => ({ x: (WIDTH - 1) / 2, y: (HEIGHT - 1) / 2, zoom: 1 });
  let view = middle();
  const make = (name, attributes, ...children) => {
    const made = document.createElementNS(svg.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };
  // The centre of the first pixel is (0, 0), so the picture begins half a pixel before it.
  const image = make("image", { x: -0.5, y: -0.5, width: WIDTH, height: HEIGHT, preserveAspectRatio: "none" });
  const layer = make("g", {});
  svg.append(image, layer);

  const clamp = () => {
    view.zoom = Math.min(MOST_ZOOM, Math.max(1, view.zoom));
    const half = [WIDTH, HEIGHT].map((side) => side / view.zoom / 2);
    view.x = Math.min(WIDTH - 0.5 - half[0], Math.max(half[0] - 0.5, view.x));
    view.y = Math.min(HEIGHT - 0.5 - half[1], Math.max(half[1] - 0.5, view.y));
    svg.setAttribute("viewBox", [view.x - half[0], view.y - half[1], 2 * half[0], 2 * half[1]].join(" "));
    // Without zoom, a finger scrolls the page. With zoom, it moves the picture.
    svg.style.touchAction = view.zoom > 1 ? "none" : "pan-x pan-y pinch-zoom";
  };
  // Pixels of the screen for one pixel of the frame.
  const scale = () => (svg.clientWidth || WIDTH) * view.zoom / WIDTH;
  const pixelAt = ({ clientX, clientY }) => {
    const { x, y } = new DOMPoint(clientX, clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [x, y];
  };
  const between = ([a, b], [c, d], s = 0.5) => [a + s * (c - a), b + s * (d - b)];
  const gaps = ({ kind, points }) => points.slice(kind === "zone" ? 0 : 1).map((_, i) => [points[i], points[(i + 1) % points.length]]);
  const distance = ([a, b], [c, d]) => Math.hypot(a - c, b - d);
  const fromLine = (point, [from, to]) => {
    const square = distance(from, to) ** 2;
    const s = square ? ((point[0] - from[0]) * (to[0] - from[0]) + (point[1] - from[1]) * (to[1] - from[1])) / square : 0;
    return distance(point, between(from, to, Math.min(1, Math.max(0, s))));
  };

  // Returns the nearest handle at a pixel, or the nearest line: { id, point }, { id, insert } or { id }.
  const hit = (pixel, drawings, selected, pointer) => {
    const reach = (NEAR[pointer] ?? NEAR.touch) / scale();
    let best = null;
    const offer = (found, far, most) => { if (far <= most && (!best || far < best.far)) best = { ...found, far }; };
    for (const drawing of drawings) drawing.points.forEach((point, i) => offer({ id: drawing.id, point: i }, distance(pixel, point), reach));
    if (best) return best;
    for (const drawing of drawings.filter(({ id, kind }) => id === selected?.id && (kind === "gate" || kind === "zone"))) {
      gaps(drawing).forEach(([from, to], i) => offer({ id: drawing.id, insert: i + 1 }, distance(pixel, between(from, to)), reach));
    }
    if (best) return best;
    for (const drawing of drawings) for (const gap of gaps(drawing)) offer({ id: drawing.id }, fromLine(pixel, gap), reach * 0.7);
    return best;
  };
  const onDraft = (pixel, draft, pointer) => {
    const reach = (NEAR[pointer] ?? NEAR.touch) / scale();
    const ends = [draft.length - 1, 0].filter((i) => distance(pixel, draft[i]) <= reach);
    return ends.length ? ends[0] : null;
  };

  const path = (points, closed) => `M${points.map((point) => point.join(" ")).join("L")}${closed ? "Z" : ""}`;
  const text = (words, [x, y], fill, unit, anchor = "start") => make("text", {
    x, y, fill, "font-size": 13 * unit, "font-weight": 600, "text-anchor": anchor, stroke: "rgba(15,18,22,.85)", "stroke-width": 3 * unit, "paint-order": "stroke", "stroke-linejoin": "round",
  }, words);
  // Arrow from the left side of a line to its right side: this direction is called forward.
  const arrow = ([from, to], unit, colour, named) => {
    const length = distance(from, to);
    if (length < 24 * unit) return [];
    const along = [(to[0] - from[0]) / length, (to[1] - from[1]) / length], right = [-along[1], along[0]];
    const at = (a, r) => { const [x, y] = between(from, to); return [x + unit * (a * along[0] + r * right[0]), y + unit * (a * along[1] + r * right[1])]; };
    const shape = path([at(0, -12), at(0, 22)], false), head = path([at(-5, 13), at(0, 22), at(5, 13)], false);
    const stroke = (ink, width) => make("path", { d: shape + head, fill: "none", stroke: ink, "stroke-width": width * unit, "stroke-linecap": "round" });
    const anchor = right[0] > 0.4 ? "start" : right[0] < -0.4 ? "end" : "middle";
    const [x, y] = at(0, right[1] < -0.4 ? 27 : 29);
    const label = named ? [text("forward", [x, y + (right[1] > 0.4 ? 9 : right[1] < -0.4 ? 0 : 4) * unit], colour, unit, anchor)] : [];
    return [stroke("rgba(15,18,22,.7)", 5), stroke(colour, 2), ...label];
  };
  const handle = ([x, y], r, fill, stroke, unit, more = {}) => make("circle", { cx: x, cy: y, r: r * unit, fill, stroke, "stroke-width": 1.5 * unit, ...more });

  const drawn = (drawing, selected, unit) => {
    const { kind, points, name, id } = drawing, colour = COLOURS[kind], own = selected?.id === id;
    const parts = [];
    if (points.length > 1) {
      const d = path(points, kind === "zone"), fill = kind === "zone" ? `${colour}${own ? "44" : "26"}` : "none";
      parts.push(make("path", { d, fill: "none", stroke: "rgba(15,18,22,.7)", "stroke-width": (own ? 6 : 5) * unit, "stroke-linejoin": "round" }));
      parts.push(make("path", { d, fill, stroke: colour, "stroke-width": (own ? 3 : 2) * unit, "stroke-linejoin": "round" }));
    }
    if (kind === "gate") {
      const lines = gaps(drawing), longest = lines.reduce((a, b) => (distance(...b) > distance(...a) ? b : a));
      for (const line of lines) parts.push(...arrow(line, unit, colour, line === longest));
    }
    if (kind === "point") {
      const [[x, y]] = points;
      parts.push(make("path", { d: `M${x - 10 * unit} ${y}h${20 * unit}M${x} ${y - 10 * unit}v${20 * unit}`, stroke: colour, "stroke-width": 2 * unit }));
    }
    if (own && (kind === "gate" || kind === "zone")) {
      for (const [from, to] of gaps(drawing)) if (distance(from, to) > 30 * unit) parts.push(handle(between(from, to), 3.5, "rgba(15,18,22,.6)", colour, unit));
    }
    points.forEach((point, i) => {
      const chosen = own && selected.point === i;
      parts.push(handle(point, chosen ? 6.5 : 5, chosen ? colour : "#fff", chosen ? "#fff" : colour, unit));
    });
    const left = points[0][0] > view.x + WIDTH / view.zoom / 2 - 120 * unit;
    parts.push(text(name, [points[0][0] + (left ? -9 : 9) * unit, points[0][1] - 9 * unit], own ? "#fff" : colour, unit, left ? "end" : "start"));
    return make("g", { "data-id": id }, ...parts);
  };

  // Shows the drawings, the draft, and the cross of the keyboard.
  const show = ({ drawings, draft, selected, cursor, cross, colour }) => {
    const unit = 1 / scale(), parts = drawings.map((drawing) => drawn(drawing, selected, unit));
    if (draft) {
      const line = cursor ? [...draft, cursor] : draft;
      if (line.length > 1) {
        parts.push(make("path", { d: path(line), fill: "none", stroke: "rgba(15,18,22,.7)", "stroke-width": 5 * unit }));
        parts.push(make("path", { d: path(line), fill: "none", stroke: COLOURS[colour], "stroke-width": 2 * unit, "stroke-dasharray": `${6 * unit} ${4 * unit}` }));
      }
      draft.forEach((point) => parts.push(handle(point, 5, "#fff", COLOURS[colour], unit)));
    }
    if (cross) {
      const [x, y] = cross, d = `M${x - 14 * unit} ${y}h${28 * unit}M${x} ${y - 14 * unit}v${28 * unit}`;
      for (const [ink, width] of [["rgba(15,18,22,.8)", 4], ["#fff", 1.5]]) parts.push(make("path", { d, stroke: ink, "stroke-width": width * unit, class: "cross" }));
    }
    layer.replaceChildren(...parts);
  };

  clamp();
  return {
    COLOURS, scale, pixelAt, hit, onDraft, show,
    get view() { return { ...view }; },
    centre: () => [view.x, view.y],
    picture: (source) => image.setAttribute("href", source),
    zoom: (factor, [x, y] = [view.x, view.y]) => {
      const zoom = factor ? Math.min(MOST_ZOOM, Math.max(1, view.zoom * factor)) : 1, ratio = view.zoom / zoom;
      view = factor ? { x: x + (view.x - x) * ratio, y: y + (view.y - y) * ratio, zoom } : middle();
      clamp();
    },
    pan: (from, dx, dy) => {
      view = { ...from, x: from.x - dx / scale(), y: from.y - dy / scale() };
      clamp();
    },
  };
};
