// One motion in three dimensions.
const REST = 250; // ms

class Stage {
  constructor(holder, about, whole) {
    this.about = about;
    this.whole = whole;
    // Without a graphics card smooth edges take half of the time: they wait until nothing moves.
    this.slow = isSoftware();
    this.renderer = new THREE.WebGLRenderer({ antialias: !this.slow, stencil: Boolean(about.ground.relief) });
    this.#sharpen(!this.slow);
    this.renderer.setClearColor(0xffffff);
    holder.prepend(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.001, 1000);
    this.world = new THREE.Group();
    this.world.quaternion.set(...about.upright);
    this.world.updateMatrixWorld(true);
    this.scene.add(this.world);
    this.relief = about.ground.relief ? new Relief(about.ground, this.world.quaternion) : null;
    this.dirty = true;
    this.follow = about.follow;
    this.last = null;
    this.#light();
    this.#ground();
    this.#solids();
    this.#trail();
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 0.56 * Math.PI;
    this.controls.addEventListener("start", () => { this.touched = true; });
    this.controls.addEventListener("change", () => { this.dirty = true; });
    this.time = about.times[0];
    new ResizeObserver(() => this.#resize(holder)).observe(holder);
    this.#resize(holder);
  }

  #light() {
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0xb9b2a6, 2.1));
    const sun = new THREE.DirectionalLight(0xffffff, 1.5);
    const [x, y] = this.about.along;
    sun.position.copy(this.#outside(new THREE.Vector3(-0.3 * x + 0.6 * y, -0.3 * y - 0.6 * x, 0.9)));
    this.scene.add(sun);
  }

  // A direction of the motion's frame in the scene's.
  #outside(vector) { return vector.applyQuaternion(this.world.quaternion); }

  #ground() {
    if (this.relief) return this.#unevenGround();
    const { ground, along } = this.about;
    const plate = new THREE.Group();
    plate.position.set(...ground.middle, ground.level);
    plate.rotation.z = Math.atan2(along[1], along[0]);
    const [length, width] = ground.size;
    const behind = { polygonOffset: true, polygonOffsetFactor: 4, polygonOffsetUnits: 4 };
    const paint = new THREE.MeshBasicMaterial({ color: 0xf3f1ec, ...behind });
    const sheet = new THREE.Mesh(new THREE.PlaneGeometry(length, width), paint);
    const points = [], right = length / 2, top = width / 2;
    for (let x = -right; x <= right + 1e-9; x += ground.grid) points.push(x, -top, 0, x, top, 0);
    for (let y = -top; y <= top + 1e-9; y += ground.grid) points.push(-right, y, 0, right, y, 0);
    const lines = new THREE.BufferGeometry();
    lines.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    if (ground.solid) plate.add(sheet); // in a fluid the lines alone, to see the way against
    plate.add(new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: 0xd9d5cc })));
    this.world.add(plate);
  }

  #unevenGround() {
    const { relief } = this, { ground, along: [x, y], size } = this.about, [length, width] = ground.size;
    const behind = { polygonOffset: true, polygonOffsetFactor: 4, polygonOffsetUnits: 4 };
    const paint = new THREE.MeshBasicMaterial({ color: 0xf3f1ec, vertexColors: true, ...behind });
    this.world.add(new THREE.Mesh(relief.sheet([x, y]), paint));
    const right = length / 2, top = width / 2, points = [];
    const place = (u, v) => [ground.middle[0] + x * u - y * v, ground.middle[1] + y * u + x * v];
    const line = (from, to) => { for (const value of relief.line(from, to, 2e-4 * size)) points.push(value); };
    for (let u = -right; u <= right + 1e-9; u += ground.grid) line(place(u, -top), place(u, top));
    for (let v = -top; v <= top + 1e-9; v += ground.grid) line(place(-right, v), place(right, v));
    const lines = new THREE.BufferGeometry();
    lines.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    this.world.add(new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: 0xd9d5cc })));
  }

  #solids() {
    const { about } = this;
    const flat = new THREE.Group(); // shadows: everything, straight down onto the ground
    flat.matrixAutoUpdate = false;
    const down = new THREE.Vector3(0, -1, 0).applyQuaternion(this.world.quaternion.clone().invert());
    const level = about.ground.level + 2e-4 * about.size;
    if (!this.relief) flat.matrix.set(1, 0, -down.x / down.z, level * down.x / down.z, 0, 1, -down.y / down.z, level * down.y / down.z,
      0, 0, 0, level, 0, 0, 0, 1);
    const dark = this.relief ? this.relief.shade() : new THREE.MeshBasicMaterial({ color: 0xdcd8cf, side: THREE.DoubleSide });
    this.seen = about.skin ? [new Skin(about.skin)]
      : about.solids.map((solid, number) => new Solids(about, solid, number));
    for (const part of this.seen) {
      this.world.add(part.mesh);
      if (about.ground.solid) flat.add(part.shadow(dark, this.relief, 4e-4 * about.size));
    }
    this.world.add(flat);
    this.poses = new Poses(about, this.whole);
    for (const place of about.lights) {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(about.light_radius, 24, 16),
        new THREE.MeshBasicMaterial({ color: 0xf2b01e }));
      ball.position.set(...place);
      this.world.add(ball);
    }
  }

  #trail() {
    const { path, ground, size } = this.about, level = ground.level + 6e-4 * size;
    const below = (x, y) => (this.relief ? this.relief.height(x, y) + 6e-4 * size : level);
    const points = new Float32Array(path.flatMap(([x, y, z]) => [x, y, ground.solid ? below(x, y) : z]));
    const line = new THREE.BufferGeometry();
    line.setAttribute("position", new THREE.BufferAttribute(points, 3));
    this.trail = new THREE.Line(line, new THREE.LineBasicMaterial({ color: 0x33302b }));
    this.trail.frustumCulled = false;
    this.world.add(this.trail);
  }

  #resize(holder) {
    const width = holder.clientWidth, height = holder.clientHeight;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.touched) this.home();
    this.dirty = true;
  }

  #middle(time) {
    const { times, path } = this.about;
    const [frame, part] = placeOf(times, time);
    const next = path[Math.min(frame + 1, path.length - 1)];
    return this.#outside(new THREE.Vector3(...path[frame].map((x, k) => x + part * (next[k] - x))));
  }

  // The first view: from the right of the way and above it, as near as what is to be seen allows.
  home() {
    const { about, camera, follow } = this, [x, y] = about.along;
    const away = this.#outside(new THREE.Vector3(0.85 * y - 0.4 * x, -0.85 * x - 0.4 * y, 0.55)).normalize();
    camera.position.copy(away);
    camera.up.set(0, 1, 0);
    camera.lookAt(0, 0, 0);
    camera.updateMatrixWorld();
    const [right, up] = [0, 1].map((k) => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, k));
    const all = () => [...about.path, ...about.lights].map((place) => this.#outside(new THREE.Vector3(...place)));
    const places = follow ? [this.#middle(this.time)] : all();
    const middle = new THREE.Vector3();
    for (const axis of [right, up]) {
      const along = places.map((place) => place.dot(axis));
      middle.addScaledVector(axis, (Math.min(...along) + Math.max(...along)) / 2);
    }
    middle.addScaledVector(away, places.reduce((sum, place) => sum + place.dot(away), 0) / places.length);
    const high = Math.tan((camera.fov / 2) * Math.PI / 180), wide = high * camera.aspect, room = 0.56 * about.size;
    let distance = 0;
    for (const place of places) {
      const seen = place.clone().sub(middle), near = seen.dot(away) + 0.3 * room;
      const aside = Math.abs(seen.dot(right)) + room, above = Math.abs(seen.dot(up)) + room;
      distance = Math.max(distance, near + aside / wide, near + above / high);
    }
    this.controls.target.copy(middle);
    camera.position.copy(middle).addScaledVector(away, distance);
    camera.near = 0.01 * distance;
    camera.far = 100 * distance;
    camera.updateProjectionMatrix();
    this.controls.update();
    this.last = this.#middle(this.time);
    this.dirty = true;
  }

  show(time) {
    this.time = time;
    const frame = this.poses.go(time);
    for (const part of this.seen) part.update(this.poses);
    this.trail.geometry.setDrawRange(0, frame + 1);
    const middle = this.#middle(time);
    if (this.follow && this.last) {
      const moved = middle.clone().sub(this.last);
      this.camera.position.add(moved);
      this.controls.target.add(moved);
      this.controls.update();
    }
    this.last = middle;
    this.dirty = true;
  }

  #sharpen(sharp) {
    this.sharp = sharp;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.renderer.setPixelRatio(this.slow ? (sharp ? 2 : 1) : ratio);
  }

  // Draws what has changed; returns whether something had.
  render(now) {
    const rested = !this.dirty && !this.sharp && now - this.drawn > REST;
    if (!this.dirty && !rested) return false;
    if (this.slow && this.sharp !== rested) this.#sharpen(rested);
    if (this.dirty) this.drawn = now;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    return !rested;
  }
}

function isSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const about = gl.getExtension("WEBGL_debug_renderer_info");
  const name = about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|basic render/i.test(name);
}
