"use strict";
// Plays the runs of a diagnosis. The page works without it: still pictures are shown until this script has run.
(() => {
  const root = document.getElementById("animation");
  const data = JSON.parse(document.getElementById("animation-data").textContent);
  const find = (selector) => root.querySelector(selector);
  const play = find(".play"), slider = find(".time"), clock = find(".clock");
  const chosen = find(".run"), speed = find(".speed");
  const calm = window.matchMedia("(prefers-reduced-motion: reduce)");
  const PIECES = 12; // segments of a trail, fading towards its tail
  const CALM_STEP_S = 0.5;

  const actors = data.series.map((name) => ({
    name,
    ghost: find(`.ghost.${name}`),
    marble: find(`.marble.${name}`),
    readout: find(`.off.${name}`),
    trail: makeTrail(find(`.trail.${name}`)),
  }));
  let run, now = 0, playing = false, last = 0;

  function makeTrail(group) {
    return Array.from({ length: PIECES }, (_, i) => {
      const piece = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
      piece.setAttribute("opacity", ((i + 1) / PIECES).toFixed(2));
      return group.appendChild(piece);
    });
  }

  // The last row at or before a time.
  function rowAt(time) {
    let low = 0, high = run.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (run.t[middle] <= time) low = middle; else high = middle - 1;
    }
    return low;
  }

  function placeAt(series, time) {
    const i = rowAt(time), next = Math.min(i + 1, run.t.length - 1);
    const a = series[i], b = series[next];
    if (!a || !b) return a;
    const share = next > i ? Math.min(1, (time - run.t[i]) / (run.t[next] - run.t[i])) : 0;
    return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
  }

  const dots = (places) => places.filter(Boolean).map((p) => `${p[0] * 1000},${-p[1] * 1000}`).join(" ");

  function drawTrail(actor, series) {
    const length = Math.min(2.5, 0.2 * (run.t[run.t.length - 1] - run.t[0]));
    actor.trail.forEach((piece, i) => {
      const from = now - length * (1 - i / PIECES), to = now - length * (1 - (i + 1) / PIECES);
      if (to < run.t[0]) { piece.setAttribute("points", ""); return; }
      const begin = Math.max(from, run.t[0]);
      const between = series.slice(rowAt(begin) + 1, rowAt(to) + 1);
      piece.setAttribute("points", dots([placeAt(series, begin), ...between, placeAt(series, to)]));
    });
  }

  // The mean of |x| and |y|, in percent of the edge, as elsewhere on the page.
  function apart(a, b) {
    return a && b ? `${(50 * (Math.abs(a[0] - b[0]) + Math.abs(a[1] - b[1]))).toFixed(2)} %` : "not seen";
  }

  function draw() {
    const recorded = placeAt(run.recorded, now);
    for (const actor of actors) {
      const place = placeAt(run[actor.name], now);
      actor.marble.style.visibility = place ? "" : "hidden";
      if (place) actor.marble.setAttribute("transform", `translate(${place[0] * 1000} ${-place[1] * 1000})`);
      drawTrail(actor, run[actor.name]);
      if (actor.readout) actor.readout.textContent = apart(place, recorded);
    }
    const row = rowAt(now);
    if (Number(slider.value) !== row) slider.value = row;
    clock.textContent = moment(now, row);
    slider.setAttribute("aria-valuetext", `${clock.textContent} of ${moment(run.t[run.t.length - 1], run.t.length - 1)}`);
  }

  // Without stamps the duration of a row is unknown, so the clock counts rows.
  function moment(time, row) {
    return data.stamped ? `${(time - run.t[0]).toFixed(1)} s` : `row ${run.rows[row]}`;
  }

  function show(number) {
    run = data.runs[number];
    slider.max = run.t.length - 1;
    for (const actor of actors) actor.ghost.setAttribute("points", dots(run[actor.name]));
    now = run.t[0];
    draw();
  }

  function setPlaying(wanted) {
    playing = wanted;
    play.textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    if (now >= run.t[run.t.length - 1]) now = run.t[0];
    last = performance.now();
    requestAnimationFrame(tick);
  }

  function tick(stamp) {
    if (!playing) return;
    const passed = Math.max(0, (stamp - last) / 1000);
    if (!calm.matches || passed >= CALM_STEP_S) {
      last = stamp;
      now = Math.min(now + passed * Number(speed.value), run.t[run.t.length - 1]);
      draw();
      if (now >= run.t[run.t.length - 1]) { setPlaying(false); return; }
    }
    requestAnimationFrame(tick);
  }

  play.addEventListener("click", () => setPlaying(!playing));
  slider.addEventListener("input", () => { setPlaying(false); now = run.t[Number(slider.value)]; draw(); });
  slider.addEventListener("keydown", (event) => {
    if (event.key === " ") { event.preventDefault(); setPlaying(!playing); }
  });
  chosen.addEventListener("change", () => show(Number(chosen.value)));

  find(".player").hidden = false;
  root.classList.add("live");
  show(Number(chosen.value));
  if (calm.matches) {
    now = run.t[run.worst];
    draw();
  } else {
    const watcher = new IntersectionObserver(([entry]) => {
      if (entry.isIntersecting) { watcher.disconnect(); setPlaying(true); }
    }, { threshold: 0.5 });
    watcher.observe(find(".player"));
  }
})();
