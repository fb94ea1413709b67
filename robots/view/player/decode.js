// From the page's data to poses: the way back of packing.py.
const NUMBERS = 10; // of a node's pose: translation 3, rotation 4, scale 3

async function decode(element, about) {
  const text = atob(element.textContent.trim());
  element.remove(); // which frees its memory
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const each = NUMBERS * about.nodes, count = about.frames * each;
  const whole = new Int32Array(count);
  for (let i = 0; i < count; i++) {
    let unsigned = 0;
    for (let plane = 0; plane < about.planes; plane++) unsigned |= bytes[plane * count + i] << (8 * plane);
    whole[i] = (i < each ? 0 : whole[i - each]) + ((unsigned >>> 1) ^ -(unsigned & 1));
  }
  return whole;
}

// Place of a time among times: the last one before it, and how far it is on the way to the next.
function placeOf(times, time) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time) low = middle; else high = middle - 1;
  }
  const next = Math.min(low + 1, times.length - 1);
  const part = next > low ? (time - times[low]) / (times[next] - times[low]) : 0;
  return [low, Math.min(Math.max(part, 0), 1)];
}

function valueAt(channel, time) {
  const [place, part] = placeOf(channel.times, time);
  const value = channel.values[place];
  if (channel.switch || !part) return value;
  return value + part * (channel.values[place + 1] - value);
}
