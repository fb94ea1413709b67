// Uneven ground: nodes on a grid, between which it is made of flat triangles, as the simulation has it.
const LIGHT = [-0.3, -0.45, 0.84]; // as in pictures: along the way, to its left, up
const CONTRAST = 0.54, DARKEST = 0.65; // of slopes

class Relief {
  constructor({ level, relief }, upright) {
    Object.assign(this, relief, { level });
    this.up = new THREE.Vector3(0, 1, 0).applyQuaternion(upright.clone().invert());
  }

  z(i, j) { return this.level + this.heights[i * this.counts[1] + j]; }

  // Height of the ground at a place; beyond the grid it goes on as at its edge.
  height(x, y) {
    const [u, v] = [x, y].map((place, k) => {
      return Math.min(Math.max((place - this.origin[k]) / this.spacing, 0), this.counts[k] - 1);
    });
    const i = Math.min(Math.floor(u), this.counts[0] - 2), j = Math.min(Math.floor(v), this.counts[1] - 2);
    const a = this.z(i, j), b = this.z(i + 1, j), c = this.z(i, j + 1), d = this.z(i + 1, j + 1);
    const along = u - i, across = v - j;
    return along >= across ? a + (b - a) * along + (d - b) * across : a + (d - c) * along + (c - a) * across;
  }

  // Where on the ground a point falls; on tilted ground that is not below it along z.
  fall([x, y, z], lift) {
    const { up } = this;
    for (let k = 0; k < 4; k++) {
      const down = (this.height(x, y) - z) / up.z;
      [x, y, z] = [x + down * up.x, y + down * up.y, z + down * up.z];
    }
    return [x, y, this.height(x, y) + lift];
  }

  // Points of the pieces of a straight line along the ground, from one place to another.
  line(from, to, lift) {
    const count = Math.ceil(2 * Math.hypot(to[0] - from[0], to[1] - from[1]) / this.spacing);
    const points = [];
    for (let k = 0; k < count; k++) {
      for (const part of [k / count, (k + 1) / count]) {
        const [x, y] = [0, 1].map((axis) => from[axis] + part * (to[axis] - from[axis]));
        points.push(x, y, this.height(x, y) + lift);
      }
    }
    return points;
  }

  // Its triangles, lit, and darker where they grip more.
  sheet([x, y]) {
    const [wide, long] = this.counts, places = [], colours = [];
    const light = new THREE.Vector3(x * LIGHT[0] - y * LIGHT[1], y * LIGHT[0] + x * LIGHT[1], 0);
    light.addScaledVector(this.up, LIGHT[2]).normalize();
    const node = (i, j) => {
      return new THREE.Vector3(this.origin[0] + i * this.spacing, this.origin[1] + j * this.spacing, this.z(i, j));
    };
    const triangle = (corners) => {
      const [a, b, c] = corners.map(([i, j]) => node(i, j));
      const normal = b.clone().sub(a).cross(c.clone().sub(a)).normalize();
      const bright = Math.min(Math.max(1 + CONTRAST * (Math.max(normal.dot(light), 0) - light.z), DARKEST), 1.06);
      corners.forEach(([i, j], k) => {
        places.push(...[a, b, c][k].toArray());
        for (let k = 0; k < 3; k++) { // as light adds up
          colours.push((bright * (this.tints ? this.tints[3 * (i * long + j) + k] : 1)) ** 2.2);
        }
      });
    };
    for (let i = 0; i < wide - 1; i++) {
      for (let j = 0; j < long - 1; j++) {
        triangle([[i, j], [i + 1, j], [i + 1, j + 1]]);
        triangle([[i, j], [i + 1, j + 1], [i, j + 1]]);
      }
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(colours), 3));
    return geometry;
  }

  // What darkens the ground once, however many faces of a shadow lie on it.
  shade() {
    const once = { stencilWrite: true, stencilRef: 1, stencilFunc: 517, stencilZPass: 7681 }; // where it is not 1: set
    return new THREE.MeshBasicMaterial({
      color: 0x33302b, transparent: true, opacity: 0.12, depthWrite: false, side: THREE.DoubleSide, ...once,
    });
  }
}
