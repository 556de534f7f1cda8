"use strict";
// The pictures of `veriray compare`: swipe, flicker, zoom, read-out. All panels share one view.
(async () => {
  const box = document.getElementById("pictures");
  const find = (selector) => [...box.querySelectorAll(selector)];
  const about = JSON.parse(box.dataset.about);
  const { width, height, step, columns, rows, codes } = about;
  const size = columns * rows;

  // ---- the data ----

  const packed = Uint8Array.from(atob(document.getElementById("planes").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  if (planes.length !== 20 * size) throw new Error("the pictures are damaged");

  const whole = (side, channel, k) => {
    const high = planes[(10 * side + 1 + channel) * size + k];
    return ((high << 24) >> 16) | planes[(10 * side + 4 + channel) * size + k];
  };
  const value = (side, channel, k) => {
    const m = whole(side, channel, k);
    if (m === -32768) return NaN;
    if (Math.abs(m) === 32767) return Math.sign(m) * Infinity;
    return m * 2 ** (planes[10 * side * size + k] - 141);
  };
  const error = (side, channel, k) => {
    const code = planes[(10 * side + 7 + channel) * size + k], [low, interval] = codes[side];
    return code === 0 ? NaN : code === 1 ? 0 : 2 ** (low + (code - 2) * interval);
  };

  // ---- display copies: one scale for both, sRGB; magenta: not finite ----

  const curve = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
  const steps = Uint8Array.from({ length: 4097 }, (_, k) => Math.round(255 * curve(k / 4096)));
  const canvas = (wide, high) => Object.assign(document.createElement("canvas"), { width: wide, height: high });
  const copies = [canvas(columns, rows), canvas(columns, rows)];
  const develop = (stops) => copies.forEach((copy, side) => {
    const pen = copy.getContext("2d"), shown = pen.createImageData(columns, rows), out = shown.data;
    const scales = Array.from({ length: 256 }, (_, e) => (4096 * 2 ** (e - 141 + stops)) / about.white);
    for (let k = 0; k < size; ++k) {
      const scale = scales[planes[10 * side * size + k]];
      let lost = false;
      for (let c = 0; c < 3; ++c) {
        const m = whole(side, c, k);
        lost ||= m < -32766 || m > 32766;
        out[4 * k + c] = steps[Math.min(4096, Math.max(0, Math.round(m * scale)))];
      }
      if (lost) out.set([255, 0, 255], 4 * k);
      out[4 * k + 3] = 255;
    }
    pen.putImageData(shown, 0, 0);
  });

  // ---- panels ----

  const view = { mode: "swipe", split: 0.5, zoom: 1, x: width / 2, y: height / 2, stops: 0, at: null, side: 0 };
  const panels = find("figure").map((figure) => {
    const image = figure.querySelector("img"), shown = canvas(1, 1);
    shown.tabIndex = 0;
    shown.setAttribute("role", "application");
    shown.setAttribute("aria-label", `${image.alt}; arrow keys read pixels, plus and minus zoom`);
    const panel = { figure, shown, name: figure.dataset.panel, image, cell: Number(figure.dataset.cell) };
    image.replaceWith(shown);
    return panel;
  });
  await Promise.all(panels.map(({ image }) => image.decode()));
  const visible = () => panels.filter(({ figure }) => !figure.hidden);

  /** Pixels of the page's picture per pixel of a panel's canvas, and the place of its corner. */
  const frame = ({ shown }) => {
    const scale = (view.zoom * shown.width) / width;
    return { scale, x: shown.width / 2 - view.x * scale, y: shown.height / 2 - view.y * scale };
  };

  const paint = (panel, pen, source, cell) => {
    const { scale, x, y } = frame(panel), unit = scale * cell, { shown } = panel;
    const [x0, y0] = [x, y].map((start) => Math.max(0, Math.floor(-start / unit)));
    const x1 = Math.min(source.width, Math.ceil((shown.width - x) / unit));
    const y1 = Math.min(source.height, Math.ceil((shown.height - y) / unit));
    pen.imageSmoothingEnabled = unit < 1;
    if (x1 > x0 && y1 > y0)
      pen.drawImage(source, x0, y0, x1 - x0, y1 - y0, x + x0 * unit, y + y0 * unit, (x1 - x0) * unit, (y1 - y0) * unit);
  };

  const label = (pen, text, x, align, unit) => {
    pen.font = `600 ${13 * unit}px system-ui, sans-serif`;
    const wide = pen.measureText(text).width + 12 * unit, left = align === "left" ? x : x - wide;
    pen.fillStyle = "#000b";
    pen.fillRect(left, 0, wide, 22 * unit);
    pen.fillStyle = "#fff";
    pen.fillText(text, left + 6 * unit, 16 * unit);
  };

  const draw = (panel) => {
    const { shown, name, cell } = panel, pen = shown.getContext("2d"), unit = shown.width / shown.clientWidth;
    pen.clearRect(0, 0, shown.width, shown.height);
    const stage = name === "a" && view.mode !== "both";
    if (stage && view.mode === "swipe") {
      const at = Math.round(view.split * shown.width);
      paint(panel, pen, copies[1], step);
      pen.save();
      pen.beginPath();
      pen.rect(0, 0, at, shown.height);
      pen.clip();
      pen.clearRect(0, 0, at, shown.height);
      paint(panel, pen, copies[0], step);
      pen.restore();
      if (at > 40 * unit) label(pen, "A", 0, "left", unit);
      if (shown.width - at > 40 * unit) label(pen, "B", shown.width, "right", unit);
      pen.fillStyle = "#000";
      pen.fillRect(at - 2 * unit, 0, 4 * unit, shown.height);
      pen.fillStyle = "#fff";
      pen.fillRect(at - unit, 0, 2 * unit, shown.height);
      pen.beginPath();
      pen.arc(at, shown.height / 2, 9 * unit, 0, 7);
      pen.fill();
      pen.lineWidth = 2 * unit;
      pen.strokeStyle = "#000";
      pen.stroke();
    } else if (name === "a" || name === "b") {
      const side = stage ? view.side : Number(name === "b");
      paint(panel, pen, copies[side], step);
      label(pen, "AB"[side], 0, "left", unit);
      shown.dataset.side = "ab"[side];
    } else paint(panel, pen, panel.image, cell);
    if (view.at) {
      const { scale, x, y } = frame(panel), wide = Math.max(scale * step, 6 * unit);
      const [cx, cy] = [x + (view.at[0] + 0.5) * step * scale, y + (view.at[1] + 0.5) * step * scale];
      for (const [colour, out] of [["#000", 1], ["#fff", 0]]) {
        pen.strokeStyle = colour;
        pen.lineWidth = unit;
        pen.strokeRect(cx - wide / 2 - out * unit, cy - wide / 2 - out * unit, wide + 2 * out * unit, wide + 2 * out * unit);
      }
    }
  };

  let asked = 0;
  const redraw = () => { asked ||= requestAnimationFrame(() => { asked = 0; visible().forEach(draw); }); };
  const fit = () => {
    for (const { shown } of visible()) {
      const wide = Math.round(shown.clientWidth * devicePixelRatio);
      shown.width = Math.max(wide, 1);
      shown.height = Math.max(Math.round((wide * height) / width), 1);
    }
    redraw();
  };

  // ---- the view ----

  const hold = () => {
    const half = 0.5 / view.zoom;
    view.x = width * Math.min(1 - half, Math.max(half, view.x / width));
    view.y = height * Math.min(1 - half, Math.max(half, view.y / height));
    for (const { shown } of panels) shown.style.touchAction = view.zoom > 1 ? "none" : "pan-y";
    box.dataset.zoom = view.zoom;
    redraw();
  };
  /** Zooms by a factor about a place of the picture, which stays where it is. */
  const zoom = (factor, x = view.x, y = view.y) => {
    const most = Math.max(1, width / 8, height / 8), before = view.zoom;
    view.zoom = Math.min(most, Math.max(1, before * factor));
    view.x = x + ((view.x - x) * before) / view.zoom;
    view.y = y + ((view.y - y) * before) / view.zoom;
    hold();
  };
  const place = (panel, event) => {
    const edge = panel.shown.getBoundingClientRect(), unit = panel.shown.width / edge.width;
    const { scale, x, y } = frame(panel);
    return [((event.clientX - edge.left) * unit - x) / scale, ((event.clientY - edge.top) * unit - y) / scale];
  };

  let timer = 0;
  const choose = (mode) => {
    view.mode = mode;
    clearInterval(timer);
    if (mode === "flicker") timer = setInterval(() => { view.side = 1 - view.side; redraw(); }, 500);
    else view.side = Number(mode === "b");
    find("[data-mode]").forEach((b) => b.setAttribute("aria-pressed", b.dataset.mode === mode));
    panels.forEach(({ figure, name }) => { if (name === "b") figure.hidden = mode !== "both"; });
    box.classList.toggle("stage", mode !== "both");
    box.dataset.view = mode;
    fit();
  };

  // ---- read-out ----

  const number = (x, digits) => (!Number.isFinite(x) ? (Number.isNaN(x) ? "not a number" : x > 0 ? "infinite" : "-infinite")
    : x === 0 ? "0" : x.toPrecision(digits).replace("-", "\u2212"));
  const fill = (td, [text, e]) => {
    const more = Object.assign(document.createElement("span"), { className: "error" });
    more.textContent = e === undefined || Number.isNaN(e) ? "" : ` \u00b1 ${number(e, 2)}`;
    td.replaceChildren(text, more);
  };
  const read = (x, y) => {
    view.at = [Math.min(columns - 1, Math.max(0, x)), Math.min(rows - 1, Math.max(0, y))];
    const [px, py] = view.at, k = py * columns + px, table = { a: [], b: [], d: [], z: [] };
    for (let c = 0; c < 3; ++c) {
      const [a, b, ea, eb] = [value(0, c, k), value(1, c, k), error(0, c, k), error(1, c, k)];
      const e = Math.hypot(ea, eb);
      table.a.push([number(a, 5), ea]);
      table.b.push([number(b, 5), eb]);
      table.d.push([number(a - b, 3), e]);
      table.z.push([e > 0 && Number.isFinite(a - b) ? ((a - b) / e).toFixed(1).replace("-", "\u2212") : "\u2013"]);
    }
    for (const [row, cells] of Object.entries(table))
      find(`[data-row=${row}] td`).forEach((td, c) => fill(td, cells[c]));
    const name = (at, n) => (step === 1 ? `${at}` : `${at * step} to ${Math.min(n, (at + 1) * step) - 1}`);
    find("[data-where]")[0].textContent = `${name(px, width)}, ${name(py, height)}`;
    box.dataset.at = `${px} ${py}`;
    redraw();
  };
  const readAt = (x, y) => read(Math.floor(x / step), Math.floor(y / step));

  // ---- pointers and keys ----

  for (const panel of panels) {
    const { shown } = panel, down = new Map();
    let split = false, apart = 0;
    const onLine = (event) => {
      if (panel.name !== "a" || view.mode !== "swipe") return false;
      const edge = shown.getBoundingClientRect();
      return Math.abs(event.clientX - edge.left - view.split * edge.width) < (event.pointerType === "mouse" ? 10 : 24);
    };
    const distance = () => { const [p, q] = [...down.values()]; return Math.hypot(p[0] - q[0], p[1] - q[1]); };
    shown.addEventListener("pointerdown", (event) => {
      shown.setPointerCapture(event.pointerId);
      split = down.size === 0 && onLine(event);
      down.set(event.pointerId, [event.clientX, event.clientY]);
      if (down.size === 2) apart = distance();
      if (!split) readAt(...place(panel, event));
    });
    shown.addEventListener("pointermove", (event) => {
      const last = down.get(event.pointerId), edge = shown.getBoundingClientRect();
      if (!last) {
        shown.style.cursor = onLine(event) ? "ew-resize" : "crosshair";
        readAt(...place(panel, event));
        return;
      }
      down.set(event.pointerId, [event.clientX, event.clientY]);
      if (split) {
        view.split = Math.min(1, Math.max(0, (event.clientX - edge.left) / edge.width));
        box.dataset.split = view.split;
        redraw();
      } else if (down.size === 2) {
        const now = distance();
        zoom(now / Math.max(apart, 1), ...place(panel, event));
        apart = now;
      } else {
        const unit = width / edge.width / view.zoom;
        view.x -= (event.clientX - last[0]) * unit;
        view.y -= (event.clientY - last[1]) * unit;
        hold();
      }
    });
    for (const end of ["pointerup", "pointercancel"])
      shown.addEventListener(end, (event) => { down.delete(event.pointerId); split = false; });
    shown.addEventListener("dblclick", (event) => zoom(2, ...place(panel, event)));
    shown.addEventListener("wheel", (event) => {
      // the page scrolls past the pictures unless one of them was clicked
      if (!event.ctrlKey && document.activeElement !== shown) return;
      event.preventDefault();
      zoom(2 ** (-event.deltaY / 240), ...place(panel, event));
    }, { passive: false });
    shown.addEventListener("keydown", (event) => {
      const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      const at = view.at ?? [Math.floor(view.x / step), Math.floor(view.y / step)], far = event.shiftKey ? 10 : 1;
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (move) {
        read(at[0] + far * move[0], at[1] + far * move[1]);
        const [x, y] = view.at.map((p) => (p + 0.5) * step), half = 0.5 / view.zoom;
        view.x = Math.min(x + half * width, Math.max(x - half * width, view.x));
        view.y = Math.min(y + half * height, Math.max(y - half * height, view.y));
        hold();
      } else if (event.key === "+" || event.key === "=") zoom(2, ...at.map((p) => (p + 0.5) * step));
      else if (event.key === "-") zoom(0.5, ...at.map((p) => (p + 0.5) * step));
      else if (event.key === "0") zoom(0);
      else if (event.key === "," || event.key === ".") {
        view.split = Math.min(1, Math.max(0, view.split + (event.key === "," ? -0.02 : 0.02)));
        box.dataset.split = view.split;
        choose("swipe");
      } else if (event.key === " ") choose(view.mode === "a" ? "b" : "a");
      else if (event.key === "s") choose("swipe");
      else if (event.key === "f") choose("flicker");
      else return;
      event.preventDefault();
    });
  }

  const slider = find("input[type=range]")[0];
  slider.addEventListener("input", () => {
    view.stops = Number(slider.value);
    find("output")[0].textContent = view.stops.toFixed(1);
    develop(view.stops);
    redraw();
  });
  find("[data-mode]").forEach((b) => b.addEventListener("click", () => choose(b.dataset.mode)));
  find("[data-zoom]").forEach((b) => b.addEventListener("click", () => zoom(Number(b.dataset.zoom))));
  find("[hidden].live").forEach((part) => { part.hidden = false; });
  new ResizeObserver(fit).observe(box);
  develop(0);
  choose("swipe");
  hold();
  box.dataset.ready = "true";
})();
