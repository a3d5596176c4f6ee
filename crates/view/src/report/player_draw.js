"use strict";
// Draws the vehicles at a time, in the picture and from above. `player.js` selects the vehicles and the time.

const playerDraw = (data) => {
  const TRAIL_S = 10; // duration of a trail, s
  const CLASSES = { car: "#5aa9e6", truck: "#f2a65a", bus: "#b58be0", motorcycle: "#7bd88f" };
  const OTHER = "#8a929c";
  const activityColour = Object.fromEntries(data.activities.map(([name, , colour]) => [name, colour]));
  const fastest = Math.max(1, ...data.tracks.map((track) => track.top));

  // Returns the state of a track at a time, or null if the track does not exist then.
  const at = (track, time) => {
    const t = track.t;
    if (time < t[0] - 0.02 || time > t[t.length - 1] + 0.02) return null;
    let low = 0, high = t.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (t[middle] <= time) low = middle; else high = middle;
    }
    const span = t[high] - t[low];
    const s = span > 0 ? Math.min(1, Math.max(0, (time - t[low]) / span)) : 0;
    const mix = (list) => list[low] + s * (list[high] - list[low]);
    return {
      x: mix(track.x), y: mix(track.y), z: mix(track.z), heading: mix(track.heading), speed: mix(track.speed),
      xSd: mix(track.x_sd), ySd: mix(track.y_sd), headingSd: mix(track.heading_sd), speedSd: mix(track.speed_sd),
      bbox: track.bbox[low].map((edge, i) => edge + s * (track.bbox[high][i] - edge)),
      activity: track.activity[low], segment: track.segment[low],
      hidden: track.hidden.some(([from, to]) => time > from && time < to),
    };
  };

  // Slow vehicles are blue, and fast ones yellow.
  const speedColour = (speed) => {
    const s = Math.min(1, Math.abs(speed) / fastest);
    return `hsl(${230 - 180 * s} 75% ${52 + 10 * s}%)`;
  };
  const colour = (track, state, by) => {
    if (by === "class") return CLASSES[track.class] ?? OTHER;
    if (by === "speed") return speedColour(state.speed);
    if (by === "activity") return activityColour[state.activity] ?? OTHER;
    return track.colour;
  };
  const legend = (by) => {
    if (by === "class") return Object.entries(CLASSES);
    if (by === "activity") return [...data.activities.map(([, words, c]) => [words, c]), ["stationary, driving on", OTHER]];
    if (by === "speed") return [0, 0.5, 1].map((s) => [`${(s * fastest).toFixed(1)} m/s`, speedColour(s * fastest)]);
    return [];
  };

  // Returns a vehicle's outline on the ground, from its front left corner on.
  const outline = (track, { x, y, heading }) => {
    const [l, w] = [track.dims[0] / 2, track.dims[1] / 2], [sin, cos] = [Math.sin(heading), Math.cos(heading)];
    return [[l, w], [l, -w], [-l, -w], [-l, w]].map(([f, s]) => [x + f * cos - s * sin, y + f * sin + s * cos]);
  };
  const ellipse = ({ x, y, xSd, ySd }) => Array.from({ length: 33 }, (_, i) => {
    const angle = (i / 32) * 2 * Math.PI;
    return [x + 2 * xSd * Math.cos(angle), y + 2 * ySd * Math.sin(angle)];
  });
  const polyline = (g, points, closed) => {
    g.beginPath();
    let open = false;
    for (const point of points) {
      if (!point) { open = false; continue; }
      if (open) g.lineTo(point[0], point[1]); else g.moveTo(point[0], point[1]);
      open = true;
    }
    if (closed) g.closePath();
  };
  const tag = (g, text, x, y, fill) => {
    g.font = "600 11px system-ui, sans-serif";
    const width = g.measureText(text).width + 8;
    g.fillStyle = "rgba(20,23,27,.72)";
    g.fillRect(x, y - 15, width, 15);
    g.fillStyle = fill;
    g.fillText(text, x + 4, y - 4);
  };

  // Fits a canvas to its element, with the resolution of the screen.
  const fit = (canvas, heightOf) => {
    const width = canvas.parentElement.clientWidth, height = heightOf(width), fine = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * fine) || canvas.height !== Math.round(height * fine)) {
      canvas.width = Math.round(width * fine);
      canvas.height = Math.round(height * fine);
      canvas.style.height = `${height}px`;
    }
    const g = canvas.getContext("2d");
    g.setTransform(fine, 0, 0, fine, 0, 0);
    g.globalAlpha = 1;
    return { g, width, height };
  };

  // Draws the picture at the time of its frame. Returns the boxes in pixels of the canvas.
  const picture = (canvas, image, time, { selected, by }) => {
    const { g, width, height } = fit(canvas, (width) => (width * data.size[1]) / data.size[0]);
    const scale = width / data.size[0];
    g.fillStyle = "#1d2126";
    g.fillRect(0, 0, width, height);
    if (image?.complete && image.naturalWidth) g.drawImage(image, 0, 0, width, height);
    const motion = data.frames.find(([t]) => Math.abs(t - time) < 1e-3)?.[2];
    const moved = ([x, y]) => {
      if (!motion) return [x, y];
      const [a, b, c, d, e, f, h, k] = motion, w = h * x + k * y + 1;
      return [(a * x + b * y + c) / w, (d * x + e * y + f) / w];
    };
    const project = (segment) => ([x, y, z = 0]) => {
      const { p, lens: [cx, cy, distortion] } = data.segments[segment] ?? data.segments[0];
      const w = p[8] * x + p[9] * y + p[10] * z + p[11];
      if (w < 1) return null;
      const [u, v] = moved([0, 4].map((row) => (p[row] * x + p[row + 1] * y + p[row + 2] * z + p[row + 3]) / w));
      // Distortion about the principal point (division model).
      const square = (u - cx) ** 2 + (v - cy) ** 2;
      const scaled = 2 / (1 + Math.sqrt(Math.max(0, 1 - 4 * distortion * square)));
      return [cx + (u - cx) * scaled, cy + (v - cy) * scaled].map((v) => v * scale);
    };
    const boxes = [];
    const chosen = data.tracks.find((track) => track.id === selected);
    if (chosen) {
      const state = at(chosen, time), here = state?.segment ?? chosen.segment[0];
      g.lineWidth = 2;
      g.strokeStyle = state ? colour(chosen, state, by) : chosen.colour;
      g.globalAlpha = 0.8;
      polyline(g, chosen.x.map((x, i) => project(here)([x, chosen.y[i], chosen.z[i]])));
      g.stroke();
      g.globalAlpha = 1;
    }
    for (const track of data.tracks) {
      const state = at(track, time);
      if (!state) continue;
      const own = track.id === selected, ink = colour(track, state, by);
      const [x0, y0, x1, y1] = state.bbox.map((edge) => edge * scale);
      boxes.push({ id: track.id, x0, y0, x1, y1 });
      g.globalAlpha = selected && !own ? 0.55 : 1;
      g.strokeStyle = ink;
      g.lineWidth = own ? 2.5 : 1.5;
      g.setLineDash(state.hidden ? [4, 4] : []);
      g.strokeRect(x0, y0, x1 - x0, y1 - y0);
      g.setLineDash([]);
      if (own) {
        const up = track.dims[2], ground = outline(track, state), to = project(state.segment);
        g.lineWidth = 1.2;
        const { z } = state;
        for (const level of [z, z + up]) { polyline(g, ground.map(([x, y]) => to([x, y, level])), true); g.stroke(); }
        for (const [x, y] of ground) { polyline(g, [to([x, y, z]), to([x, y, z + up])]); g.stroke(); }
        g.strokeStyle = "#fff";
        polyline(g, ellipse(state).map(([x, y]) => to([x, y, z])), true);
        g.stroke();
      }
      if (own || x1 - x0 > 26) tag(g, String(track.id), x0, Math.max(15, y0), ink);
      g.globalAlpha = 1;
    }
    return boxes;
  };

  // Draws the view from above. `view` is { x, y, zoom }: the point in the middle, m, and the magnification. `height` may be null.
  const above = (canvas, time, { selected, by, view, height: asked }) => {
    const [left, right, bottom, top] = data.view;
    const ratio = Math.min(1, Math.max(0.56, (top - bottom) / (right - left)));
    const { g, width, height } = fit(canvas, (width) => asked ?? width * ratio);
    const scale = Math.min(width / (right - left), height / (top - bottom)) * view.zoom;
    const to = ([x, y]) => [width / 2 + (x - view.x) * scale, height / 2 - (y - view.y) * scale];
    const from = (px, py) => [view.x + (px - width / 2) / scale, view.y - (py - height / 2) / scale];
    g.fillStyle = "#1d2126";
    g.fillRect(0, 0, width, height);
    const step = [1, 2, 5, 10, 20, 50, 100].find((metres) => metres * scale >= 45) ?? 200;
    const [[x0, y1], [x1, y0]] = [from(0, 0), from(width, height)];
    g.lineWidth = 1;
    g.strokeStyle = "#343a42";
    g.fillStyle = "#7d8690";
    g.font = "11px system-ui, sans-serif";
    for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) {
      const [px] = to([x, 0]);
      polyline(g, [[px, 0], [px, height]]); g.stroke();
      g.fillText(`${x} m`, px + 3, height - 4);
    }
    for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) {
      const [, py] = to([0, y]);
      polyline(g, [[0, py], [width, py]]); g.stroke();
      g.fillText(`${y} m`, 3, py - 3);
    }
    const now = data.segments.find(({ from, to }) => time >= from && time <= to) ?? data.segments[0];
    const far = 2 * Math.max(top, right - left);
    g.strokeStyle = "#59626d";
    g.setLineDash([5, 5]);
    for (const side of [-1, 1]) { polyline(g, [to([0, 0]), to([side * now.half * far, far])]); g.stroke(); }
    g.setLineDash([]);
    g.fillStyle = "#e8ecf0";
    g.beginPath();
    g.arc(...to([0, 0]), 4, 0, 7);
    g.fill();
    const [feet, plates] = [[], []];
    for (const track of data.tracks) {
      const own = track.id === selected, state = at(track, time);
      const ink = state ? colour(track, state, by) : track.colour;
      g.strokeStyle = ink;
      g.globalAlpha = own ? 0.9 : selected ? 0.12 : 0.22;
      g.lineWidth = own ? 2 : 1.2;
      polyline(g, track.x.map((x, i) => to([x, track.y[i]])));
      g.stroke();
      if (!state) continue;
      const trail = [];
      for (let back = TRAIL_S; back >= 0; back -= 0.25) {
        const past = at(track, time - back);
        trail.push(past && to([past.x, past.y]));
      }
      g.globalAlpha = selected && !own ? 0.5 : 0.9;
      g.lineWidth = own ? 3 : 2;
      polyline(g, trail);
      g.stroke();
      const body = outline(track, state).map(to);
      g.fillStyle = ink;
      g.globalAlpha = (selected && !own ? 0.5 : 1) * (state.hidden ? 0.35 : 0.75);
      polyline(g, body, true);
      g.fill();
      g.globalAlpha = 1;
      const nose = to([state.x + 0.2 * track.dims[0] * Math.cos(state.heading), state.y + 0.2 * track.dims[0] * Math.sin(state.heading)]);
      g.fillStyle = "#1d2126";
      g.globalAlpha = 0.55;
      polyline(g, [body[0], body[1], nose], true);
      g.fill();
      g.globalAlpha = 1;
      if (own) {
        g.strokeStyle = "#fff";
        g.lineWidth = 1.2;
        polyline(g, ellipse(state).map(to), true);
        g.stroke();
      }
      const [px, py] = to([state.x, state.y]);
      feet.push({ id: track.id, px, py });
      // A number is drawn if there is room for it.
      const isFree = plates.every(([x, y]) => Math.abs(px - x) > 18 || Math.abs(py - y) > 12);
      if (!own && !isFree) continue;
      plates.push([px, py]);
      // On the vehicle if it is large enough, else beside it.
      const inside = track.dims[1] * scale > 13;
      g.textAlign = inside ? "center" : "left";
      g.font = own ? "600 13px system-ui, sans-serif" : "11px system-ui, sans-serif";
      g.lineWidth = 3;
      g.strokeStyle = "rgba(20,23,27,.6)";
      g.fillStyle = own ? "#fff" : "rgba(255,255,255,.85)";
      for (const put of ["strokeText", "fillText"]) g[put](String(track.id), inside ? px : px + 7, inside ? py + 4 : py - 7);
      g.textAlign = "left";
    }
    return { feet, scale };
  };

  return { at, colour, legend, picture, above, fastest };
};
