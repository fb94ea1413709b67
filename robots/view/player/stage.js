// One motion in three dimensions.
const PALE = [0.97, 0.96, 0.94];

class Stage {
  constructor(holder, about, whole) {
    this.about = about;
    this.whole = whole;
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setClearColor(0xffffff);
    holder.prepend(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.001, 1000);
    this.world = new THREE.Group();
    this.world.quaternion.set(...about.upright);
    this.world.updateMatrixWorld(true);
    this.scene.add(this.world);
    this.dirty = true;
    this.follow = about.follow;
    this.last = null;
    this.#light();
    this.#ground();
    this.#solids();
    this.#trail();
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 0.56 * Math.PI;
    this.controls.addEventListener("change", () => { this.dirty = true; });
    this.time = about.times[0];
    this.home();
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
    const { ground, along } = this.about;
    const plate = new THREE.Group();
    plate.position.set(...ground.middle, ground.level);
    plate.rotation.z = Math.atan2(along[1], along[0]);
    const [length, width] = ground.size;
    const sheet = new THREE.Mesh(new THREE.PlaneGeometry(length, width), new THREE.MeshBasicMaterial({ color: 0xf3f1ec }));
    sheet.material.polygonOffset = true;
    sheet.material.polygonOffsetFactor = sheet.material.polygonOffsetUnits = 4;
    const points = [];
    for (let x = 0; x <= length + 1e-9; x += ground.grid) points.push(x - length / 2, -width / 2, 0, x - length / 2, width / 2, 0);
    for (let y = 0; y <= width + 1e-9; y += ground.grid) points.push(-length / 2, y - width / 2, 0, length / 2, y - width / 2, 0);
    const lines = new THREE.BufferGeometry();
    lines.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    plate.add(sheet, new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: 0xd9d5cc })));
    this.world.add(plate);
  }

  #solids() {
    const { about } = this;
    const flat = new THREE.Group(); // shadows: everything, straight down onto the ground
    flat.matrixAutoUpdate = false;
    const down = new THREE.Vector3(0, -1, 0).applyQuaternion(this.world.quaternion.clone().invert());
    const level = about.ground.level + 2e-4 * about.size;
    flat.matrix.set(1, 0, -down.x / down.z, level * down.x / down.z, 0, 1, -down.y / down.z, level * down.y / down.z,
      0, 0, 0, level, 0, 0, 0, 1);
    const dark = new THREE.MeshBasicMaterial({ color: 0xdcd8cf, side: THREE.DoubleSide });
    this.groups = about.solids.map((solid, number) => {
      const nodes = about.solid_of.flatMap((s, node) => (s === number ? [node] : []));
      const mesh = new THREE.InstancedMesh(geometryOf(solid), materialOf(solid), nodes.length);
      mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
      mesh.instanceColor = new THREE.InstancedBufferAttribute(new Float32Array(3 * nodes.length), 3);
      const shadow = new THREE.InstancedMesh(mesh.geometry, dark, nodes.length);
      shadow.instanceMatrix = mesh.instanceMatrix;
      mesh.frustumCulled = shadow.frustumCulled = false;
      this.world.add(mesh);
      flat.add(shadow);
      return { nodes, mesh };
    });
    this.world.add(flat);
    const colour = new THREE.Color();
    const linear = (rgb) => colour.setRGB(...rgb, "srgb").toArray();
    this.full = about.colours.map(linear);
    this.pale = about.colours.map((rgb) => linear(rgb.map((c, k) => 0.32 * c + 0.68 * PALE[k])));
    for (const place of about.lights) {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(about.light_radius, 24, 16),
        new THREE.MeshBasicMaterial({ color: 0xf2b01e }));
      ball.position.set(...place);
      this.world.add(ball);
    }
  }

  #trail() {
    const points = new Float32Array(this.about.path.flatMap(([x, y]) => [x, y, this.about.ground.level + 6e-4 * this.about.size]));
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
    this.dirty = true;
  }

  #middle(time) {
    const { times, path } = this.about;
    const [frame, part] = placeOf(times, time);
    const next = path[Math.min(frame + 1, path.length - 1)];
    return new THREE.Vector3(...path[frame].map((x, k) => x + part * (next[k] - x))).applyQuaternion(this.world.quaternion);
  }

  // The first view: from the right of the way and above it.
  home() {
    const { about } = this, [x, y] = about.along;
    const target = this.follow ? this.#middle(this.time) : this.#outside(new THREE.Vector3(...about.view.middle));
    const away = this.#outside(new THREE.Vector3(0.85 * y - 0.4 * x, -0.85 * x - 0.4 * y, 0.55)).normalize();
    const radius = this.follow ? about.view.near : about.view.far;
    const angle = Math.atan(Math.tan((this.camera.fov / 2) * Math.PI / 180) * Math.min(1, this.camera.aspect));
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(away, radius / Math.sin(angle));
    this.camera.near = 0.01 * radius;
    this.camera.far = 200 * Math.max(radius, about.view.far);
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.last = this.#middle(this.time);
    this.dirty = true;
  }

  show(time) {
    const { about, whole } = this;
    this.time = time;
    const [frame, part] = placeOf(about.times, time);
    const each = NUMBERS * about.nodes, here = frame * each;
    const there = (Math.min(frame + 1, about.frames - 1)) * each;
    const shades = about.channels.map((channel) => shadeOf(channel, time));
    for (const { nodes, mesh } of this.groups) {
      const matrices = mesh.instanceMatrix.array, colours = mesh.instanceColor.array;
      const pose = new Float64Array(NUMBERS);
      nodes.forEach((node, place) => {
        for (let k = 0; k < NUMBERS; k++) {
          const from = whole[here + k * about.nodes + node];
          pose[k] = from + part * (whole[there + k * about.nodes + node] - from);
        }
        writeMatrix(matrices, 16 * place, pose, about.steps);
        const channel = about.channel_of[node], shade = channel === null ? 1 : shades[channel];
        const paint = about.colour_of[node], full = this.full[paint], pale = this.pale[paint];
        for (let k = 0; k < 3; k++) colours[3 * place + k] = pale[k] + shade * (full[k] - pale[k]);
      });
      mesh.instanceMatrix.needsUpdate = true;
      mesh.instanceColor.needsUpdate = true;
    }
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

  render() {
    if (!this.dirty) return false;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    return true;
  }
}

function shadeOf(channel, time) {
  const of = channel.logarithmic ? Math.log : (x) => x;
  const [low, high] = channel.range.map(of);
  return high > low ? (of(valueAt(channel, time)) - low) / (high - low) : 1;
}

function geometryOf(solid) {
  if (solid.kind === "box") return new THREE.BoxGeometry(...solid.size);
  if (solid.kind === "sphere") return new THREE.SphereGeometry(solid.radius, 32, 20);
  return new THREE.CapsuleGeometry(solid.radius, solid.length, 8, 20).rotateX(Math.PI / 2); // along z
}

// Matt, with fine lines along the edges of boxes, and marks on balls that show them roll.
function materialOf(solid) {
  const material = new THREE.MeshLambertMaterial();
  const mark = {
    box: "vec2 w = fwidth(vUv), d = min(vUv, 1.0 - vUv) / w;"
      + "diffuseColor.rgb *= 1.0 - 0.3 * (1.0 - smoothstep(0.4, 1.4, min(d.x, d.y))) * clamp(1.6 - 8.0 * max(w.x, w.y), 0.0, 1.0);",
    sphere: "if (fract(4.0 * vUv.x) < 0.5 != vUv.y < 0.5) diffuseColor.rgb *= 0.78;",
  }[solid.kind];
  if (!mark) return material;
  material.defines = { USE_UV: "" };
  material.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace("#include <color_fragment>", `#include <color_fragment>\n${mark}`);
  };
  material.customProgramCacheKey = () => solid.kind;
  return material;
}

// A column-major matrix of translation, rotation (w, x, y, z; any length) and scale, in whole steps.
function writeMatrix(out, at, p, steps) {
  const length = 1 / Math.hypot(p[3], p[4], p[5], p[6]);
  const w = p[3] * length, x = p[4] * length, y = p[5] * length, z = p[6] * length;
  const a = p[7] * steps[2], b = p[8] * steps[2], c = p[9] * steps[2];
  out[at] = (1 - 2 * (y * y + z * z)) * a;
  out[at + 1] = 2 * (x * y + w * z) * a;
  out[at + 2] = 2 * (x * z - w * y) * a;
  out[at + 3] = 0;
  out[at + 4] = 2 * (x * y - w * z) * b;
  out[at + 5] = (1 - 2 * (x * x + z * z)) * b;
  out[at + 6] = 2 * (y * z + w * x) * b;
  out[at + 7] = 0;
  out[at + 8] = 2 * (x * z + w * y) * c;
  out[at + 9] = 2 * (y * z - w * x) * c;
  out[at + 10] = (1 - 2 * (x * x + y * y)) * c;
  out[at + 11] = 0;
  out[at + 12] = p[0] * steps[0];
  out[at + 13] = p[1] * steps[0];
  out[at + 14] = p[2] * steps[0];
  out[at + 15] = 1;
}
