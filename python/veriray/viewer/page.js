"use strict";
// The page of the viewer. The protocol is that of veriray/viewer/server.py; the view itself, and
// all arithmetic of cameras, is there.

const find = (id) => document.getElementById(id);
const stage = find("stage"), canvas = find("picture"), pen = canvas.getContext("2d");
let socket = null, state = null, facts = null, lostNotice = 0;

// ---- the socket ----

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(`${scheme}//${location.host}/ws${location.search}`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => banner("");
  socket.onmessage = (event) => {
    if (typeof event.data !== "string") return void picture(event.data);
    const content = JSON.parse(event.data);
    if (content.state) update(content.state);
    if (content.notice) banner(content.notice, 6000);
  };
  socket.onclose = (event) => {
    banner(event.reason || "no connection to veriray: trying again");
    setTimeout(connect, 1000);
  };
}

function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

const set = (name, value) => send({ do: "set", name, value });

async function picture(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, length));
  const content = JSON.parse(text);
  try {
    const blob = new Blob([new Uint8Array(buffer, 4 + length)], { type: content.type });
    const image = await createImageBitmap(blob);
    canvas.width = image.width;
    canvas.height = image.height;
    pen.drawImage(image, 0, 0);
    image.close();
    facts = content;
    layout();
    report();
  } finally {
    if (socket.readyState === WebSocket.OPEN) socket.send('{"do":"ack"}');
  }
}

// ---- what is shown ----

function banner(text, milliseconds = 0, kind = "") {
  clearTimeout(lostNotice);
  find("banner").textContent = text;
  find("banner").className = kind;
  find("banner").hidden = !text;
  if (text && milliseconds) lostNotice = setTimeout(() => banner(state ? state.message : ""), milliseconds);
}

function layout() {
  if (!facts) return;
  const shape = facts.coarse > 1 && state ? state : facts;
  const room = [stage.clientWidth - 24, stage.clientHeight - 24];
  const scale = Math.min(room[0] / shape.width, room[1] / shape.height);
  const size = [shape.width * scale, shape.height * scale];
  Object.assign(canvas.style, {
    width: `${size[0]}px`, height: `${size[1]}px`,
    left: `${(stage.clientWidth - size[0]) / 2}px`, top: `${(stage.clientHeight - size[1]) / 2}px`,
    imageRendering: facts.coarse === 1 && scale >= 3 ? "pixelated" : "auto",
  });
}

const digits = (x, n = 3) => (x === 0 ? "0" : Number(x.toPrecision(n)).toString());

function large(x) {
  const steps = [[1e9, " G"], [1e6, " M"], [1e3, " k"]];
  for (const [unit, name] of steps) if (x >= unit) return (x / unit).toFixed(x >= 100 * unit ? 0 : x >= 10 * unit ? 1 : 2) + name;
  return x.toFixed(0);
}

function duration(s) {
  if (s < 10) return `${s.toFixed(2)} s`;
  if (s < 100) return `${s.toFixed(1)} s`;
  return s < 3600 ? `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s` : `${(s / 3600).toFixed(2)} h`;
}

function report() {
  const goal = state ? state.spp : facts.spp, preview = facts.preview;
  find("spp").textContent = preview ? "preview" : facts.spp.toLocaleString("en");
  find("goal").textContent = preview ? "" : `of ${goal.toLocaleString("en")}`;
  find("bar").style.width = `${preview ? 0 : Math.min(100, (100 * facts.spp) / goal)}%`;
  find("bar").className = facts.done ? "done" : "";
  find("error").textContent = facts.error === null ? "–" : `${digits(100 * facts.error)} %`;
  find("rate").textContent = large(facts.rate);
  find("seconds").textContent = duration(facts.seconds);
  find("resolution").textContent = `${facts.width} × ${facts.height}`;
  find("device").textContent = `${facts.device} · ${facts.device_name} · ${facts.scheduler}`;
  find("badge").hidden = facts.coarse === 1;
  find("badge").textContent = `1/${facts.coarse} resolution`;
  find("sha").disabled = !facts.sha256;
  find("sha").textContent = facts.sha256 ? `SHA-256 ${facts.sha256}` : `SHA-256 after ${goal.toLocaleString("en")} samples`;
  find("legend").hidden = !facts.legend;
  find("light").classList.toggle("off", Boolean(facts.legend));
  if (facts.legend) {
    find("legend").querySelector("figcaption").textContent = facts.legend.title;
    find("legend").querySelectorAll(".marks span").forEach((mark, i) => { mark.textContent = facts.legend.marks[i]; });
  }
  plot(facts.live);
  document.documentElement.dataset.spp = facts.preview ? 0 : facts.spp;
  document.documentElement.dataset.number = facts.number;
  document.documentElement.dataset.done = facts.done;
}

function plot(live) {
  const left = 34, right = 274, top = 8, bottom = 78, least = -4;
  const depth = Math.max(live.length - 1, 1);
  const x = (d) => left + ((right - left) * d) / depth;
  const y = (share) => top + ((bottom - top) * Math.min(0, Math.max(least, Math.log10(share || 1e-9)))) / least;
  const rows = [0, -1, -2, -3, -4].map((e) => {
    const at = y(10 ** e), name = { 0: "100 %", "-2": "1 %", "-4": "0.01 %" }[e] || "";
    return `<line class="grid" x1="${left}" x2="${right}" y1="${at}" y2="${at}"/><text x="${left - 4}" y="${at + 3}" text-anchor="end">${name}</text>`;
  });
  const step = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((s) => depth / s <= 6) || 5000;
  for (let d = 0; d <= depth; d += step) rows.push(`<text x="${x(d)}" y="92" text-anchor="middle">${d}</text>`);
  const points = live.map((share, d) => `${x(d).toFixed(1)},${y(share).toFixed(1)}`);
  if (points.length) {
    const end = x(live.length - 1).toFixed(1);
    rows.push(`<polygon class="area" points="${left},${bottom} ${points.join(" ")} ${end},${bottom}"/>`);
    rows.push(`<polyline class="line" points="${points.join(" ")}"/>`);
  }
  find("plot").innerHTML = rows.join("");
}

// ---- controls ----

// Sliders whose scale is not the value's: [to the slider, from the slider, text].
const reach = () => (state && state.distance) || 1;
const SCALES = {
  exposure: [(v) => v, (s) => s, (v) => `${v > 0 ? "+" : ""}${v.toFixed(1)} EV`],
  fov: [(v) => v, (s) => s, (v) => `${v.toFixed(1)}°`],
  aperture_radius: [
    (v) => (v > 0 ? Math.max(0.005, 1 + Math.log10(v / (0.1 * reach())) / 3) : 0),
    (s) => (s > 0 ? Number((0.1 * reach() * 10 ** (3 * (s - 1))).toPrecision(3)) : 0),
    (v) => (v > 0 ? digits(v) : "pinhole"),
  ],
  focus_distance: [
    (v) => Math.log10(v / reach()) / 1.5,
    (s) => Number((reach() * 10 ** (1.5 * s)).toPrecision(4)), (v) => digits(v, 4),
  ],
};
const named = [...document.querySelectorAll("[data-name]")];

function options(select, values) {
  if (select.options.length === values.length) return;
  select.replaceChildren(...values.map((value) => new Option(value, value)));
}

function tabs(box, entries, name) {
  if (box.children.length !== entries.length) {
    box.replaceChildren(...entries.map(([value, title]) => {
      const button = document.createElement("button");
      button.textContent = title;
      button.dataset.value = value;
      button.onclick = () => set(name, value);
      return button;
    }));
  }
  for (const button of box.children) button.setAttribute("aria-pressed", button.dataset.value === state[name]);
}

function update(values) {
  const first = !state;
  state = values;
  document.title = `${state.title} · veriray`;
  find("title").textContent = state.title;
  options(document.querySelector("[data-name=sampler]"), state.samplers);
  options(document.querySelector("[data-name=scheduler]"), state.schedulers);
  options(document.querySelector("[data-name=up]"), state.ups);
  tabs(find("channel"), Object.entries(state.channels), "channel");
  tabs(find("curve"), state.curves.map((name) => [name, name[0].toUpperCase() + name.slice(1)]), "curve");
  for (const input of named) {
    const value = state[input.dataset.name], scale = SCALES[input.dataset.name];
    if (scale) input.nextElementSibling.textContent = scale[2](value);
    if (input === document.activeElement && !first && input.type !== "range") continue;
    if (input !== dragged) input.value = scale ? scale[0](value) : value;
    input.classList.remove("wrong");
  }
  const perspective = state.projection === "perspective";
  document.querySelectorAll(".lens").forEach((row) => row.classList.toggle("off", !perspective));
  find("focus").classList.toggle("off", !perspective || !state.aperture_radius);
  speed.oninput();
  if (first || state.message !== update.message) banner(state.message, 0, /^building/.test(state.message) ? "info" : "");
  update.message = state.message;
  if (facts) { layout(); report(); }
}

let dragged = null;
for (const input of named) {
  const name = input.dataset.name, scale = SCALES[name];
  if (input.type === "range") {
    input.oninput = () => { dragged = input; set(name, scale[1](Number(input.value))); };
    input.onchange = () => { dragged = null; };
    input.ondblclick = () => { if (name === "exposure") set(name, 0); };
  } else {
    input.onchange = () => {
      const value = input.tagName === "SELECT" ? input.value : Number(input.value);
      input.classList.toggle("wrong", input.tagName !== "SELECT" && !input.checkValidity());
      if (input.checkValidity() && input.value !== "") set(name, value);
    };
    input.onkeydown = (event) => { if (event.key === "Enter") input.blur(); };
  }
}
find("reset").onclick = () => send({ do: "reset" });
find("fit").onclick = () => {
  set("width", Math.max(1, Math.round(stage.clientWidth - 24)));
  set("height", Math.max(1, Math.round(stage.clientHeight - 24)));
};
find("sha").onclick = () => navigator.clipboard?.writeText(facts.sha256)
  .then(() => banner("the hash is copied", 1500, "info"));
for (const link of document.querySelectorAll("[data-save]")) {
  link.href = `save/${link.dataset.save}${location.search}`;
  link.onclick = async (event) => {
    event.preventDefault();
    const answer = await fetch(link.href).catch(() => null);
    if (!answer || !answer.ok) return banner(answer ? await answer.text() : "no connection", 8000);
    const file = document.createElement("a");
    file.href = URL.createObjectURL(await answer.blob());
    file.download = decodeURIComponent(answer.headers.get("Content-Disposition").split("''")[1]);
    file.click();
    setTimeout(() => URL.revokeObjectURL(file.href), 60000);
  };
}
const speed = find("speed");
speed.oninput = () => { speed.nextElementSibling.textContent = `${digits(reach() * 10 ** Number(speed.value), 2)} / s`; };

// ---- moves: gathered, and sent once a frame of the screen ----

const gathered = {};
const keys = new Set();
const fingers = new Map(); // what is down: id to place
let drag = null, last = 0, running = false;

function gather(what, ...numbers) {
  const sum = (gathered[what] ||= numbers.map(() => 0));
  numbers.forEach((x, i) => { sum[i] += x; });
  run();
}

function run() {
  if (running) return;
  running = true;
  last = performance.now();
  requestAnimationFrame(tick);
}

function tick(now) {
  const seconds = Math.min(0.1, Math.max(0, now - last) / 1000);
  last = now;
  if (keys.size && facts) {
    const axis = (plus, minus) => Number(keys.has(plus)) - Number(keys.has(minus));
    const step = 10 ** Number(speed.value) * seconds * (keys.has("ShiftLeft") || keys.has("ShiftRight") ? 4 : 1);
    const move = [axis("KeyA", "KeyD"), axis("KeyE", "KeyQ"), axis("KeyW", "KeyS")].map((x) => x * step);
    if (move.some(Boolean)) gather("fly", ...move);
    const turn = [axis("ArrowLeft", "ArrowRight"), axis("ArrowUp", "ArrowDown")].map((x) => x * 1.2 * seconds);
    if (turn.some(Boolean)) gather("look", ...turn);
  }
  for (const [what, [x, y, z]] of Object.entries(gathered)) {
    send({ do: what, x, y, z });
    delete gathered[what];
  }
  running = keys.size > 0;
  if (running) requestAnimationFrame(tick);
}

stage.addEventListener("pointerdown", (event) => {
  stage.focus();
  stage.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  stage.classList.add("busy", "used");
  if (fingers.size > 1) {
    drag = fingers.size === 2 ? { what: "pinch", far: Infinity, ...pinch() } : null;
    return;
  }
  const pan = event.shiftKey || event.button === 1;
  const look = event.button === 2 || event.ctrlKey || event.metaKey;
  const least = event.pointerType === "touch" ? 10 : 4;
  drag = { x: event.clientX, y: event.clientY, far: 0, least, what: pan ? "pan" : look ? "look" : "orbit" };
});
/** The middle of two fingers, and how far apart they are. */
function pinch() {
  const [[x, y], [u, v]] = fingers.values();
  return { x: (x + u) / 2, y: (y + v) / 2, apart: Math.max(1, Math.hypot(x - u, y - v)) };
}
stage.addEventListener("pointermove", (event) => {
  if (fingers.has(event.pointerId)) fingers.set(event.pointerId, [event.clientX, event.clientY]);
  if (!drag || !facts) return;
  const height = canvas.clientHeight || 1;
  if (drag.what === "pinch") {
    const now = pinch();
    gather("pan", (now.x - drag.x) / height, (now.y - drag.y) / height);
    gather("zoom", Math.log(drag.apart / now.apart));
    Object.assign(drag, now);
    return;
  }
  const dx = (event.clientX - drag.x) / height, dy = (event.clientY - drag.y) / height;
  drag.far += Math.hypot(event.clientX - drag.x, event.clientY - drag.y);
  [drag.x, drag.y] = [event.clientX, event.clientY];
  if (drag.far < drag.least) return;
  if (drag.what === "orbit") gather("orbit", -Math.PI * dx, -Math.PI * dy);
  else if (drag.what === "look") {
    const angle = ((state ? state.fov : 40) * Math.PI) / 180;
    gather("look", angle * dx, angle * dy);
  } else gather("pan", dx, dy);
});
function release(event) {
  fingers.delete(event.pointerId);
  if (!fingers.size) stage.classList.remove("busy");
  if (drag && drag.far < drag.least && event.type === "pointerup" && event.button === 0) {
    const box = canvas.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width, y = (event.clientY - box.top) / box.height;
    if (x >= 0 && x <= 1 && y >= 0 && y <= 1) {
      send({ do: "focus", x, y });
      const ring = find("ring"), frame = stage.getBoundingClientRect();
      ring.hidden = true;
      void ring.offsetWidth; // starts the animation anew
      Object.assign(ring.style, { left: `${event.clientX - frame.left}px`, top: `${event.clientY - frame.top}px` });
      ring.hidden = false;
    }
  }
  drag = null;
}
stage.addEventListener("pointerup", release);
stage.addEventListener("pointercancel", release);
stage.addEventListener("contextmenu", (event) => event.preventDefault());
stage.addEventListener("wheel", (event) => {
  event.preventDefault();
  gather("zoom", event.deltaY * (event.deltaMode === 1 ? 0.03 : 0.001));
}, { passive: false });

const FLY = /^(Key[WASDQE]|Arrow(Left|Right|Up|Down)|Shift(Left|Right))$/;
window.addEventListener("keydown", (event) => {
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(document.activeElement.tagName) && document.activeElement.type !== "range") return;
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.code === "KeyH" && !event.repeat) { document.body.classList.toggle("bare"); layout(); }
  if (!FLY.test(event.code)) return;
  if (event.code.startsWith("Arrow")) event.preventDefault();
  keys.add(event.code);
  run();
});
window.addEventListener("keyup", (event) => keys.delete(event.code));
window.addEventListener("blur", () => keys.clear());
new ResizeObserver(layout).observe(stage);
connect();
