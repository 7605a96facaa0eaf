"use strict";
// The report: one record under one fit at a time; one clock for the body and for every plot.
(async () => {
  const { array, Body, column, digits, inflate, paint, plot, ramp } = Pliant;
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("data").textContent);
  if (!("DecompressionStream" in window)) { $("old").hidden = false; return; }
  const axes = data.axes, width = axes.length, DASHES = [undefined, [6, 4], [1.5, 3]], unit = data.turns ? "°" : "mm";
  const block = await inflate($("block").textContent);
  const open = (note) => (note ? array(block, note) : null);
  const body = new Body($("body"));
  const all = []; // every plot of the page, to be painted again in other colours
  let now = null; // the record that is shown
  let plots = []; // its plots in time
  let frame = 0, playing = 0, zooming = false;

  const mm = (v) => (Number.isFinite(v) ? v.toFixed(2).replace("-", "−") : "–");
  const names = Object.keys(data.records);
  const held = (k) => names.find((n) => data.fits[k].records[n]?.role === "held_out");

  function load(k, name) {
    const seen = data.records[name], made = data.fits[k].records[name];
    return {
      k, name, ...seen, role: made.role, t: Array.from(open(seen.time).flat), measured: open(seen.position),
      modelled: open(made.position), driven: made.driven, chain: open(made.body), valve: open(made.pressure), plain: open(made.plain),
      traces: seen.inputs.map((p) => ({ name: p.name, value: open(p.value) })),
      band: made.band?.map(open), share: made.level, lag: Array.from(open(made.lag).flat), correlation: open(made.correlation),
      white: made.white, grown: seen.grown && [open(seen.grown), open(data.fits[k].grown[name])], stationsOn: now?.name === name ? now.stationsOn : new Set(seen.shown),
    };
  }

  const points = (a, t) => {
    const row = a.flat.length / a.shape[0], out = [];
    for (let i = 0; i < row; i += width) out.push(axes.map((_, c) => a.flat[t * row + i + c]));
    return out;
  };
  const tone = (r, s) => () => ramp(r.stations.length > 1 ? s / (r.stations.length - 1) : 1);

  // ---- the body --------------------------------------------------------------------------------------------------
  function scene(r) {
    const base = axes.map(() => 0), low = [...base], high = [...base], last = r.stations.length - 1;
    for (const a of [r.measured, r.chain]) {
      a.flat.forEach((v, i) => {
        if (!Number.isFinite(v)) return;
        low[i % width] = Math.min(low[i % width], v);
        high[i % width] = Math.max(high[i % width], v);
      });
    }
    const rim = 0.04 * Math.max(...high.map((v, c) => v - low[c]));
    for (const c of axes.keys()) { low[c] -= rim; high[c] += rim; }
    const path = (a, s) => r.t.map((_, t) => points(a, t)[s]);
    const [was, says] = [path(r.measured, last), path(r.modelled, last)];
    return { low, high, paint: (b) => {
      b.line(was, paint("faint"), 4);
      b.line(says, paint("tip"), 0.8, [3, 3]);
      const seen = points(r.measured, frame), chain = points(r.chain, frame);
      if (seen.length > 1) b.line([base, ...seen], paint("measured"), 9);
      b.line(chain, paint("tip"), 2.2);
      b.dots(chain.slice(1, -1), paint("tip"), 3, paint("paper"));
      b.dots(seen, paint("paper"), 4.5, paint("measured"));
      b.dots([chain[chain.length - 1]], paint("tip"), 3);
    } };
  }

  // ---- plots in time ---------------------------------------------------------------------------------------------
  function stationSeries(r, c) {
    const on = [...r.stationsOn].sort((a, b) => a - b), out = [], bands = [];
    const few = r.t.length <= 120;
    for (const s of on) {
      if (r.band && r.stationsOn.size <= 3) {
        bands.push([out.length, out.length + 1]);
        for (const k of [1, 0]) {
          out.push({ label: "band", values: column(r.band[k], width * s + c), colour: () => paint("edge"), width: 0.6 });
        }
      }
    }
    for (const s of on) {
      out.push({ label: `${r.stations[s]} measured`, values: column(r.measured, width * s + c), width: 4.5,
        colour: () => paint("measured"), points: few ? 6 : 0 });
    }
    for (const s of on) {
      out.push({ label: `${r.stations[s]} modelled`, values: column(r.modelled, width * s + c), width: 1.6,
        colour: tone(r, s), tag: r.stations[s] });
    }
    for (const s of r.plain ? on : []) {
      out.push({ label: `${r.stations[s]} plain map`, values: column(r.plain, width * s + c), width: 1.5,
        colour: () => paint("accent"), dash: [1.5, 3] });
    }
    return { series: out, bands };
  }

  function residuals(r) {
    const out = [];
    for (const s of [...r.stationsOn].sort((a, b) => a - b)) {
      for (const c of axes.keys()) {
        const [a, b] = [column(r.modelled, width * s + c), column(r.measured, width * s + c)];
        out.push({ label: `${r.stations[s]} ${axes[c]}`, width: 1.3, colour: tone(r, s), dash: DASHES[c],
          values: a.map((v, i) => (v === null || b[i] === null ? null : v - b[i])) });
      }
    }
    return out;
  }

  function inputs(r) {
    const out = r.traces.map((p) => ({ label: p.name, values: column(p.value, 0), width: 4.5,
      colour: () => paint("measured") }));
    const chambers = r.valve.shape[1], [behind, each] = r.input === "pressure" ? ["behind the valve", "chamber"] : ["behind the lag", "input"];
    for (let c = 0; c < chambers; c++) {
      out.push({ label: chambers > 1 ? `${behind}, ${each} ${c + 1}` : `${behind}, modelled`, width: 1.6,
        values: column(r.valve, c), colour: () => ramp(chambers > 1 ? c / (chambers - 1) : 1),
        tag: chambers > 1 ? r.driven[c] || `${each} ${c + 1}` : "" });
    }
    return out;
  }

  function inTime(r) {
    plots.forEach((u) => { all.splice(all.indexOf(u), 1); u.destroy(); });
    plots = [];
    const add = (host, o) => {
      $(host).replaceChildren();
      const u = plot($(host), { x: r.t, zoomed, room: true, ...o });
      u.over.addEventListener("mousemove", (e) => {
        stop();
        go(u.posToIdx(e.clientX - u.over.getBoundingClientRect().left));
      });
      u.over.addEventListener("mouseleave", () => go(frame));
      plots.push(u);
      all.push(u);
    };
    axes.forEach((axis, c) => add(`plot-${axis}`, { ...stationSeries(r, c), ylabel: `${axis} (${unit})` }));
    add("plot-residual", { series: residuals(r), ylabel: `residual (${unit})`, height: 140,
      xlabel: r.kind === "release" ? "time (s)" : "" });
    if ($("length")) $("length").hidden = !r.grown;
    if (r.grown) {
      const [seen, says] = r.grown.map((a) => column(a, 0));
      add("plot-length", { ylabel: "lengthened (mm)", height: 140, series: [
        { label: "measured", values: seen, width: 4.5, colour: () => paint("measured") },
        { label: "modelled", values: says, width: 1.6, colour: () => ramp(1) }] });
    }
    $("pressure").hidden = r.kind === "release";
    if (r.kind !== "release") {
      const marks = r.level && !r.traces.length ? [{ at: r.level, text: `nominal ${digits(r.level)} ${r.unit}` }] : [];
      add("plot-pressure", { series: inputs(r), ylabel: `${r.input} (${r.unit})`, height: 140, marks, xlabel: "time (s)" });
    }
  }

  function zoomed(from) {
    if (zooming) return;
    zooming = true;
    const { min, max } = from.scales.x;
    for (const u of plots) if (u !== from) u.setScale("x", { min, max });
    zooming = false;
    requestAnimationFrame(() => go(frame));
  }

  function zoom(factor) {
    const { min, max } = plots[0].scales.x, t = now.t[frame], ends = [now.t[0], now.t[now.t.length - 1]];
    const low = factor ? Math.max(ends[0], t - factor * (t - min)) : ends[0];
    const high = factor ? Math.min(ends[1], t + factor * (max - t)) : ends[1];
    if (high - low > 4 * (ends[1] - ends[0]) / now.t.length) plots[0].setScale("x", { min: low, max: high });
  }

  function correlation(r) {
    const values = axes.map((_, c) => column(r.correlation, c)), lowest = Math.min(-1.5 * r.white, ...values.flat());
    const u = plot($("plot-correlation"), { x: r.lag, height: 170, xlabel: "lag (s)", ylabel: "correlation",
      range: [lowest - 0.05, 1.05], marks: [{ low: -r.white, at: r.white }],
      series: axes.map((axis, c) => ({ label: axis, values: values[c], width: 1.5, dash: DASHES[c],
        colour: () => paint("tip") })) });
    all.push(u);
    return u;
  }

  // ---- the clock -------------------------------------------------------------------------------------------------
  function go(index) {
    frame = Math.max(0, Math.min(now.t.length - 1, index));
    const t = now.t[frame], slider = $("time");
    slider.value = frame;
    slider.setAttribute("aria-valuetext", `${t.toFixed(2)} s`);
    body.draw();
    for (const u of plots) u.setCursor({ left: u.valToPos(t, "x"), top: 0 }, false);
    readout(t);
  }

  function readout(t) {
    const r = now, cell = (text) => { const td = document.createElement("td"); td.textContent = text; return td; };
    $("clock").textContent = `${t.toFixed(3)} s`;
    const valve = column(r.valve, 0)[frame], several = r.valve.shape[1] > 1;
    $("kpa").textContent = r.kind === "release" || several ? "" : digits(valve, r.unit.split(", ")[0]);
    $("values").replaceChildren(...[...r.stationsOn].sort((a, b) => a - b).map((s) => {
      const row = document.createElement("tr"), head = document.createElement("th");
      head.scope = "row";
      head.textContent = r.stations[s];
      const [seen, says] = [points(r.measured, frame)[s], points(r.modelled, frame)[s]];
      row.append(head, ...axes.flatMap((_, c) => [cell(mm(seen[c])), cell(mm(says[c]))]),
        cell(mm(width === 1 ? says[0] - seen[0] : Math.hypot(...says.map((v, c) => v - seen[c])))));
      return row;
    }));
  }

  function stop() {
    cancelAnimationFrame(playing);
    playing = 0;
    $("play").textContent = "Play";
  }

  function play() {
    if (playing) { stop(); return; }
    if (frame >= now.t.length - 1) go(0);
    $("play").textContent = "Pause";
    let before = performance.now(), t = now.t[frame];
    const tick = (clock) => {
      t += (clock - before) / 1000 * Number($("speed").value);
      before = clock;
      let k = frame;
      while (k < now.t.length - 1 && now.t[k + 1] <= t) k++;
      if (k !== frame) go(k);
      if (k >= now.t.length - 1) { stop(); return; }
      playing = requestAnimationFrame(tick);
    };
    playing = requestAnimationFrame(tick);
  }

  // ---- which record ----------------------------------------------------------------------------------------------
  let lags = null;
  function choose(k, name) {
    if (!data.fits[k].records[name]) name = held(k) ?? Object.keys(data.fits[k].records)[0];
    stop();
    now = load(k, name);
    $("fit").value = k;
    fill($("record"), Object.keys(data.fits[k].records).map((n) => [n, n]), name);
    $("time").max = now.t.length - 1;
    $("band-note").textContent = JSON.parse($("bands").textContent)[`${k}:${name}`] ?? "";
    document.querySelectorAll("button[data-fit]").forEach((b) => b.setAttribute("aria-pressed",
      String(Number(b.dataset.fit) === k && b.dataset.record === name)));
    for (const el of document.querySelectorAll(".what")) {
      el.textContent = `${name}, ${now.role === "held_out" ? "held out" : "training"}`;
    }
    chips();
    inTime(now);
    if (lags) { all.splice(all.indexOf(lags), 1); lags.destroy(); }
    $("plot-correlation").replaceChildren();
    lags = correlation(now);
    if (!data.turns) body.show(scene(now));
    const far = column(now.measured, width * (now.stations.length - 1)).map((v) => Math.abs(v ?? 0));
    go(far.indexOf(Math.max(...far)));
  }

  function chips() {
    $("stations").replaceChildren(...now.stations.map((name, s) => {
      const label = document.createElement("label"), box = document.createElement("input");
      box.type = "checkbox";
      box.checked = now.stationsOn.has(s);
      box.addEventListener("change", () => {
        if (box.checked) now.stationsOn.add(s); else now.stationsOn.delete(s);
        if (!now.stationsOn.size) { now.stationsOn.add(s); box.checked = true; }
        inTime(now);
        go(frame);
      });
      label.append(box, ` ${name}`);
      return label;
    }));
  }

  function fill(select, entries, chosen) {
    select.replaceChildren(...entries.map(([value, text]) => {
      const option = document.createElement("option");
      option.value = value;
      option.textContent = text;
      option.selected = value === chosen;
      return option;
    }));
  }

  // ---- the rest of the page --------------------------------------------------------------------------------------
  function shape(s) {
    const error = open(s.error), arc = Array.from(open(s.arc).flat), kappa = open(s.curvature), rest = open(s.rest);
    const share = (i) => (s.orders.length > 1 ? i / (s.orders.length - 1) : 1);
    all.push(plot($("plot-order"), { x: Array.from(open(s.time).flat), height: 240, log: true, xlabel: "time (s)",
      ylabel: "largest error (mm)", marks: s.bound ? [{ at: s.bound, text: `bound ${s.bound} mm` }] : [],
      series: s.orders.map((n, i) => ({ label: `n = ${n}`, values: column(error, i).map((v) => (v > 0 ? v : null)),
        colour: () => ramp(share(i)), width: n === s.used ? 2.4 : 1.2, tag: `n = ${n}` })) }));
    const fan = [];
    for (let k = 0; k < kappa.shape[1]; k++) {
      fan.push({ label: "", values: column(kappa, k), colour: () => paint("measured"), width: 0.7 });
    }
    fan.push({ label: "rest", values: column(rest, 0), colour: () => paint("accent"), width: 3, tag: "rest" });
    all.push(plot($("plot-fan"), { x: arc, height: 240, series: fan, xlabel: "arc length (mm)", ylabel: "curvature (1/m)" }));
  }

  function torque(law) {
    const series = [];
    law.laws.forEach((one, i) => {
      const values = column(open(one.value), 0), colour = () => ramp(law.laws.length > 1 ? 1 - i / (law.laws.length - 1) : 1);
      const only = (role) => values.map((v, k) => (one.marks[k] === role ? v : null));
      series.push({ label: one.title, values, colour, width: 1.6 });
      const swatch = document.createElement("span"), name = document.createElement("span");
      swatch.className = "swatch modelled";
      swatch.style.borderColor = colour();
      name.textContent = ` ${one.title} `;
      $("key-torque").append(swatch, name);
      series.push({ label: "training", values: only("train"), colour, points: 9 });
      series.push({ label: "held out", values: only("held_out"), colour, points: 9, fill: () => paint("paper") });
    });
    all.push(plot($("plot-torque"), { x: Array.from(open(law.pressure).flat), height: 260, series,
      xlabel: "gauge pressure (kPa)", ylabel: "torque (mN m)" }));
  }

  function forecast(f, i) {
    const tip = open(f.tip), band = f.band?.map(open), x = Array.from(open(f.time).flat);
    axes.forEach((axis, c) => {
      const series = band ? [1, 0].map((k) => ({ label: "band", values: column(band[k], c), width: 0.6,
        colour: () => paint("edge") })) : [];
      const bands = band ? [[0, 1]] : [];
      series.push({ label: "predicted", values: column(tip, c), colour: () => paint("tip"), width: 1.6 });
      all.push(plot($(`plot-forecast-${i}-${axis}`), { x, series, bands, ylabel: `tip ${axis} (${unit})`,
        xlabel: c === width - 1 ? "time (s)" : "" }));
    });
  }

  function clocks(c, i) {
    const draw = (note, label, colour, width, dash) => ({ label, values: column(open(note), 0), width, dash,
      colour: () => paint(colour), tag: label });
    all.push(plot($(`plot-clock-${i}`), { x: Array.from(open(c.time).flat), height: 180, ylabel: "fraction of range",
      xlabel: "time on the shape's clock (s)", series: [draw(c.motion, "motion", "measured", 4.5),
        draw(c.moved, "moved", "tip", 1.6), draw(c.logged, "as logged", "soft", 1.2, [2, 4])] }));
  }

  let dragged = null; // where a drag that turns a body in space was last
  body.canvas.addEventListener("pointerdown", (e) => {
    if (!body.inSpace) return;
    dragged = [e.clientX, e.clientY];
    body.canvas.setPointerCapture(e.pointerId);
  });
  body.canvas.addEventListener("pointermove", (e) => {
    if (!dragged) return;
    body.turn(e.clientX - dragged[0], e.clientY - dragged[1]);
    dragged = [e.clientX, e.clientY];
  });
  for (const name of ["pointerup", "pointercancel"]) body.canvas.addEventListener(name, () => { dragged = null; });

  const repaint = () => { all.forEach((u) => u.redraw(false, true)); body.draw(); };
  const fit = () => { // to the widths that the page has now: a printed page is laid out after the last chance to draw
    for (const u of all) {
      const width = u.root.parentElement.clientWidth;
      if (width && width !== u.width) u.setSize({ width, height: u.height });
    }
    repaint();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  addEventListener("beforeprint", () => { document.documentElement.classList.add("print"); fit(); });
  addEventListener("afterprint", () => { document.documentElement.classList.remove("print"); fit(); });
  fill($("fit"), data.fits.map((f, k) => [k, f.title]), 0);
  $("fit").addEventListener("change", () => choose(Number($("fit").value), now.name));
  $("record").addEventListener("change", () => choose(now.k, $("record").value));
  $("time").addEventListener("input", () => { stop(); go(Number($("time").value)); });
  $("play").addEventListener("click", play);
  $("closer").addEventListener("click", () => zoom(0.5));
  $("wider").addEventListener("click", () => zoom(2));
  $("whole").addEventListener("click", () => zoom(0));
  document.querySelectorAll("button[data-fit]").forEach((b) =>
    b.addEventListener("click", () => choose(Number(b.dataset.fit), b.dataset.record)));
  choose(0, held(0) ?? names[0]);
  if (data.shape) shape(data.shape);
  if (data.torque) torque(data.torque);
  data.forecasts.forEach(forecast);
  data.clocks.forEach(clocks);
  document.documentElement.dataset.ready = "yes";
  window.pliantReport = { choose, go, get frame() { return frame; }, get now() { return now; }, get plots() { return plots; }, body };
})();
