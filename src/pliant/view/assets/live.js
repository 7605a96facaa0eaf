"use strict";
// The live page: what the model does now, and what the hand, the sliders and a recording ask of it.
(() => {
  const { Body, digits, paint, plot, ramp } = Pliant;
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("data").textContent), KEPT = 10, MOST = 650, HELD = 500;
  const body = new Body($("body")), L = data.length;
  const socket = new WebSocket(`${location.href.replace(/^http/, "ws")}live`);
  const roll = { t: [], series: [] }; // of the last ten seconds, whatever the speed
  const touched = []; // mm, where a loop's body was touched
  let untouched = true; // until a person moves, pulls or chooses something
  let now = null, pull = null, turning = null, drawn = 0, counted = performance.now(), frames = 0;
  const ask = (wish) => socket.readyState === 1 && socket.send(JSON.stringify(wish));

  function slider(host, label, o, act) {
    const row = document.createElement("label"), range = document.createElement("input"), out = document.createElement("output");
    row.className = "wide";
    range.type = "range";
    Object.assign(range, { min: o.low, max: o.high, step: o.step ?? (o.high - o.low) / 400, value: o.value });
    const write = (value) => { out.textContent = `${(o.step ? value.toFixed(1) : value.toPrecision(4)).replace("-", "−")} ${o.unit}`; };
    const tell = () => write(Number(range.value));
    let moved = -Infinity; // ms, when the hand moved it last
    range.addEventListener("input", () => { moved = performance.now(); untouched = false; tell(); act(Number(range.value)); });
    range.follow = (value) => { // what the model has, unless a hand is at the slider
      if (performance.now() - moved < HELD) return false;
      range.value = value;
      write(value);
      return true;
    };
    tell();
    row.append(`${label} `, out, range);
    host.append(row);
    return range;
  }

  const kpa = Array(data.chambers.length).fill(0), several = data.chambers.length > 1;
  const levels = kpa.map((_, c) => slider($("pressures"), several && data.units[c] === "kPa" ? `pressure, ${data.chambers[c]}` : data.chambers[c],
    { low: data.lowest[c], high: data.highest[c], value: 0, unit: data.units[c], step: data.units[c] === "kPa" ? 1 : undefined }, (v) => { kpa[c] = v; ask({ pressure_kpa: kpa }); }));
  const gravity = [...data.gravity];
  const axes = [..."xyz"].slice(0, gravity.length), DASHES = [undefined, [6, 4], [1.5, 3]];
  axes.forEach((name, c) => slider($("numbers"), `gravity ${name}`, { low: -10, high: 10, value: gravity[c],
    unit: "m/s²" }, (v) => { gravity[c] = v; ask({ gravity }); }));
  for (const s of data.sliders) slider($("numbers"), s.name, s, (v) => ask({ parameters: { [s.name]: v } }));
  for (const name of data.records) $("record").append(new Option(name, name));
  if (data.watched) {
    $("summary").hidden = true;
    $("drag").textContent = "from the loop's log";
  }
  $("recording").hidden = !data.records.length;
  $("record").addEventListener("change", () => { untouched = false; ask({ record: $("record").value || null }); });
  $("speed").addEventListener("change", () => ask({ speed: Number($("speed").value) }));
  $("reset").addEventListener("click", () => ask({ reset: true }));

  const plane = gravity.length === 2, base = axes.map(() => 0);
  const low = plane ? [-1.15 * L, -0.45 * L] : [-0.7 * L, -0.7 * L, -0.4 * L], high = plane ? [1.15 * L, 1.15 * L] : [0.7 * L, 0.7 * L, L];
  if (!plane) $("drag").textContent = "drag it anywhere; drag beside it to turn";
  body.show({ low, high, paint: (b) => {
    if (!now) return;
    if (now.measured) {
      const seen = now.measured.filter((p) => p[0] !== null);
      if (seen.length > 1) b.line([base, ...seen], paint("measured"), 9);
      b.dots(seen, paint("paper"), 4.5, paint("measured"));
    }
    b.line(now.body, paint("tip"), 3);
    b.dots(now.body.slice(1), paint("tip"), 3.5, paint("paper"));
    b.dots(touched, paint("accent"), 2);
    if (now.touch) {
      const [x, y, fx, fy] = now.touch, k = Math.min(0.3 * L, 0.5 * L * Math.hypot(fx, fy)) / (Math.hypot(fx, fy) || 1);
      b.line([[x - k * fx, y - k * fy], [x, y]], paint("accent"), 3);
      b.dots([[x, y]], paint("accent"), 5);
    }
    if (pull) {
      const held = point(pull);
      b.line([held, hand3(pull)], paint("accent"), 1.6, [4, 3]);
      b.dots([held], paint("accent"), 5);
    }
  } });

  const hand3 = (p) => (plane ? [p.x_mm, p.y_mm] : [p.x_mm, p.y_mm, p.z_mm]);
  const point = (p) => base.map((_, c) => now.body[p.link + 1][c] + p.share * (now.body[p.link + 2][c] - now.body[p.link + 1][c]));
  const hand = (e) => {
    const box = body.canvas.getBoundingClientRect();
    return body.from(e.clientX - box.left, e.clientY - box.top);
  };

  // The hand at a place of the view, in space as far from the viewer as what it holds.
  function drawn_to(held, place) {
    const at = body.beside(point(held), place);
    return { ...held, x_mm: at[0], y_mm: at[1], ...(plane ? {} : { z_mm: at[2] }) };
  }

  function grasp([x, y]) {
    let best = { gap: Infinity };
    for (let link = 0; link < data.links; link++) {
      const [a, b] = [body.flat(now.body[link + 1]), body.flat(now.body[link + 2])], d = [b[0] - a[0], b[1] - a[1]];
      const share = Math.max(0, Math.min(1, ((x - a[0]) * d[0] + (y - a[1]) * d[1]) / (d[0] ** 2 + d[1] ** 2 || 1)));
      const gap = Math.hypot(a[0] + share * d[0] - x, a[1] + share * d[1] - y);
      if (gap < best.gap) best = { gap, link, share };
    }
    return best.gap < (plane ? 0.2 : 0.08) * L ? drawn_to({ link: best.link, share: best.share }, [x, y]) : null;
  }

  body.canvas.addEventListener("pointerdown", (e) => {
    if (!now) return;
    pull = data.watched ? null : grasp(hand(e));
    if (!pull && plane) return;
    body.canvas.setPointerCapture(e.pointerId);
    if (!pull) { turning = [e.clientX, e.clientY]; return; }
    untouched = false;
    ask({ pull });
  });
  body.canvas.addEventListener("pointermove", (e) => {
    if (turning) {
      body.turn(e.clientX - turning[0], e.clientY - turning[1]);
      turning = [e.clientX, e.clientY];
    }
    if (!pull) return;
    pull = drawn_to({ link: pull.link, share: pull.share }, hand(e));
    ask({ pull });
  });
  for (const name of ["pointerup", "pointercancel"]) {
    body.canvas.addEventListener(name, () => {
      if (!turning) ask({ pull: null });
      pull = turning = null;
    });
  }

  const empty = (n) => Array.from({ length: n }, () => []);
  const CURVES = 2 * axes.length; // x, y (and z) measured, then modelled
  roll.series = empty(CURVES + data.chambers.length);
  const tip = plot($("plot-tip"), { x: [], height: 220, ylabel: "tip (mm)", series: [
    ...axes.map(() => ({ label: "measured", values: [], width: 4, colour: () => paint("measured") })),
    ...axes.map((axis, c) => ({ label: axis, values: [], colour: () => paint("tip"), dash: DASHES[c], tag: axis }))] });
  const chambers = plot($("plot-pressure"), { x: [], height: 150, ylabel: data.units.every((u) => u === "kPa") ? "pressure (kPa)" : `input (${[...new Set(data.units)].join(", ")})`, xlabel: "time (s)",
    room: true, series: kpa.map((_, c) => ({ label: data.chambers[c], values: [], width: 1.6,
      colour: () => ramp(several ? c / (kpa.length - 1) : 1), tag: several ? data.chambers[c] : "" })) });

  function keep(f) {
    if (roll.t.length && f.t < roll.t[roll.t.length - 1]) {
      roll.t = [];
      roll.series = empty(CURVES + data.chambers.length);
    }
    if (f.t === roll.t[roll.t.length - 1]) return;
    roll.t.push(f.t);
    const seen = f.measured ? f.measured[f.measured.length - 1] : axes.map(() => null);
    [...seen, ...f.body[f.body.length - 1], ...f.kpa].forEach((v, i) => roll.series[i].push(v));
    while (roll.t[0] < f.t - KEPT || roll.t.length > MOST) {
      roll.t.shift();
      roll.series.forEach((s) => s.shift());
    }
  }

  // The page begins with a pulse, so that the body moves before anything is touched.
  const PULSE = [0.4, 1500, 2500]; // of the highest pressure; ms of the pulse, and until the next
  function pulse(left) {
    const send = (share) => { if (untouched) ask({ pressure_kpa: kpa.map((_, c) => (c ? 0 : (data.units[0] === "kPa" ? Math.round : Number)(share * data.highest[0]))) }); };
    send(PULSE[0]);
    setTimeout(() => { send(0); if (left > 1 && untouched) setTimeout(() => pulse(left - 1), PULSE[2]); }, PULSE[1]);
  }

  socket.addEventListener("open", () => {
    $("message").textContent = "The model steps a thousand times a second.";
    if (!data.watched && !matchMedia("(prefers-reduced-motion: reduce)").matches) pulse(2);
  });
  socket.addEventListener("close", () => { $("message").textContent = "The program behind this page has ended."; });
  socket.addEventListener("message", (e) => {
    now = JSON.parse(e.data);
    frames += 1;
    if (now.message) $("message").textContent = now.message;
    if (now.touch) touched.push(now.touch.slice(0, 2));
    if (touched.length > MOST) touched.shift();
    keep(now);
    if (!data.watched) levels.forEach((level, c) => { if (level.follow(now.command[c])) kpa[c] = now.command[c]; });
  });

  function tick(clock) {
    requestAnimationFrame(tick);
    if (!now || drawn === now.t && !pull) return;
    drawn = now.t;
    body.draw();
    tip.setData([roll.t, ...roll.series.slice(0, CURVES)]);
    chambers.setData([roll.t, ...roll.series.slice(CURVES)]);
    $("clock").textContent = `${now.t.toFixed(2)} s`;
    const force = Math.hypot(...(now.touch ? now.touch.slice(2) : now.force));
    $("force").textContent = force ? `${now.touch ? "touched with" : "pull"} ${digits(force, "N")}` : "";
    if (clock - counted > 1000) {
      $("rate").textContent = `${Math.round(1000 * frames / (clock - counted))} frames/s`;
      counted = clock;
      frames = 0;
    }
  }
  requestAnimationFrame(tick);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { body.draw(); tip.redraw(); chambers.redraw(); });
  window.pliantLive = { ask: (wish) => { untouched = false; ask(wish); }, keep, get now() { return now; }, roll, body };
})();
