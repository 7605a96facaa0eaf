"use strict";
// What report and live page share: arrays out of the page, plots in time, and a canvas that draws the body.
const Pliant = (() => {
  const GAP = -32768, HALF = 32500;
  const style = getComputedStyle(document.documentElement);
  const paint = (name) => style.getPropertyValue(`--${name}`).trim();
  const px = (size) => `${size}px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif`;

  async function inflate(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).arrayBuffer();
  }

  // The array behind a note: flat numbers, NaN where nothing was seen, and their shape.
  function array(block, note) {
    const count = note.shape.reduce((a, b) => a * b, 1);
    if (note.kind === "float64") {
      return { shape: note.shape, flat: new Float64Array(block.slice(note.at, note.at + 8 * count)) };
    }
    const steps = new Uint16Array(block.slice(note.at, note.at + 2 * count));
    const flat = new Float64Array(count), width = count / (note.shape[0] || 1), level = new Int16Array(width);
    for (let i = 0; i < count; i++) {
      const j = i % width;
      level[j] += steps[i];
      flat[i] = level[j] === GAP ? NaN : (level[j] + HALF) * note.scale + note.low;
    }
    return { shape: note.shape, flat };
  }

  // One column of an array (T, ...), as a list with null for gaps.
  function column(a, at) {
    const width = a.flat.length / a.shape[0], out = new Array(a.shape[0]);
    for (let t = 0; t < out.length; t++) {
      const v = a.flat[t * width + at];
      out[t] = Number.isFinite(v) ? v : null;
    }
    return out;
  }

  const digits = (v, unit = "", count = 3) => {
    if (v === null || v === undefined || !Number.isFinite(v)) return "–";
    const text = Math.abs(v) >= 100 ? v.toFixed(Math.max(0, count - 3)) : Math.abs(v) >= 10 ? v.toFixed(count - 2)
      : v.toFixed(count - 1);
    return `${text.replace("-", "−")}${unit ? ` ${unit}` : ""}`;
  };

  // A colour between those of the base and of the tip; a body with one station has that of the tip.
  function ramp(share) {
    const parse = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
    const [a, b] = [parse(paint("base")), parse(paint("tip"))];
    return `rgb(${a.map((v, i) => Math.round(v + share * (b[i] - v))).join(",")})`;
  }

  function tags(u, named) {
    const ctx = u.ctx, ratio = devicePixelRatio, shown = [];
    const [low, high] = [u.scales.x.min, u.scales.x.max];
    named.forEach((s, i) => {
      if (!s.tag) return;
      let k = u.data[0].length - 1;
      while (k > 0 && (u.data[0][k] > high || u.data[i + 1][k] === null)) k--;
      if (u.data[0][k] < low || u.data[i + 1][k] === null) return;
      shown.push({ y: u.valToPos(u.data[i + 1][k], "y", true), text: s.tag, colour: s.colour() });
    });
    shown.sort((a, b) => a.y - b.y);
    ctx.save();
    ctx.font = px(12 * ratio);
    ctx.textBaseline = "middle";
    ctx.textAlign = "left";
    const apart = 13 * ratio, lowest = u.bbox.top + u.bbox.height;
    shown.forEach((s, i) => { s.y = Math.max(s.y, i ? shown[i - 1].y + apart : s.y); });
    shown.reduceRight((below, s) => (s.y = Math.min(s.y, below - apart)), lowest + apart);
    shown.forEach((s) => {
      ctx.fillStyle = s.colour;
      ctx.fillText(s.text.length > 10 ? `${s.text.slice(0, 9)}…` : s.text, u.bbox.left + u.bbox.width + 5 * ratio, s.y);
    });
    ctx.restore();
  }

  const axis = (label, extra = {}) => ({
    stroke: () => paint("ink"), font: px(12), labelFont: px(12), labelSize: 18, labelGap: 0, label, gap: 4,
    grid: { stroke: () => paint("rule"), width: 1 }, ticks: { stroke: () => paint("rule"), width: 1, size: 5 },
    ...extra,
  });

  // series: {label, values, colour: () => css, width, dash, points, tag}; bands: [high, low] places in series.
  function plot(host, o) {
    const room = o.series.some((s) => s.tag) || o.room ? (host.clientWidth < 500 ? 58 : 76) : 12;
    const series = o.series.map((s) => ({
      label: s.label, stroke: s.colour, width: s.width ?? 1.5, dash: s.dash, spanGaps: false, pxAlign: 0,
      points: s.points ? { show: true, size: s.points, fill: s.fill ?? s.colour, stroke: s.colour } : { show: false },
      paths: s.points && !s.line ? () => null : undefined,
    }));
    const opts = {
      pxAlign: 0, width: host.clientWidth || 600, height: o.height ?? 190, padding: [8, room, 0, 0], legend: { show: false },
      scales: { x: { time: false }, y: o.log ? { distr: 3 } : { range: o.range } },
      cursor: { y: false, drag: { x: true, y: false, setScale: true }, points: { size: 6 } },
      axes: [axis(o.xlabel ?? "", { size: o.xlabel ? 30 : 22, labelSize: o.xlabel ? 16 : 0 }),
             axis(o.ylabel, { size: 48, ...(o.log ? {} : { values: (_, v) => v.map((x) => x === null ? "" : uPlot.fmtNum(x).replace("-", "−")) }) })],
      series: [{ label: "x" }, ...series],
      bands: (o.bands ?? []).map(([a, b]) => ({ series: [a + 1, b + 1], fill: () => paint("band") })),
      hooks: {
        draw: [(u) => tags(u, o.series), (u) => (o.marks ?? []).forEach((m) => rule(u, m))],
        setScale: [(u, key) => key === "x" && o.zoomed?.(u)],
      },
    };
    const u = new uPlot(opts, [o.x, ...o.series.map((s) => s.values)], host);
    new ResizeObserver(() => host.clientWidth && host.clientWidth !== u.width
      && u.setSize({ width: host.clientWidth, height: u.height })).observe(host);
    return u;
  }

  // A level across a plot, or a band of two levels.
  function rule(u, mark) {
    const ctx = u.ctx, levels = [mark.low ?? mark.at, mark.at].map((v) => u.valToPos(v, "y", true));
    ctx.save();
    ctx.beginPath();
    ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
    ctx.clip();
    ctx.strokeStyle = paint("soft");
    ctx.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
    for (const y of new Set(levels)) {
      ctx.beginPath();
      ctx.moveTo(u.bbox.left, y);
      ctx.lineTo(u.bbox.left + u.bbox.width, y);
      ctx.stroke();
    }
    if (mark.text) {
      ctx.fillStyle = paint("ink");
      ctx.font = px(12 * devicePixelRatio);
      ctx.textAlign = "left";
      ctx.textBaseline = "alphabetic";
      ctx.fillText(mark.text, u.bbox.left + 6 * devicePixelRatio, mark.low === undefined ? levels[1] - 5 * devicePixelRatio
        : levels[0] + 14 * devicePixelRatio);
    }
    ctx.restore();
  }

  // Where a camera looks from: its right and its up, in the frame of the body. Height pi / 2 looks from above.
  function camera(azimuth, height) {
    const [s, c] = [Math.sin(azimuth), Math.cos(azimuth)], [h, k] = [Math.sin(height), Math.cos(height)];
    return { right: [c, s, 0], up: [-h * s, h * c, k] };
  }
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const VIEWS = [["x", "z", 0, 0], ["y", "z", Math.PI / 2, 0], ["x", "y", 0, Math.PI / 2]]; // in print: front, side, top

  // The canvas of the body: equal axes in mm, the base at the bottom, what was measured thick and grey beneath. A body
  // in space, whose points have three numbers, is turned by dragging, and printed in three views.
  class Body {
    constructor(canvas) {
      this.canvas = canvas;
      this.scene = null;
      this.turned = { azimuth: -0.6, height: 0.35 }; // of a body in space, rad
      new ResizeObserver(() => this.draw()).observe(canvas);
    }

    // scene: {low: [x, y], high: [x, y], paint}, or low and high of three numbers; paint(body) draws what moves.
    show(scene) { this.scene = scene; this.draw(); }

    get inSpace() { return this.scene?.low.length === 3; }

    // The frame of a view: the whole canvas, or in print one of three side by side.
    place(part = 0, parts = 1) {
      const { canvas, scene } = this, ratio = devicePixelRatio, wide = canvas.clientWidth, h = canvas.clientHeight;
      if (!part && canvas.width !== Math.round(wide * ratio)) canvas.width = Math.round(wide * ratio);
      if (!part && canvas.height !== Math.round(h * ratio)) canvas.height = Math.round(h * ratio);
      const { low, high } = this.inSpace ? this.around() : scene, span = [high[0] - low[0], high[1] - low[1]].map((v) => v || 1);
      const w = wide / parts, left = part * w, inner = { left: left + 44, right: 12, top: 12, bottom: 36 };
      const room = w - 56, tall = h - inner.top - inner.bottom;
      const k = Math.min(room / span[0], tall / span[1]);
      const x0 = inner.left + (room - k * span[0]) / 2 - k * low[0];
      const y0 = h - inner.bottom - (tall - k * span[1]) / 2 + k * low[1];
      Object.assign(this, { k, x0, y0, w: left + w, h, inner, ratio });
    }

    // What a view shows of a body in space: all of it, however it is turned.
    around() {
      const { low, high } = this.scene, middle = low.map((v, c) => (v + high[c]) / 2), { right, up } = this.camera;
      const reach = 0.5 * Math.hypot(...low.map((v, c) => high[c] - v)), [x, y] = [dot(right, middle), dot(up, middle)];
      return { low: [x - reach, y - reach], high: [x + reach, y + reach] };
    }

    get camera() { return camera(this.turned.azimuth, this.turned.height); }

    // Where a point lies in the view, mm.
    flat(p) {
      if (p.length < 3) return p;
      if (!p.every(Number.isFinite)) return [NaN, NaN];
      return [dot(this.camera.right, p), dot(this.camera.up, p)];
    }

    // A point as far from the viewer as another, at a place of the view, mm.
    beside(p, [x, y]) {
      if (p.length < 3) return [x, y];
      const { right, up } = this.camera, [a, b] = this.flat(p);
      return p.map((v, c) => v + (x - a) * right[c] + (y - b) * up[c]);
    }

    // Turn by a drag of so many pixels.
    turn(dx, dy) {
      const { azimuth, height } = this.turned, most = Math.PI / 2;
      this.turned = { azimuth: azimuth - 0.01 * dx, height: Math.max(-most, Math.min(most, height + 0.01 * dy)) };
      this.draw();
    }

    at(x, y) { return [this.x0 + this.k * x, this.y0 - this.k * y]; }
    from(px_, py_) { return [(px_ - this.x0) / this.k, (this.y0 - py_) / this.k]; }

    line(points, colour, width, dash = []) {
      const ctx = this.canvas.getContext("2d");
      ctx.beginPath();
      let down = false;
      for (const p of points) {
        const [x, y] = this.flat(p);
        if (!Number.isFinite(x) || !Number.isFinite(y)) { down = false; continue; }
        if (down) ctx.lineTo(...this.at(x, y)); else ctx.moveTo(...this.at(x, y));
        down = true;
      }
      ctx.strokeStyle = colour;
      ctx.lineWidth = width;
      ctx.lineJoin = ctx.lineCap = "round";
      ctx.setLineDash(dash);
      ctx.stroke();
      ctx.setLineDash([]);
    }

    dots(points, colour, radius, fill = colour) {
      const ctx = this.canvas.getContext("2d");
      for (const p of points) {
        const [x, y] = this.flat(p);
        if (!Number.isFinite(x) || !Number.isFinite(y)) continue;
        ctx.beginPath();
        ctx.arc(...this.at(x, y), radius, 0, 2 * Math.PI);
        ctx.fillStyle = fill;
        ctx.fill();
        ctx.strokeStyle = colour;
        ctx.lineWidth = 1.4;
        ctx.stroke();
      }
    }

    grid([across, up] = ["x", "y"]) {
      const ctx = this.canvas.getContext("2d"), { w, h, inner } = this;
      const rough = 70 / this.k, power = 10 ** Math.floor(Math.log10(rough));
      const step = [1, 2, 5, 10].map((m) => m * power).find((v) => v >= rough);
      ctx.font = px(12);
      ctx.strokeStyle = paint("rule");
      ctx.fillStyle = paint("ink");
      ctx.lineWidth = 1;
      const [left, bottom] = this.from(inner.left, h - inner.bottom), [right, top] = this.from(w - inner.right, inner.top);
      ctx.textAlign = "center";
      for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
        const [p] = this.at(x, 0);
        ctx.beginPath(); ctx.moveTo(p, inner.top); ctx.lineTo(p, h - inner.bottom); ctx.stroke();
        ctx.fillText(digits(x, "", 3).replace(/\.0*$/, ""), p, h - inner.bottom + 15);
      }
      ctx.textAlign = "right";
      for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
        const [, p] = this.at(0, y);
        ctx.beginPath(); ctx.moveTo(inner.left, p); ctx.lineTo(w - inner.right, p); ctx.stroke();
        ctx.fillText(digits(y, "", 3).replace(/\.0*$/, ""), inner.left - 6, p + 4);
      }
      ctx.textAlign = "left";
      ctx.fillText(`${up} (mm)`, inner.left - 42, inner.top + 2);
      ctx.textAlign = "right";
      ctx.fillText(`${across} (mm)`, w - inner.right, h - 5);
      const [bx, by] = this.at(0, 0);
      ctx.fillStyle = paint("soft");
      ctx.fillRect(bx - 14, by, 28, 5);
    }

    // The axes of the base frame of a body in space, and a length to compare with.
    axes() {
      const ctx = this.canvas.getContext("2d"), { low, high } = this.scene, rough = 0.25 * Math.max(...high.map((v, c) => v - low[c]));
      const power = 10 ** Math.floor(Math.log10(rough)), long = [5, 2, 1].map((m) => m * power).find((v) => v <= rough);
      ctx.font = px(12);
      ctx.fillStyle = paint("ink");
      ctx.textAlign = "center";
      ["x", "y", "z"].forEach((name, c) => {
        const end = [0, 0, 0];
        end[c] = long;
        this.line([[0, 0, 0], end], paint("soft"), 1.5);
        end[c] = 1.15 * long;
        const [x, y] = this.at(...this.flat(end));
        ctx.fillText(name, x, y + 4);
      });
      ctx.textAlign = "left";
      ctx.fillText(`axes of ${digits(long, "", 3).replace(/\.0*$/, "")} mm`, 8, this.h - 8);
    }

    draw() {
      if (!this.scene || !this.canvas.clientWidth) return;
      this.place();
      const ctx = this.canvas.getContext("2d");
      ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      ctx.clearRect(0, 0, this.w, this.h);
      if (this.inSpace && document.documentElement.classList.contains("print")) {
        this.views();
        return;
      }
      if (this.inSpace) this.axes(); else this.grid();
      this.scene.paint(this);
    }

    // Front, side and top.
    views() {
      const { turned } = this;
      VIEWS.forEach(([across, up, azimuth, height], part) => {
        this.turned = { azimuth, height };
        this.place(part, VIEWS.length);
        this.grid([across, up]);
        this.scene.paint(this);
      });
      this.turned = turned;
    }
  }

  return { array, Body, column, digits, inflate, paint, plot, ramp };
})();
