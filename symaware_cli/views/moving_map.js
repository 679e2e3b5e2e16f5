"use strict";
// Plays the motion of bodies on a canvas, from above. `data` is made by moving_map.py; values are shared by all frames.
function movingMap(root, data) {
  const canvas = root.querySelector("canvas"), context = canvas.getContext("2d");
  const slider = root.querySelector("input[type=range]"), button = root.querySelector("button");
  const label = root.querySelector("output"), speed = root.querySelector("select");
  const names = root.querySelector("input[type=checkbox]");
  const times = data.times, last = times.length - 1;
  let frame = 0, playing = false, before = 0, clock = times[0];

  function view() {
    const width = canvas.clientWidth, ratio = window.devicePixelRatio || 1;
    const [x0, y0, x1, y1] = data.box;
    const scale = Math.min(width / (x1 - x0), 560 / (y1 - y0)), height = (y1 - y0) * scale;
    canvas.style.height = height + "px";
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const left = (width - (x1 - x0) * scale) / 2;
    return { scale, place: (x, y) => [left + (x - x0) * scale, (y1 - y) * scale] };
  }
  function outline(look, points, x, y, heading) {
    const c = Math.cos(heading), s = Math.sin(heading);
    context.beginPath();
    for (const [a, b] of points) context.lineTo(...look.place(x + c * a - s * b, y + s * a + c * b));
    context.closePath();
  }
  function draw() {
    const look = view();
    context.clearRect(0, 0, canvas.width, canvas.height);
    for (const area of data.solids) {
      const k = Math.min(frame, area.x.length - 1);
      context.fillStyle = area.colour;
      context.globalAlpha = area.region ? 0.18 : 0.75;
      for (const points of area.outlines) { outline(look, points, area.x[k], area.y[k], area.heading[k]); context.fill(); }
      context.globalAlpha = 1;
      if (area.region && area.name) {
        context.fillStyle = "#566072";
        context.font = "13px system-ui";
        context.textAlign = "center";
        context.fillText(area.name, ...look.place(area.x[k], area.y[k]));
      }
    }
    const since = times[frame] - data.trail;
    for (const agent of data.agents) {
      const x = agent.x[frame], y = agent.y[frame];
      context.strokeStyle = context.fillStyle = agent.colour;
      context.lineWidth = 1.5;
      for (const [gx, gy] of agent.goals) {
        const [u, v] = look.place(gx, gy);
        context.beginPath();
        context.moveTo(u - 4, v - 4); context.lineTo(u + 4, v + 4);
        context.moveTo(u - 4, v + 4); context.lineTo(u + 4, v - 4);
        context.stroke();
      }
      context.globalAlpha = 0.55;
      for (const [wx, wy] of agent.waypoints) {
        const [u, v] = look.place(wx, wy);
        context.fillRect(u - 1, v - 1, 2, 2);
      }
      context.beginPath();
      for (let k = frame; k >= 0 && times[k] >= since; k--) {
        if (agent.x[k] !== null) context.lineTo(...look.place(agent.x[k], agent.y[k]));
      }
      context.stroke();
      context.globalAlpha = 1;
      if (x === null) continue;
      for (const points of agent.outlines) { outline(look, points, x, y, agent.heading[frame]); context.fill(); }
      const [u, v] = look.place(x, y);
      if (!agent.outlines.length) { context.beginPath(); context.arc(u, v, 4, 0, 7); context.fill(); }
      if (agent.nosed) {
        const reach = Math.max(agent.reach, 5 / look.scale), h = agent.heading[frame];
        context.strokeStyle = "#fff";
        context.lineWidth = 2;
        context.beginPath();
        context.moveTo(u, v);
        context.lineTo(...look.place(x + reach * Math.cos(h), y + reach * Math.sin(h)));
        context.stroke();
      }
      if (names.checked) {
        context.fillStyle = "#1d2430";
        context.font = "13px system-ui";
        context.textAlign = "left";
        context.fillText(agent.name, u + Math.max(6, agent.reach * look.scale + 3), v - 5);
      }
    }
    for (const mark of data.marks) {
      const age = times[frame] - mark.time;
      if (age < 0 || age > 1 || mark.x === null) continue;
      context.strokeStyle = "#c2281d";
      context.lineWidth = 2;
      context.beginPath();
      context.arc(...look.place(mark.x, mark.y), 8 + 14 * age, 0, 7);
      context.stroke();
    }
    slider.value = frame;
    label.textContent = times[frame].toFixed(2) + " s";
  }
  function step(now) {
    if (!playing) return;
    clock += Math.min(0.1, (now - before) / 1000) * Number(speed.value);
    before = now;
    while (frame < last && times[frame + 1] <= clock) frame++;
    draw();
    if (frame === last) { playing = false; button.textContent = "Play"; return; }
    requestAnimationFrame(step);
  }
  function show(k) { frame = Math.max(0, Math.min(last, k)); clock = times[frame]; draw(); }
  button.onclick = () => {
    playing = !playing;
    button.textContent = playing ? "Pause" : "Play";
    if (playing && frame === last) show(0);
    before = performance.now();
    if (playing) requestAnimationFrame(step);
  };
  slider.max = last;
  slider.oninput = () => show(Number(slider.value));
  names.onchange = draw;
  for (const link of root.querySelectorAll("[data-time]")) {
    link.onclick = () => show(times.findIndex((time) => time >= Number(link.dataset.time) - 1e-9));
  }
  window.addEventListener("resize", draw);
  show(data.first);
}
