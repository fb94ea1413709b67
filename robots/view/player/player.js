// One clock for all motions of the page.
const PLAY = '<svg viewBox="0 0 14 14"><path d="M2 0.5v13l11.5-6.5z"/></svg>';
const PAUSE = '<svg viewBox="0 0 14 14"><path d="M1.5 1h4v12h-4zm7 0h4v12h-4z"/></svg>';

class Player {
  constructor(about, all) {
    this.duration = Math.max(...about.map((motion) => motion.times.at(-1)), 1e-9);
    const intervals = about.map((motion) => motion.times.at(-1) / Math.max(motion.frames - 1, 1));
    this.interval = Math.max(1e-4, Math.min(...intervals));
    this.time = 0;
    this.playing = false;
    this.rate = 1;
    this.renders = 0;
    this.stages = [];
    this.timelines = [];
    this.readouts = [];
    about.forEach((motion, number) => this.#add(motion, all[number]));
    this.#connect();
    this.seek(0);
    this.before = performance.now(); // who opens a page may press play before its first picture
    requestAnimationFrame((now) => this.#tick(now));
  }

  #add(about, whole) {
    const figure = element("figure", document.getElementById("motions"));
    const holder = element("div", figure, "stage"), name = element("div", holder, "name");
    name.textContent = about.name;
    element("div", holder, "grid").textContent = `grid ${about.ground.label}`;
    const shown = element("div", holder, "readouts");
    this.readouts.push(about.readouts.map((number) => {
      const channel = about.channels[number];
      const part = element("span", shown);
      part.append(`${channel.name} `);
      const value = element("b", part);
      part.append(` ${channel.unit}`);
      return { channel, value };
    }));
    const tools = element("div", holder, "tools");
    const stage = new Stage(holder, about, whole);
    const follow = element("button", tools), home = element("button", tools);
    follow.textContent = "follow";
    follow.title = "Let the camera travel with the robot";
    follow.setAttribute("aria-pressed", stage.follow);
    follow.onclick = () => {
      stage.follow = !stage.follow;
      follow.setAttribute("aria-pressed", stage.follow);
    };
    home.textContent = "reset view";
    home.onclick = () => stage.home();
    this.stages.push(stage);
    const chart = element("div", figure, "chart");
    this.timelines.push(new Timeline(chart, about, this.duration, (time) => this.seek(time)));
  }

  #connect() {
    this.button = document.getElementById("play");
    this.slider = document.getElementById("slider");
    this.clock = document.getElementById("clock");
    this.slider.max = this.duration;
    this.button.onclick = () => this.play(!this.playing);
    this.slider.oninput = () => this.seek(Number(this.slider.value));
    const speed = document.getElementById("speed");
    speed.onchange = () => { this.rate = Number(speed.value); };
    // What takes long plays faster at first, so that it ends within a minute.
    const enough = (choice) => choice.value >= 1 && this.duration / choice.value <= 60;
    const quick = [...speed.options].find(enough) ?? speed.options[speed.options.length - 1];
    speed.value = quick.value;
    speed.onchange();
    document.addEventListener("keydown", (event) => this.#key(event));
    this.play(false);
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const step = this.interval * (event.shiftKey ? 10 : 1);
    const act = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => this.seek(this.time - step),
      ArrowRight: () => this.seek(this.time + step),
      Home: () => this.seek(0),
      End: () => this.seek(this.duration),
    }[event.key];
    if (!act || (event.key === " " && event.target.tagName === "BUTTON")) return;
    event.preventDefault();
    act();
  }

  play(playing) {
    if (playing && this.time >= this.duration) this.seek(0);
    this.playing = playing;
    this.button.innerHTML = playing ? PAUSE : PLAY;
    this.button.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  // What is seen changes with the next picture, however often this is called before.
  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.moved = true;
  }

  #show() {
    this.slider.value = this.time;
    this.clock.textContent = `${this.time.toFixed(2)} / ${this.duration.toFixed(2)} s`;
    this.stages.forEach((stage) => stage.show(this.time));
    this.timelines.forEach((timeline) => timeline.show(this.time));
    for (const { channel, value } of this.readouts.flat()) {
      value.textContent = textOf(channel, valueAt(channel, this.time));
    }
  }

  #tick(now) {
    if (this.playing) {
      this.seek(this.time + this.rate * Math.min(Math.max(now - this.before, 0) / 1000, 0.25));
      if (this.time >= this.duration) this.play(false);
    }
    this.before = now;
    if (this.moved) this.#show();
    this.moved = false;
    if (this.stages.map((stage) => stage.render(now)).some(Boolean)) this.renders++;
    requestAnimationFrame((next) => this.#tick(next));
  }
}

function element(kind, parent, name = "") {
  const made = parent.appendChild(document.createElement(kind));
  if (kind === "button") made.type = "button";
  if (name) made.className = name;
  return made;
}

async function start() {
  const message = document.getElementById("message");
  const fail = (why) => {
    message.textContent = why;
    message.classList.add("problem");
  };
  const probe = document.createElement("canvas");
  if (!probe.getContext("webgl2")) {
    return fail("This browser shows no 3D graphics (WebGL 2), which the player needs; another browser or device may.");
  }
  if (!window.DecompressionStream) return fail("This browser is too old for the player; please use a newer one.");
  try {
    const about = JSON.parse(document.getElementById("about").textContent);
    const all = await Promise.all(about.map((motion, n) => decode(document.getElementById(`motion-${n}`), motion)));
    for (const id of ["motions", "controls", "hint"]) document.getElementById(id).hidden = false;
    window.player = new Player(about, all);
    message.remove();
  } catch (error) {
    fail(`The motion cannot be shown: ${error.message}`);
    throw error;
  }
}

start();
