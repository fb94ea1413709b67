// Poses and colours of all nodes at a time.
const PALE = [0.97, 0.96, 0.94];

class Poses {
  constructor(about, whole) {
    Object.assign(this, { about, whole });
    this.matrix = new Float64Array(16);
    this.colour = new Float64Array(3);
    const tool = new THREE.Color();
    const linear = (rgb) => tool.setRGB(...rgb, "srgb").toArray();
    this.full = about.colours.map(linear);
    this.pale = about.colours.map((rgb) => linear(rgb.map((c, k) => 0.32 * c + 0.68 * PALE[k])));
  }

  // To a time; returns the frame before it.
  go(time) {
    const { about } = this;
    const [frame, part] = placeOf(about.times, time);
    this.here = frame * NUMBERS * about.nodes;
    this.there = Math.min(frame + 1, about.frames - 1) * NUMBERS * about.nodes;
    this.part = part;
    this.shades = about.channels.map((channel) => shadeOf(channel, time));
    return frame;
  }

  // A node's matrix, column by column.
  matrixOf(node) {
    const { about, whole, part, matrix } = this, p = POSE;
    for (let k = 0; k < NUMBERS; k++) {
      const from = whole[this.here + k * about.nodes + node];
      p[k] = from + part * (whole[this.there + k * about.nodes + node] - from);
    }
    return writeMatrix(matrix, p, about.steps);
  }

  colourOf(node) {
    const { about, colour } = this, channel = about.channel_of[node];
    const shade = channel === null ? 1 : this.shades[channel];
    const full = this.full[about.colour_of[node]], pale = this.pale[about.colour_of[node]];
    for (let k = 0; k < 3; k++) colour[k] = pale[k] + shade * (full[k] - pale[k]);
    return colour;
  }
}

const POSE = new Float64Array(NUMBERS);

function shadeOf(channel, time) {
  if (channel.switch) return valueAt(channel, time);
  const of = channel.logarithmic ? Math.log : (x) => x;
  const [low, high] = channel.range.map(of);
  return high > low ? (of(valueAt(channel, time)) - low) / (high - low) : 1;
}

// From translation, rotation (w, x, y, z; any length) and scale, in whole steps.
function writeMatrix(out, p, steps) {
  const length = 1 / Math.hypot(p[3], p[4], p[5], p[6]);
  const w = p[3] * length, x = p[4] * length, y = p[5] * length, z = p[6] * length;
  const a = p[7] * steps[2], b = p[8] * steps[2], c = p[9] * steps[2];
  out[0] = (1 - 2 * (y * y + z * z)) * a;
  out[1] = 2 * (x * y + w * z) * a;
  out[2] = 2 * (x * z - w * y) * a;
  out[4] = 2 * (x * y - w * z) * b;
  out[5] = (1 - 2 * (x * x + z * z)) * b;
  out[6] = 2 * (y * z + w * x) * b;
  out[8] = 2 * (x * z + w * y) * c;
  out[9] = 2 * (y * z - w * x) * c;
  out[10] = (1 - 2 * (x * x + y * y)) * c;
  out[12] = p[0] * steps[0];
  out[13] = p[1] * steps[0];
  out[14] = p[2] * steps[0];
  out[15] = 1;
  return out;
}
