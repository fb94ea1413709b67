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

// Ends of an axis that are apart by more than rounding.
function spread(low, high) {
  const size = Math.max(Math.abs(low), Math.abs(high)) || 1;
  return high - low > 1e-6 * size ? [low, high] : [low - size / 2, high + size / 2];
}

// Round numbers from lowest to highest, about four.
function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((digit) => digit * power >= rough * (1 - 1e-9));
  const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(last - first + 1, 0) }, (_, n) => Number(((first + n) * step).toPrecision(12)));
}

function set(made, attributes) {
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

function label(svg, name, text, x, y) {
  set(element("text", svg, name, text), { x, y });
}

function curve(svg, run) {
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${PLOT.width} ${PLOT.height}`);
  const dots = run.curve.filter(([, best]) => best !== null);
  const values = dots.flatMap(([, best, mean]) => (mean === null ? [best] : [best, mean]));
  if (!values.length) return;
  const [low, high] = spread(Math.min(...values), Math.max(...values));
  const last = Math.max(run.curve.at(-1)[0], 1);
  const x = (at) => PLOT.left + at / last * (PLOT.width - PLOT.left - PLOT.right);
  const y = (at) => PLOT.height - PLOT.bottom - (at - low) / (high - low) * (PLOT.height - PLOT.top - PLOT.bottom);
  for (const at of ticks(low, high)) {
    set(element("line", svg, "grid"), { x1: PLOT.left, x2: PLOT.width - PLOT.right, y1: y(at), y2: y(at) });
    label(svg, "up", digits(at), PLOT.left - 8, y(at) + 4);
  }
  for (const at of ticks(0, last)) label(svg, "along", digits(at), x(at), PLOT.height - 18);
  label(svg, "along", "evaluations", (PLOT.left + PLOT.width - PLOT.right) / 2, PLOT.height - 3);
  const way = (column) => dots.filter((dot) => dot[column] !== null).map((dot) => `${x(dot[0])},${y(dot[column])}`);
  for (const [column, name] of [[2, "mean"], [1, "best"]]) {
    const points = way(column);
    if (!points.length) continue;
    element("path", svg, name).setAttribute("d", `M${points.join("L")}`);
    const [cx, cy] = points.at(-1).split(",");
    set(element("circle", svg, name), { cx, cy, r: 3 });
  }
}

function card(run) {
  const root = element("section", document.getElementById("runs"), "run");
  const found = { root, head: element("h2", root), tiles: element("dl", root, "tiles") };
  found.said = element("p", root, "note");
  const figure = element("figure", root);
  found.curve = element("svg", figure);
  found.curve.setAttribute("role", "img");
  found.key = element("figcaption", figure);
  found.map = element("figure", root, "map");
  found.button = element("button", root, "", "show the best design in motion");
  found.button.type = "button";
  found.button.onclick = () => see(run.folder);
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
  if (found.drawn !== run.generation && run.best !== null) keep(found, run);
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

// What a front or a map of elites keeps, if the run has any and is still at the generation that was asked for.
async function keep(found, run) {
  if (found.asking) return;
  found.asking = true;
  try {
    const answer = await fetch(`kept.json?${new URLSearchParams({ run: run.folder })}`);
    if (!answer.ok) return; // it is asked again with the next look
    const kept = await answer.json();
    found.drawn = kept.generation ?? run.generation;
    found.map.hidden = !kept.members;
    if (kept.members) drawKept(found.map, run, kept);
  } catch (error) {
    if (!(error instanceof TypeError)) throw error; // the server has ended, as the next look tells
  } finally {
    found.asking = false;
  }
}

// A press on a design shows it in motion.
function drawKept(figure, run, kept) {
  figure.replaceChildren();
  const svg = element("svg", figure), elites = kept.kind === "elites", height = 320;
  const right = PLOT.width - PLOT.right, bottom = height - PLOT.bottom - 6;
  set(svg, { viewBox: `0 0 ${PLOT.width} ${height}` });
  const axes = [0, 1].map((n) => axisOf(kept, n));
  const x = (value) => PLOT.left + axes[0].part(value) * (right - PLOT.left);
  const y = (value) => bottom - axes[1].part(value) * (bottom - PLOT.top);
  for (const { at, value } of axes[0].marks) label(svg, "along", digits(at), x(value), height - 24);
  for (const { at, value } of axes[1].marks) label(svg, "up", digits(at), PLOT.left - 8, y(value) + 4);
  label(svg, "along", axes[0].name, (PLOT.left + right) / 2, height - 6);
  const scores = kept.members.map((member) => member[2]), low = Math.min(...scores), high = Math.max(...scores);
  for (const [along, up, score, member] of kept.members) {
    const [left, top, width, depth] = [x(along), y(up + 1), x(along + 1) - x(along), y(up) - y(up + 1)];
    const place = elites ? { x: left, y: top, width, height: depth } : { cx: left, cy: y(up), r: 6 };
    const mark = set(element(elites ? "rect" : "circle", svg, "member"), place);
    const said = `member ${member}: ${run.score.name} ${digits(score)} ${run.score.unit}`.trim();
    set(mark, { fill: colour((score - low) / (high - low || 1)), tabindex: 0, role: "button", "aria-label": said });
    element("title", mark, "", said);
    mark.onclick = () => see(run.folder, member, kept.generation);
    mark.onkeydown = (event) => { if (event.key === "Enter") mark.onclick(); };
  }
  const above = axes[1].name ? `, upwards: ${axes[1].name}` : "";
  const shown = `${run.score.name} from ${digits(low)} (blue) to ${digits(high)} (yellow)`;
  const what = elites ? "The best design of each kind" : "Designs of which none dominates another";
  element("figcaption", figure, "", `${what}; ${shown}${above}. Press one to see it in motion.`);
}

// An axis of a map, whose places are cells, or of a front, whose places are values: which part of it a place is at.
function axisOf(kept, n) {
  const axis = kept.axes[n];
  if (kept.kind === "elites") {
    if (!axis) return { name: "", marks: [], part: (cell) => cell }; // a map along one axis has one row
    const values = ticks(axis.low, axis.high), wide = axis.high - axis.low;
    const marks = values.map((at) => ({ at, value: (at - axis.low) / wide * kept.bins }));
    return { name: axis.name, marks, part: (cell) => cell / kept.bins };
  }
  const values = kept.members.map((member) => member[n]);
  const [low, high] = spread(Math.min(...values), Math.max(...values)), room = (high - low) / 20;
  const part = (value) => (value - low + room) / (high - low + 2 * room);
  return { name: axis.name, marks: ticks(low, high).map((at) => ({ at, value: at })), part };
}

function see(folder, member = "", generation = "") {
  const dialog = document.getElementById("seen"), frame = dialog.querySelector("iframe");
  const waits = document.getElementById("waits"), told = member ? `member ${member}` : "the best design";
  waits.textContent = `${told} of ${folder} is simulated \u2026`;
  let poll;
  const play = () => {
    const { player } = frame.contentWindow;
    if (player) player.play(true);
    else poll = setTimeout(play, 100);
  };
  frame.onload = () => {
    const shown = frame.contentDocument.contentType === "text/html"; // else the frame has one line that says why not
    waits.textContent = shown ? `${folder}: ${told}` : `${told} of ${folder} cannot be shown`;
    if (shown) play();
  };
  frame.src = `player?${new URLSearchParams({ run: folder, member, generation })}`;
  dialog.onclose = () => {
    clearTimeout(poll);
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
