// The chart of a motion's channels over time, with a cursor.
const LABELS = 112, VALUES = 92, SWITCH_ROW = 15, GAP = 8, AXIS = 20; // px

class Timeline {
  constructor(holder, about, duration, seek) {
    Object.assign(this, { holder, about, duration });
    this.canvas = holder.appendChild(document.createElement("canvas"));
    this.cursor = holder.appendChild(document.createElement("div"));
    this.cursor.className = "cursor";
    let top = 4;
    const lines = about.channels.filter((channel) => !channel.switch).length;
    const line = Math.min(Math.max(210 / lines, 20), 36); // px of a row
    this.rows = about.channels.map((channel, number) => {
      if (number && channel.switch !== about.channels[number - 1].switch) top += GAP;
      const height = channel.switch ? SWITCH_ROW : line;
      const value = holder.appendChild(document.createElement("div"));
      value.className = "value";
      value.style.top = `${top + height / 2 - 5}px`;
      const row = { channel, top, height, value };
      top += height;
      return row;
    });
    this.bottom = top + 2;
    this.cursor.style.height = `${this.bottom}px`;
    const place = (event) => seek(this.#timeAt(event.clientX - holder.getBoundingClientRect().left));
    holder.addEventListener("pointerdown", (event) => {
      holder.setPointerCapture(event.pointerId);
      place(event);
      event.preventDefault();
    });
    holder.addEventListener("pointermove", (event) => { if (event.buttons & 1) place(event); });
    new ResizeObserver(() => this.#draw()).observe(holder);
    this.#draw();
  }

  get #width() { return Math.max(this.holder.clientWidth - LABELS - VALUES, 40); }
  #x(time) { return LABELS + this.#width * time / this.duration; }
  #timeAt(x) { return Math.min(Math.max((x - LABELS) / this.#width, 0), 1) * this.duration; }

  #draw() {
    const ratio = window.devicePixelRatio || 1, width = this.holder.clientWidth, height = this.bottom + AXIS;
    if (!width) return;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.canvas.style.height = `${height}px`;
    const pen = this.canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    pen.textBaseline = "middle";
    for (const row of this.rows) {
      pen.textAlign = "right";
      pen.fillStyle = "#33302b";
      pen.fillText(row.channel.name, LABELS - 10, row.top + row.height / 2 + 0.5);
      if (row.channel.switch) this.#drawSwitch(pen, row); else this.#drawLine(pen, row);
    }
    this.#drawAxis(pen);
    if (this.time !== undefined) this.show(this.time);
  }

  #drawSwitch(pen, { channel, top, height }) {
    const { times, values } = channel, last = times.length - 1;
    const end = Math.max(times[last], Math.min(this.about.times.at(-1), this.duration));
    values.forEach((value, k) => {
      const from = this.#x(times[k]), to = this.#x(k < last ? times[k + 1] : end);
      if (to - from < 0.05) return;
      const width = Math.max(to - from - (to - from > 6 ? 1 : 0), 0.5), high = (height - 2) * value;
      pen.fillStyle = "#f3f1ec";
      pen.fillRect(from, top + 1, width, height - 2);
      pen.fillStyle = css(channel.colour);
      pen.fillRect(from, top + height - 1 - high, width, high);
    });
  }

  #drawLine(pen, { channel, top, height }) {
    const of = channel.logarithmic ? Math.log : (x) => x;
    let [low, high] = channel.range.map(of);
    if (high - low < 1e-12) [low, high] = [low - 1, high + 1];
    const y = (value) => top + height - 4 - (height - 8) * (of(value) - low) / (high - low);
    pen.fillStyle = "#f3f1ec";
    pen.fillRect(LABELS, top + 1, this.#width, height - 2);
    if (channel.range[0] < 0 && channel.range[1] > 0 && !channel.logarithmic) {
      pen.fillStyle = "#d9d5cc";
      pen.fillRect(LABELS, y(0) - 0.5, this.#width, 1);
    }
    pen.strokeStyle = css(channel.colour);
    pen.lineWidth = 1.3;
    pen.lineJoin = "round";
    pen.beginPath();
    channel.times.forEach((time, k) => pen.lineTo(this.#x(time), y(channel.values[k])));
    pen.stroke();
  }

  #drawAxis(pen) {
    const rough = this.duration * 80 / this.#width, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((s) => s * power >= rough);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    pen.textAlign = "center";
    pen.fillStyle = "#8a857b";
    for (let k = 0; k * step <= this.duration * (1 + 1e-9); k++) {
      pen.fillRect(this.#x(k * step) - 0.5, this.bottom, 1, 4);
      pen.fillText((k * step).toFixed(digits), this.#x(k * step), this.bottom + 12);
    }
    pen.textAlign = "left";
    pen.fillText("time [s]", LABELS + this.#width + 18, this.bottom + 12);
  }

  show(time) {
    this.time = time;
    this.cursor.style.transform = `translateX(${this.#x(time)}px)`;
    for (const { channel, value } of this.rows) {
      const now = valueAt(channel, time);
      const told = channel.switch
        ? `<i style="background:linear-gradient(0deg, ${css(channel.colour)} ${100 * now}%, #e9e6df 0)"></i>`
        : `${textOf(channel, now)} <small>${channel.unit}</small>`;
      if (value.told !== told) value.innerHTML = value.told = told;
    }
  }
}

function css(colour) { return `rgb(${colour.map((c) => Math.round(255 * c)).join(" ")})`; }

// As many digits as tell the channel's values apart, with a true minus.
function textOf({ range, logarithmic }, value) {
  if (logarithmic) return value.toPrecision(3);
  const size = Math.max(...range.map(Math.abs));
  const digits = size >= 99.95 || size === 0 ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : 3;
  return value.toFixed(digits).replace(/^-(?=.*[1-9])/, "\u2212").replace(/^-/, "");
}
