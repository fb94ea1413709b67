"use strict";
const EVERY = 2000; // ms
const PLOT = { width: 640, height: 200, left: 64, right: 12, top: 10, bottom: 34 };
const cards = new Map();

function element(kind, parent, name = "", text = "") {
  const svg = ["svg", "path", "text", "line", "circle", "rect", "title"].includes(kind);
  const made = svg ? document.createElementNS("http://www.w3.org/2000/svg", kind) : document.createElement(kind);
  if (name) made.setAttribute("class", name);
  made.textContent = text;
  parent.append(made);
  return made;
}

const digits = (value) => (value === null ? "none" : Number(value.toPrecision(4)).toString());

function spoken(seconds) {
  if (seconds < 90) return `${Math.round(seconds)} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
}

// Round numbers from lowest to highest, about four.
function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((digit) => digit * power >= rough);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + 1e-9 * step; at += step) found.push(Number(at.toPrecision(12)));
  return found;
}

function curve(svg, run) {
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${PLOT.width} ${PLOT.height}`);
  const dots = run.curve.filter(([, best]) => best !== null);
  const values = dots.flatMap(([, best, mean]) => (mean === null ? [best] : [best, mean]));
  if (!values.length) return;
  let low = Math.min(...values), high = Math.max(...values);
  if (low === high) [low, high] = [low - (Math.abs(low) || 1) / 2, high + (Math.abs(high) || 1) / 2];
  const last = Math.max(run.curve.at(-1)[0], 1);
  const x = (at) => PLOT.left + at / last * (PLOT.width - PLOT.left - PLOT.right);
  const y = (at) => PLOT.height - PLOT.bottom - (at - low) / (high - low) * (PLOT.height - PLOT.top - PLOT.bottom);
  for (const at of ticks(low, high)) {
    const line = element("line", svg, "grid");
    for (const [name, value] of Object.entries({ x1: PLOT.left, x2: PLOT.width - PLOT.right, y1: y(at), y2: y(at) })) {
      line.setAttribute(name, value);
    }
    const label = element("text", svg, "up", digits(at));
    label.setAttribute("x", PLOT.left - 8);
    label.setAttribute("y", y(at) + 4);
  }
  for (const at of ticks(0, last)) {
    const label = element("text", svg, "along", digits(at));
    label.setAttribute("x", x(at));
    label.setAttribute("y", PLOT.height - 18);
  }
  const about = element("text", svg, "along", "evaluations");
  about.setAttribute("x", (PLOT.left + PLOT.width - PLOT.right) / 2);
  about.setAttribute("y", PLOT.height - 3);
  const way = (column) => dots.filter((dot) => dot[column] !== null).map((dot) => `${x(dot[0])},${y(dot[column])}`);
  for (const [column, name] of [[2, "mean"], [1, "best"]]) {
    const points = way(column);
    if (!points.length) continue;
    element("path", svg, name).setAttribute("d", `M${points.join("L")}`);
    const [cx, cy] = points.at(-1).split(",");
    const end = element("circle", svg, name);
    for (const [key, value] of Object.entries({ cx, cy, r: 3 })) end.setAttribute(key, value);
  }
}

function card(run) {
  const root = element("section", document.getElementById("runs"), "run");
  const found = { root, head: element("h2", root), tiles: element("dl", root, "tiles"), said: element("p", root, "note") };
  const figure = element("figure", root);
  found.curve = element("svg", figure);
  found.curve.setAttribute("role", "img");
  found.key = element("figcaption", figure);
  found.map = element("figure", root, "map");
  found.button = element("button", root, "", "show the best design in motion");
  found.button.type = "button";
  found.button.onclick = () => see(run.folder, "");
  return found;
}

function fill(found, run) {
  found.head.textContent = run.folder;
  const damaged = run.state === "damaged";
  found.said.textContent = damaged ? run.reason : "";
  found.said.hidden = !damaged;
  for (const part of ["tiles", "curve", "key", "button"]) found[part].toggleAttribute("hidden", damaged);
  if (damaged) return;
  const { score } = run, best = run.best === null ? "none" : `${digits(run.best)} ${score.unit}`.trim();
  const left = run.state === "running" && run.seconds_left ? `${spoken(run.seconds_left)} left` : "";
  const rows = [
    [`best ${score.name}`, best],
    ["generation", `${run.generation ?? "none"} of ${run.generations}`],
    ["evaluations", run.failed ? `${run.evaluations} (${run.failed} failed)` : `${run.evaluations}`],
    ["method", run.method],
    ["state", left ? `${run.state}, ${left}` : run.state],
  ];
  found.tiles.replaceChildren();
  for (const [name, value] of rows) {
    const tile = element("div", found.tiles);
    element("dt", tile, "", name);
    element("dd", tile, "", value);
  }
  found.button.disabled = run.best === null;
  if (found.drawn !== run.generation && run.best !== null) {
    found.drawn = run.generation;
    keep(found, run);
  }
  curve(found.curve, run);
  found.curve.setAttribute("aria-label", `${score.name} over evaluations; the best so far is ${best}`);
  const unit = score.unit ? ` [${score.unit}]` : "";
  found.key.textContent = `${score.name}${unit}: the best in blue, the mean of what the search keeps in grey`;
}

// Colours from dark blue to yellow, for scores from the lowest to the highest.
function colour(part) {
  const ends = ["#2b2f77", "#00899c", "#f2d349"], place = 2 * Math.min(Math.max(part, 0), 1), first = place < 1 ? 0 : 1;
  return `color-mix(in oklab, ${ends[first + 1]} ${100 * (place - first)}%, ${ends[first]})`;
}

// What a front or a map of elites keeps: a press on a design shows it in motion.
async function keep(found, run) {
  const answer = await fetch(`kept.json?run=${encodeURIComponent(run.folder)}`);
  const kept = answer.ok ? await answer.json() : {};
  found.map.replaceChildren();
  found.map.hidden = !kept.members;
  if (!kept.members) return;
  const svg = element("svg", found.map), { width, left, right, top } = PLOT, height = 320, bottom = PLOT.bottom + 6;
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const elites = kept.kind === "elites", flat = kept.axes.length < 2;
  const range = (axis) => {
    const values = kept.members.map((member) => member[axis]);
    const [low, high] = [Math.min(...values), Math.max(...values)], room = (high - low || 1) / 20;
    return { low: low - room, high: high + room };
  };
  const ends = [0, 1].map((n) => (elites ? kept.axes[n] ?? { low: 0, high: 1 } : range(n)));
  const part = (n, value) => (elites ? value / (n === 1 && flat ? 1 : kept.bins) : (value - ends[n].low) / (ends[n].high - ends[n].low));
  const x = (p) => left + p * (width - left - right), y = (p) => height - bottom - p * (height - top - bottom);
  const label = (name, text, at, up) => {
    const made = element("text", svg, name, text);
    made.setAttribute("x", at);
    made.setAttribute("y", up);
  };
  ends.forEach(({ low, high }, n) => {
    if (n === 1 && flat) return;
    for (const at of ticks(low, high)) {
      const p = (at - low) / (high - low);
      if (n) label("up", digits(at), left - 8, y(p) + 4);
      else label("along", digits(at), x(p), height - 24);
    }
  });
  const scores = kept.members.map((member) => member[2]), low = Math.min(...scores), high = Math.max(...scores);
  for (const [along, up, score, member] of kept.members) {
    const mark = element(elites ? "rect" : "circle", svg, "member");
    const [px, py] = [part(0, along), part(1, up)];
    const places = elites
      ? { x: x(px), y: y(py + (flat ? 1 : 1 / kept.bins)), width: x(1 / kept.bins) - x(0), height: flat ? y(0) - y(1) : y(0) - y(1 / kept.bins) }
      : { cx: x(px), cy: y(py), r: 6 };
    const score01 = high > low ? (score - low) / (high - low) : 1;
    const said = `member ${member}: ${run.score.name} ${digits(score)} ${run.score.unit}`.trim();
    const all = { ...places, fill: colour(score01), tabindex: 0, role: "button", "aria-label": said };
    for (const [name, value] of Object.entries(all)) mark.setAttribute(name, value);
    element("title", mark, "", said);
    mark.onclick = () => see(run.folder, member);
    mark.onkeydown = (event) => { if (event.key === "Enter") see(run.folder, member); };
  }
  label("along", kept.axes[0].name, (left + width - right) / 2, height - 6);
  const above = kept.axes[1] ? `, upwards: ${kept.axes[1].name}` : "";
  const shown = `${run.score.name} from ${digits(low)} (blue) to ${digits(high)} (yellow)`;
  const what = elites ? "The best design of each kind" : "Designs that no other dominates";
  element("figcaption", found.map, "", `${what}; ${shown}${above}. Press one to see it in motion.`);
}

function see(folder, member) {
  const dialog = document.getElementById("seen"), frame = dialog.querySelector("iframe");
  const waits = document.getElementById("waits"), told = member ? `member ${member}` : "the best design";
  waits.textContent = `${told} of ${folder} is simulated …`;
  let look;
  const play = () => {
    const { player } = frame.contentWindow;
    if (player) player.play(true);
    else look = setTimeout(play, 100);
  };
  frame.onload = () => {
    waits.textContent = `${folder}: ${told}`;
    play();
  };
  frame.src = `player?${new URLSearchParams({ run: folder, member })}`;
  dialog.onclose = () => {
    clearTimeout(look);
    frame.onload = null;
    frame.src = "about:blank";
  };
  dialog.showModal();
}

async function look() {
  const said = document.getElementById("said");
  try {
    const answer = await fetch("state.json");
    if (!answer.ok) throw new Error(await answer.text());
    const runs = await answer.json();
    for (const run of runs) {
      if (!cards.has(run.folder)) cards.set(run.folder, card(run));
      fill(cards.get(run.folder), run);
    }
    for (const [folder, { root }] of cards) {
      if (!runs.some((run) => run.folder === folder)) {
        root.remove();
        cards.delete(folder);
      }
    }
    const going = runs.filter((run) => run.state === "running").length;
    said.textContent = `${going} of ${runs.length} running; read at ${new Date().toLocaleTimeString()}`;
    said.className = "";
  } catch (error) {
    said.textContent = error instanceof TypeError ? "morpholab report --watch has ended." : error.message;
    said.className = "note";
  }
  setTimeout(look, EVERY);
}

look();
