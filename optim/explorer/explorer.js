// Front end of the widget: controls send their values, and show what comes back.
const POLL = 60; // ms between looks whether a player is ready

function element(kind, parent, name = "", text = "") {
  const made = document.createElement(kind);
  if (kind === "button") made.type = "button";
  if (name) made.className = name;
  if (text) made.textContent = text;
  parent.append(made);
  return made;
}

const spoken = (name) => name.replaceAll("_", " ");
const digits = (value) => (Number.isFinite(value) ? Number(value.toPrecision(4)).toString() : "none");

class Explorer {
  constructor(model, el) {
    this.model = model;
    this.wanted = { ...model.get("values") };
    this.inputs = new Map();
    const root = element("div", el, "morpholab-explorer");
    const side = element("div", root, "side");
    for (const control of model.get("controls")) this.#control(control, side);
    const tools = element("div", side, "tools");
    this.#button(tools, "reset", "Every control as at first", () => this.#reset());
    this.#button(tools, "keep", "Keep this one beside the next", () => model.send("keep"));
    this.forget = this.#button(tools, "forget kept", "Show the present one alone", () => model.send("drop"));
    this.progress = element("progress", side);
    this.progress.max = 1;
    this.message = element("p", side, "message");
    this.message.setAttribute("role", "status");
    this.table = element("table", side);
    this.stage = element("div", root, "stage");
    this.stage.style.height = `${model.get("height")}px`;
    this.handlers = {
      "change:values": () => this.#moved(), "change:busy": () => this.#busy(), "change:page": () => this.#page(),
      "change:measured": () => this.#measured(), "change:message": () => this.#message(),
    };
    for (const [event, act] of Object.entries(this.handlers)) {
      model.on(event, act);
      act();
    }
  }

  release() {
    for (const [event, act] of Object.entries(this.handlers)) this.model.off(event, act);
    clearTimeout(this.look);
  }

  #button(parent, text, title, act) {
    const made = element("button", parent, "", text);
    made.title = title;
    made.onclick = act;
    return made;
  }

  #control(control, parent) {
    const label = element("label", parent, "control");
    element("span", label, "", spoken(control.name));
    if (control.choices.length) {
      const menu = element("select", label);
      control.choices.forEach((choice, n) => { element("option", menu, "", String(choice)).value = n; });
      menu.onchange = () => this.#set(control.name, control.choices[menu.value]);
      this.inputs.set(control.name, (value) => { menu.value = control.choices.indexOf(value); });
      return;
    }
    const slider = element("input", label), output = element("output", label);
    slider.type = "range";
    Object.assign(slider, { min: control.low, max: control.high, step: "any" });
    const rounded = () => {
      const steps = Math.round((Number(slider.value) - control.low) / control.step);
      return Math.min(control.high, Number((control.low + steps * control.step).toPrecision(12)));
    };
    const tell = (value) => { output.textContent = `${digits(value)} ${control.unit}`.trim(); };
    slider.oninput = () => tell(rounded());
    slider.onchange = () => this.#set(control.name, rounded());
    slider.onkeydown = (event) => {
      const steps = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (!steps) return;
      event.preventDefault();
      slider.value = rounded() + steps * control.step;
      slider.oninput();
      slider.onchange();
    };
    this.inputs.set(control.name, (value) => {
      slider.value = value;
      tell(value);
    });
  }

  #reset() {
    for (const control of this.model.get("controls")) this.wanted[control.name] = control.first;
    this.#show();
    this.#send();
  }

  #set(name, value) {
    this.wanted[name] = value;
    this.#send();
  }

  // One trial at a time: what is moved meanwhile is tried after it, and only as it is then.
  #send() {
    if (this.sent || this.model.get("busy") !== null) return;
    if (JSON.stringify(this.wanted) === JSON.stringify(this.model.get("values"))) return;
    this.model.set("values", { ...this.wanted });
    this.model.save_changes();
    this.sent = true;
    this.progress.hidden = false;
    this.progress.removeAttribute("value");
  }

  #moved() {
    if (!this.sent) this.wanted = { ...this.model.get("values") };
    this.#show();
  }

  #show() {
    for (const [name, show] of this.inputs) show(this.wanted[name]);
  }

  #busy() {
    const busy = this.model.get("busy");
    this.progress.hidden = busy === null;
    if (busy !== null) this.progress.value = busy;
    else {
      this.sent = false;
      this.#send();
    }
  }

  #message() {
    this.message.textContent = this.model.get("message");
    this.message.hidden = !this.message.textContent;
  }

  #measured() {
    const all = this.model.get("measured");
    this.table.replaceChildren();
    this.forget.hidden = !all.some((one) => one.title !== "now");
    if (!all.length) return;
    const head = element("tr", this.table);
    element("th", head);
    for (const { title } of all) element("th", head, "", title);
    const names = [...new Set(all.flatMap(({ rows }) => rows.map(([name]) => name)))];
    for (const name of names) {
      const line = element("tr", this.table);
      const unit = all.flatMap(({ rows }) => rows).find(([other]) => other === name)[1];
      element("th", line, "", unit ? `${name} [${unit}]` : name);
      for (const { rows } of all) {
        const found = rows.find(([other]) => other === name);
        element("td", line, "", found ? digits(found[2]) : "failed");
      }
    }
  }

  // The next player stays unseen until it can play; it goes on from where one looked at the last.
  #page() {
    const page = this.model.get("page"), last = this.stage.querySelector("iframe:not(.next)");
    this.stage.querySelectorAll("iframe.next").forEach((frame) => frame.remove());
    clearTimeout(this.look);
    if (!page) {
      last?.remove();
      return;
    }
    const next = element("iframe", this.stage, "next");
    next.title = "Player of motions";
    next.srcdoc = page;
    const look = () => {
      const player = next.contentWindow?.player;
      if (!player && !next.contentDocument?.querySelector("#message.problem")) {
        this.look = setTimeout(look, POLL);
        return;
      }
      if (player) this.#goOn(player, last?.contentWindow?.player);
      next.className = "";
      last?.remove();
    };
    this.look = setTimeout(look, POLL);
  }

  #goOn(player, before) {
    player.stages.forEach((stage, n) => {
      const old = before?.stages[n];
      if (!old?.touched) return;
      stage.touched = true;
      stage.camera.position.copy(old.camera.position);
      stage.controls.target.copy(old.controls.target);
      stage.controls.update();
    });
    player.play(!before || before.playing || before.time >= before.duration);
  }
}

export default {
  render({ model, el }) {
    const explorer = new Explorer(model, el);
    return () => explorer.release();
  },
};
