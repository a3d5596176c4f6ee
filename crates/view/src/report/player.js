// The player: time, selection, panes, time line and details. It needs no framework and loads nothing.

(() => {
  const data = JSON.parse(document.getElementById("player-data").textContent);
  const draw = playerDraw(data);
  const STATIONARY = 0.3; // m/s: a vehicle whose top speed is below this is stationary
  const $ = (id) => document.getElementById(id);
  const element = (name, properties = {}, ...children) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  };
  const times = [...data.tracks.flatMap(({ t }) => [t[0], t[t.length - 1]]), ...data.frames.map(([t]) => t)];
  const [first, last] = [Math.min(...times), Math.max(...times)];
  const [left, right, bottom, top] = data.view;
  const whole = () => ({ x: (left + right) / 2, y: (bottom + top) / 2, zoom: 1 });
  const state = { time: first, selected: null, by: "track", playing: false, view: whole(), boxes: [], feet: [], scale: 1 };

  const clock = (time) => {
    const tenths = Math.round(10 * time), minutes = Math.floor(tenths / 600), hours = Math.floor(minutes / 60);
    const seconds = (tenths / 10 - 60 * minutes).toFixed(1).padStart(4, "0");
    return hours ? `${hours}:${String(minutes % 60).padStart(2, "0")}:${seconds}` : `${minutes}:${seconds}`;
  };

  // A frame is decoded when it is needed, and the next frame in advance.
  const images = new Map();
  const imageOf = (index) => {
    if (index < 0 || index >= data.frames.length) return null;
    if (!images.has(index)) {
      const image = new Image();
      image.onload = () => index === frameAt(state.time) && render();
      image.src = `data:image/jpeg;base64,${data.frames[index][1]}`;
      images.set(index, image);
    }
    return images.get(index);
  };
  const frameAt = (time) => {
    let low = 0, high = data.frames.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (data.frames[middle][0] <= time + 1e-3) low = middle; else high = middle;
    }
    return data.frames.length ? low : -1;
  };

  const [pane, map] = [$("player-picture").firstElementChild, $("player-above").firstElementChild];
  // Panes side by side have the height of the picture.
  const heightBeside = () => {
    const [picture, above] = [$("player-picture"), $("player-above")];
    return picture && picture.offsetLeft !== above.offsetLeft ? pane.clientHeight : null;
  };

  let drawn = false;
  const render = () => {
    if (drawn) return;
    drawn = true;
    requestAnimationFrame(() => { drawn = false; show(); });
  };
  const show = () => {
    if (data.frames.length) {
      const index = frameAt(state.time), time = data.frames[index][0];
      state.boxes = draw.picture(pane, imageOf(index), time, state);
      imageOf(index + 1);
      $("player-picture").querySelector("figcaption").textContent = `picture of ${clock(time)}`;
    }
    Object.assign(state, draw.above(map, state.time, { ...state, height: heightBeside() }));
    $("player-time").value = state.time;
    $("player-clock").textContent = clock(state.time);
    $("player-play").textContent = state.playing ? "❚❚" : "▶";
    $("player-play").setAttribute("aria-label", state.playing ? "pause" : "play");
    for (const button of $("player-list").children) {
      const id = Number(button.dataset.track), track = data.tracks.find((track) => track.id === id);
      button.setAttribute("aria-selected", id === state.selected);
      button.classList.toggle("away", !draw.at(track, state.time));
    }
    lanes();
    detail();
  };
  const keep = () => {
    const chosen = state.selected ? `&track=${state.selected}` : "";
    history.replaceState(null, "", `#t=${state.time.toFixed(2)}${chosen}`);
  };
  const seek = (time) => { state.time = Math.min(last, Math.max(first, time)); render(); };
  const select = (id) => {
    state.selected = id;
    const track = data.tracks.find((track) => track.id === id);
    if (track && !draw.at(track, state.time)) seek(track.t[0]);
    render();
    keep();
  };
  const play = (on) => {
    if (on && state.time >= last) state.time = first;
    state.playing = on;
    if (!on) keep();
    render();
    let before = null;
    const tick = (now) => {
      if (!state.playing) return;
      if (before !== null) seek(state.time + ((now - before) / 1000) * Number($("player-rate").value));
      before = now;
      if (state.time >= last) play(false); else requestAnimationFrame(tick);
    };
    if (on) requestAnimationFrame(tick);
  };
  const step = (by) => {
    play(false);
    const index = frameAt(state.time);
    if (index < 0) return seek(state.time + by / 3);
    seek(data.frames[Math.min(data.frames.length - 1, Math.max(0, index + by))][0]);
  };
  const neighbour = (by) => {
    const index = data.tracks.findIndex((track) => track.id === state.selected);
    const next = index < 0 ? (by > 0 ? 0 : data.tracks.length - 1) : (index + by + data.tracks.length) % data.tracks.length;
    if (data.tracks.length) select(data.tracks[next].id);
  };

  // The time line: a bar per vehicle, in as few lanes as possible.
  const laneOf = (() => {
    const ends = [];
    return data.tracks.map(({ t }) => {
      let lane = ends.findIndex((end) => end < t[0] - 0.3);
      if (lane < 0) lane = ends.length;
      ends[lane] = t[t.length - 1];
      return lane;
    });
  })();
  const count = Math.max(1, ...laneOf.map((lane) => lane + 1));
  const thick = Math.max(2, Math.min(9, 110 / count));
  const lanes = () => {
    const canvas = $("player-lanes"), fine = window.devicePixelRatio || 1, width = canvas.clientWidth, height = count * thick + 8;
    canvas.style.height = `${height}px`;
    canvas.width = width * fine;
    canvas.height = height * fine;
    const g = canvas.getContext("2d");
    g.scale(fine, fine);
    // Aligned with the handle of the time slider.
    const at = (time) => 8 + ((width - 16) * (time - first)) / Math.max(1e-6, last - first);
    data.tracks.forEach((track, i) => {
      const y = 4 + laneOf[i] * thick;
      g.globalAlpha = state.selected && track.id !== state.selected ? 0.35 : 1;
      // Drawn in pieces, as the colour may change over time.
      const [from, to] = [track.t[0], track.t[track.t.length - 1]];
      const pieces = ["speed", "activity"].includes(state.by) ? Math.max(1, Math.ceil((at(to) - at(from)) / 3)) : 1;
      for (let piece = 0; piece < pieces; piece++) {
        const [a, b] = [piece, piece + 1].map((k) => from + ((to - from) * k) / pieces);
        g.fillStyle = draw.colour(track, draw.at(track, (a + b) / 2) ?? draw.at(track, from), state.by);
        g.fillRect(at(a), y, Math.max(2, at(b) - at(a) + 0.6), Math.max(1, thick - 1.5));
      }
    });
    g.globalAlpha = 1;
    g.fillStyle = getComputedStyle(document.body).color;
    for (const { from } of data.segments.slice(1)) g.fillRect(at(from), 0, 1, height);
    g.fillRect(at(state.time) - 1, 0, 2, height);
  };

  // Details of the selected vehicle. Values of the whole track are written once, and those of the current time on each change.
  let detailed = null;
  const detail = () => {
    const box = $("player-detail"), track = data.tracks.find((track) => track.id === state.selected);
    box.hidden = !track;
    if (!track) { detailed = null; return; }
    if (detailed !== track) {
      detailed = track;
      const [from, to] = [track.t[0], track.t[track.t.length - 1]];
      const entry = (name, value, id) => element("div", {}, element("dt", { textContent: name }), element("dd", { textContent: value, id: id ?? "" }));
      const hidden = track.hidden.reduce((sum, [a, b]) => sum + b - a, 0);
      const dot = element("span", { className: "dot" });
      dot.style.background = track.colour;
      box.replaceChildren(
        element("h3", {}, dot, `${track.class} ${track.id}`),
        element("dl", {},
          entry("visible", `${clock(from)} – ${clock(to)}`),
          entry("length × width × height", `${track.dims.map((d) => d.toFixed(2)).join(" × ")} m`),
          entry("path", `${track.path.toFixed(1)} m`),
          entry("top speed", `${track.top.toFixed(1)} m/s`),
          entry("hidden", hidden ? `${hidden.toFixed(1)} s` : "never"),
          entry("position now", "", "player-at"), entry("heading now", "", "player-heading"),
          entry("speed now", "", "player-speed"), entry("activity now", "", "player-activity")),
        chart(track));
      if (track.crops.length) {
        box.append(element("div", { className: "views" }, ...track.crops.map(([time, jpeg]) => {
          const image = element("img", { src: `data:image/jpeg;base64,${jpeg}`, alt: `at ${clock(time)}` });
          const view = element("figure", { title: `go to ${clock(time)}` }, image, element("figcaption", { textContent: clock(time) }));
          view.onclick = () => seek(time);
          return view;
        })));
      }
    }
    const now = draw.at(track, state.time);
    const degrees = (radians) => (radians * 180) / Math.PI;
    $("player-at").textContent = now ? `${now.x.toFixed(1)} ± ${now.xSd.toFixed(1)}, ${now.y.toFixed(1)} ± ${now.ySd.toFixed(1)} m` : "not visible";
    $("player-heading").textContent = now ? `${(((degrees(now.heading) % 360) + 360) % 360).toFixed(0)} ± ${degrees(now.headingSd).toFixed(0)}°` : "–";
    $("player-speed").textContent = now ? `${now.speed.toFixed(1)} ± ${now.speedSd.toFixed(1)} m/s` : "–";
    $("player-activity").textContent = now ? (now.hidden ? "hidden, filled in" : (now.activity ?? "–").replaceAll("_", " ")) : "–";
    const svg = box.querySelector("svg");
    svg?.querySelector(".cursor").setAttribute("transform", `translate(${svg.at(state.time)} 0)`);
  };

  // Speed over time, with a band of one standard deviation.
  const chart = (track) => {
    if (track.top < STATIONARY) return element("p", { className: "hint", textContent: "It is stationary all the time." });
    const [width, height] = [1000, 112], [from, to] = [track.t[0], track.t[track.t.length - 1]];
    const least = Math.min(0, ...track.speed), most = Math.max(least + 1, ...track.speed);
    const x = (time) => 4 + ((width - 8) * (time - from)) / Math.max(1e-6, to - from);
    const y = (speed) => height - 8 - ((height - 24) * (speed - least)) / (most - least);
    const points = (sds) => track.t.map((time, i) => `${x(time).toFixed(1)},${y(track.speed[i] + sds * track.speed_sd[i]).toFixed(1)}`);
    const box = element("div");
    box.innerHTML = `<svg viewBox="0 0 ${width} ${height}" preserveAspectRatio="none" role="img" aria-label="speed over time">
      <g vector-effect="non-scaling-stroke" stroke="${track.colour}">
      <polygon points="${[...points(1), ...points(-1).reverse()].join(" ")}" fill="${track.colour}" stroke="none" opacity=".25"/>
      <path d="M0 ${y(0)}H${width}" stroke="var(--soft)" stroke-dasharray="3 5" vector-effect="non-scaling-stroke"/>
      <polyline points="${points(0).join(" ")}" fill="none" stroke-width="2" vector-effect="non-scaling-stroke"/></g>
      <path class="cursor" d="M0 0V${height}" stroke="currentColor" vector-effect="non-scaling-stroke"/></svg>`;
    const svg = box.firstElementChild;
    svg.at = (time) => x(Math.min(to, Math.max(from, time)));
    const go = (event) => {
      const { left, width } = svg.getBoundingClientRect();
      seek(from + ((event.clientX - left) / width) * (to - from));
    };
    svg.onpointerdown = (event) => { svg.setPointerCapture(event.pointerId); go(event); };
    svg.onpointermove = (event) => event.buttons && go(event);
    box.append(element("p", { className: "hint", textContent: `speed from ${least.toFixed(1)} to ${most.toFixed(1)} m/s; the band is one standard deviation` }));
    return box;
  };

  // Input of the user.
  const inside = (event, canvas) => {
    const { left, top } = canvas.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  };
  pane.addEventListener("click", (event) => {
    const [x, y] = inside(event, pane), area = (b) => (b.x1 - b.x0) * (b.y1 - b.y0);
    const hit = state.boxes.filter((b) => x >= b.x0 - 3 && x <= b.x1 + 3 && y >= b.y0 - 3 && y <= b.y1 + 3);
    select(hit.sort((a, b) => area(a) - area(b))[0]?.id ?? null);
  });
  let grip = null;
  map.addEventListener("pointerdown", (event) => { grip = { at: inside(event, map), view: { ...state.view }, moved: false }; map.setPointerCapture(event.pointerId); });
  map.addEventListener("pointermove", (event) => {
    if (!grip) return;
    const [x, y] = inside(event, map), [dx, dy] = [x - grip.at[0], y - grip.at[1]];
    if (Math.hypot(dx, dy) > 5) grip.moved = true;
    if (grip.moved) { Object.assign(state.view, { x: grip.view.x - dx / state.scale, y: grip.view.y + dy / state.scale }); render(); }
  });
  map.addEventListener("pointerup", (event) => {
    const [x, y] = inside(event, map), near = (f) => Math.hypot(f.px - x, f.py - y);
    if (grip && !grip.moved) {
      const nearest = [...state.feet].sort((a, b) => near(a) - near(b))[0];
      select(nearest && near(nearest) < 24 ? nearest.id : null);
    }
    grip = null;
  });
  for (const button of document.querySelectorAll("#player .zoom button")) {
    button.onclick = () => {
      const factor = Number(button.dataset.zoom);
      if (factor) state.view.zoom *= factor; else state.view = whole();
      render();
    };
  }
  $("player-lanes").addEventListener("click", (event) => {
    const [x, y] = inside(event, $("player-lanes")), width = $("player-lanes").clientWidth;
    const time = first + ((x - 8) / (width - 16)) * (last - first), lane = Math.floor((y - 4) / thick);
    const slack = (3 / width) * (last - first);
    const hit = data.tracks.find(({ t }, i) => laneOf[i] === lane && time >= t[0] - slack && time <= t[t.length - 1] + slack);
    seek(time);
    if (hit) select(hit.id);
  });
  $("player-play").onclick = () => play(!state.playing);
  $("player-time").oninput = (event) => { seek(Number(event.target.value)); };
  $("player-time").onchange = keep;
  const legend = () => $("player-legend").replaceChildren(...draw.legend(state.by).map(([words, colour]) => {
    const dot = element("span", { className: "dot" });
    dot.style.background = colour;
    return element("span", {}, dot, words);
  }));
  $("player-colour").onchange = (event) => { state.by = event.target.value; legend(); render(); };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT" || event.target.closest?.("#draw")) return;
    const actions = {
      " ": () => play(!state.playing), Escape: () => select(null), n: () => neighbour(1), p: () => neighbour(-1),
      ArrowLeft: () => (event.shiftKey ? seek(state.time - 5) : step(-1)),
      ArrowRight: () => (event.shiftKey ? seek(state.time + 5) : step(1)),
    };
    // The space bar already presses a button that has the focus.
    if (!actions[event.key] || (event.key === " " && event.target.tagName === "BUTTON")) return;
    event.preventDefault();
    actions[event.key]();
  });
  new ResizeObserver(render).observe($("player-list").parentElement);

  $("player-list").append(...data.tracks.map((track) => {
    const dot = element("span", { className: "dot" });
    dot.style.background = track.colour;
    const button = element("button", { type: "button", role: "option", onclick: () => select(track.id === state.selected ? null : track.id) }, dot, track.class === "car" ? String(track.id) : `${track.id} ${track.class}`);
    button.dataset.track = track.id;
    return button;
  }));
  Object.assign($("player-time"), { min: first, max: last });
  if (!data.frames.length) {
    $("player-picture").remove();
    document.querySelector("#player .panes").classList.add("one");
  }
  const asked = new URLSearchParams(location.hash.slice(1));
  state.time = Math.min(last, Math.max(first, Number(asked.get("t") ?? first)));
  state.selected = data.tracks.some(({ id }) => id === Number(asked.get("track"))) ? Number(asked.get("track")) : null;
  $("player").hidden = false;
  legend();
  render();
})();
