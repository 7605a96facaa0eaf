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
    shown.reduce((last, s) => {
      const y = Math.max(s.y, last + 13 * ratio);
      ctx.fillStyle = s.colour;
      ctx.fillText(s.text.length > 10 ? `${s.text.slice(0, 9)}…` : s.text, u.bbox.left + u.bbox.width + 5 * ratio, y);
      return y;
    }, -1e9);
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

  // The canvas of the body: equal axes in mm, the base at the bottom, what was measured thick and grey beneath.
  class Body {
    constructor(canvas) {
      this.canvas = canvas;
      this.scene = null;
      new ResizeObserver(() => this.draw()).observe(canvas);
    }

    // scene: {low: [x, y], high: [x, y], paths: [{points, colour, width}], ...}; parts() gives what moves.
    show(scene) { this.scene = scene; this.draw(); }

    place() {
      const { canvas, scene } = this, ratio = devicePixelRatio, w = canvas.clientWidth, h = canvas.clientHeight;
      if (canvas.width !== Math.round(w * ratio)) canvas.width = Math.round(w * ratio);
      if (canvas.height !== Math.round(h * ratio)) canvas.height = Math.round(h * ratio);
      const span = [scene.high[0] - scene.low[0], scene.high[1] - scene.low[1]].map((v) => v || 1);
      const inner = { left: 44, right: 12, top: 12, bottom: 36 };
      const k = Math.min((w - inner.left - inner.right) / span[0], (h - inner.top - inner.bottom) / span[1]);
      const x0 = inner.left + (w - inner.left - inner.right - k * span[0]) / 2 - k * scene.low[0];
      const y0 = h - inner.bottom - (h - inner.top - inner.bottom - k * span[1]) / 2 + k * scene.low[1];
      Object.assign(this, { k, x0, y0, w, h, inner, ratio });
    }

    at(x, y) { return [this.x0 + this.k * x, this.y0 - this.k * y]; }
    from(px_, py_) { return [(px_ - this.x0) / this.k, (this.y0 - py_) / this.k]; }

    line(points, colour, width, dash = []) {
      const ctx = this.canvas.getContext("2d");
      ctx.beginPath();
      let down = false;
      for (const [x, y] of points) {
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
      for (const [x, y] of points) {
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

    grid() {
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
      ctx.fillText("y (mm)", 2, inner.top + 2);
      ctx.textAlign = "right";
      ctx.fillText("x (mm)", w - inner.right, h - 5);
      const [bx, by] = this.at(0, 0);
      ctx.fillStyle = paint("soft");
      ctx.fillRect(bx - 14, by, 28, 5);
    }

    draw() {
      if (!this.scene || !this.canvas.clientWidth) return;
      this.place();
      const ctx = this.canvas.getContext("2d");
      ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      ctx.clearRect(0, 0, this.w, this.h);
      this.grid();
      this.scene.paint(this);
    }
  }

  return { array, Body, column, digits, inflate, paint, plot, ramp };
})();
