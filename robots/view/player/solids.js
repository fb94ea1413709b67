// All nodes that are one solid, drawn at once.
class Solids {
  constructor(about, solid, number) {
    this.nodes = about.solid_of.flatMap((s, node) => (s === number ? [node] : []));
    this.mesh = new THREE.InstancedMesh(geometryOf(solid), materialOf(solid.kind), this.nodes.length);
    this.mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
    this.mesh.instanceColor = new THREE.InstancedBufferAttribute(new Float32Array(3 * this.nodes.length), 3);
    this.mesh.frustumCulled = false;
  }

  shadow(material) {
    const shadow = new THREE.InstancedMesh(this.mesh.geometry, material, this.nodes.length);
    shadow.instanceMatrix = this.mesh.instanceMatrix;
    shadow.frustumCulled = false;
    return shadow;
  }

  update(poses) {
    const { instanceMatrix, instanceColor } = this.mesh;
    this.nodes.forEach((node, place) => {
      instanceMatrix.array.set(poses.matrixOf(node), 16 * place);
      instanceColor.array.set(poses.colourOf(node), 3 * place);
    });
    instanceMatrix.needsUpdate = instanceColor.needsUpdate = true;
  }
}

function geometryOf(solid) {
  if (solid.kind === "box") return new THREE.BoxGeometry(...solid.size);
  if (solid.kind === "sphere") return new THREE.SphereGeometry(solid.radius, 32, 20);
  return new THREE.CapsuleGeometry(solid.radius, solid.length, 8, 20).rotateX(Math.PI / 2); // along z
}

// Matt, with fine lines along the edges of boxes, and marks on balls that show them roll.
function materialOf(kind, settings = {}) {
  const material = new THREE.MeshLambertMaterial(settings);
  const mark = {
    box: "vec2 w = fwidth(vUv), d = min(vUv, 1.0 - vUv) / w;"
      + "float line = 1.0 - smoothstep(0.4, 1.4, min(d.x, d.y)), near = clamp(1.6 - 8.0 * max(w.x, w.y), 0.0, 1.0);"
      + "diffuseColor.rgb *= 1.0 - 0.3 * line * near;",
    sphere: "if (fract(4.0 * vUv.x) < 0.5 != vUv.y < 0.5) diffuseColor.rgb *= 0.78;",
  }[kind];
  if (!mark) return material;
  material.defines = { USE_UV: "" };
  material.onBeforeCompile = (shader) => {
    const colour = "#include <color_fragment>";
    shader.fragmentShader = shader.fragmentShader.replace(colour, `${colour}\n${mark}`);
  };
  material.customProgramCacheKey = () => kind;
  return material;
}
