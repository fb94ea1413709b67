// Joined cubes, seen from outside: far fewer faces than all their sides, and no gaps.
class Skin {
  constructor({ knots, count, cubes, corners }) {
    Object.assign(this, { knots, cubes, corners });
    this.sums = new Float64Array(3 * count);
    this.shares = new Float64Array(count);
    for (const around of knots) for (const knot of around) this.shares[knot] += 1;
    const square = [0, 0, 1, 0, 1, 1, 0, 1];
    const attribute = (size) => new THREE.BufferAttribute(new Float32Array(4 * size * cubes.length), size);
    const geometry = new THREE.BufferGeometry();
    this.places = attribute(3).setUsage(THREE.DynamicDrawUsage);
    this.normals = attribute(3).setUsage(THREE.DynamicDrawUsage);
    this.colours = attribute(3).setUsage(THREE.DynamicDrawUsage);
    geometry.setAttribute("position", this.places);
    geometry.setAttribute("normal", this.normals);
    geometry.setAttribute("color", this.colours);
    geometry.setAttribute("uv", new THREE.BufferAttribute(new Float32Array(cubes.flatMap(() => square)), 2));
    geometry.setIndex(cubes.flatMap((_, face) => [0, 1, 2, 0, 2, 3].map((corner) => 4 * face + corner)));
    this.mesh = new THREE.Mesh(geometry, materialOf("box", { vertexColors: true }));
    this.mesh.frustumCulled = false;
  }

  // On a plane it is the skin itself, made flat; on uneven ground every corner falls for itself.
  shadow(material, relief, lift) {
    let { geometry } = this.mesh;
    if (relief) {
      const fallen = new THREE.BufferAttribute(new Float32Array(this.places.array.length), 3);
      this.fallen = fallen.setUsage(THREE.DynamicDrawUsage);
      this.fall = (place) => relief.fall(place, lift);
      geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", this.fallen);
      geometry.setIndex(this.mesh.geometry.index);
    }
    const shadow = new THREE.Mesh(geometry, material);
    shadow.frustumCulled = false;
    return shadow;
  }

  update(poses) {
    const { sums, shares, places, normals, colours } = this;
    sums.fill(0);
    this.knots.forEach((around, node) => {
      const m = poses.matrixOf(node);
      for (let corner = 0; corner < 8; corner++) {
        const x = corner & 4 ? 0.5 : -0.5, y = corner & 2 ? 0.5 : -0.5, z = corner & 1 ? 0.5 : -0.5;
        for (let k = 0; k < 3; k++) sums[3 * around[corner] + k] += m[12 + k] + x * m[k] + y * m[4 + k] + z * m[8 + k];
      }
    });
    for (let i = 0; i < sums.length; i++) sums[i] /= shares[(i / 3) | 0];
    if (this.fallen) this.#cast();
    const put = (array, face, corner, values) => array.set(values, 12 * face + 3 * corner);
    this.corners.forEach((four, face) => {
      const [a, b, c, d] = four.map((knot) => sums.subarray(3 * knot, 3 * knot + 3));
      const u = [c[0] - a[0], c[1] - a[1], c[2] - a[2]], v = [d[0] - b[0], d[1] - b[1], d[2] - b[2]];
      const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const colour = poses.colourOf(this.cubes[face]);
      [a, b, c, d].forEach((place, corner) => {
        put(places.array, face, corner, place);
        put(normals.array, face, corner, normal);
        put(colours.array, face, corner, colour);
      });
    });
    places.needsUpdate = normals.needsUpdate = colours.needsUpdate = true;
  }

  #cast() {
    const { sums, fallen } = this, count = sums.length / 3, places = [];
    for (let knot = 0; knot < count; knot++) places.push(this.fall(sums.subarray(3 * knot, 3 * knot + 3)));
    this.corners.forEach((four, face) => {
      four.forEach((knot, corner) => fallen.array.set(places[knot], 12 * face + 3 * corner));
    });
    fallen.needsUpdate = true;
  }
}
