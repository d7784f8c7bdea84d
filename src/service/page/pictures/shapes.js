// The shapes of bodies in space: all shapes that are equal, or differ only in size, are drawn by one call
// (instancing).

import { hullOf } from "./hull.js";

const BELT = 0xf4f1ea;

export class Shapes {
  #three;
  #number;
  #vector;
  #sides;
  #plain; // creates a material that is lit at the corners of its triangles only
  #grounds = [];
  #kinds = new Map(); // {geometry, casts, parts: [{node, colour}], mesh} of each kind of shape, by the properties that its parts share

  // `sides` is the number of sides of the polygon that stands for a circle, a multiple of four.
  constructor(three, number, vector, sides) {
    [this.#three, this.#number, this.#vector, this.#sides] = [three, number, vector, sides];
  }

  add(group, shape, colour, fixed) {
    const three = this.#three;
    const [kind, given] = Object.entries(shape)[0];
    if (kind === "compound") {
      for (const part of given) {
        const inner = new three.Group();
        const turn = this.#vector(part.orientation, [1, 0, 0, 0]);
        inner.position.set(...this.#vector(part.position, [0, 0, 0]));
        inner.quaternion.set(turn[1], turn[2], turn[3], turn[0]).normalize();
        this.add(inner, part.shape, colour, fixed);
        group.add(inner);
      }
      return;
    }
    if (kind === "half_space") return this.#ground(group, given);
    this.#part(group, kind, given, colour, !fixed);
    // A coloured belt around a ball makes its rotation visible.
    if (kind === "sphere") this.#part(group, "belt", given, BELT, false);
  }

  // Adds a part of a body's shape to the parts of its kind. Parts of moving bodies cast shadows.
  #part(group, kind, given, colour, casts) {
    const size = this.#sizeOf(kind, given);
    const key = JSON.stringify([kind, size === null ? given : null, casts]);
    if (!this.#kinds.has(key)) this.#kinds.set(key, { geometry: this.#made(kind, given), casts, parts: [] });
    const node = new this.#three.Group();
    if (size !== null) node.scale.set(...size);
    group.add(node);
    this.#kinds.get(key).parts.push({ node, colour });
  }

  // Adds one instanced mesh for each kind of shape to the scene `world`, after all bodies have been added. `day` and
  // `sun` are the lights of the scene, for materials that are lit at their corners only.
  build(world, day, sun) {
    const three = this.#three;
    this.#plain = (colour) => litByCorners(new three.MeshBasicMaterial({ color: colour }), day, sun);
    for (const kind of this.#kinds.values()) {
      kind.mesh = new three.InstancedMesh(kind.geometry, new three.MeshLambertMaterial(), kind.parts.length);
      kind.parts.forEach(({ colour }, i) => kind.mesh.setColorAt(i, new three.Color(colour)));
      Object.assign(kind.mesh, { castShadow: kind.casts, receiveShadow: true, frustumCulled: false });
      world.add(kind.mesh);
    }
  }

  // Lights every pixel of the shapes, which shadows need, or their corners only, which is a small part of the work.
  light(pixels) {
    const meshes = [...this.#kinds.values()].map(({ mesh }) => mesh).concat(this.#grounds.map(({ plane }) => plane));
    for (const mesh of meshes) {
      mesh.userData.full ??= mesh.material;
      if (!pixels) mesh.userData.plain ??= this.#plain(mesh.material.color);
      mesh.material = pixels ? mesh.userData.full : mesh.userData.plain;
    }
  }

  // Moves the meshes of the shapes to the current poses of the bodies.
  place() {
    for (const { mesh, parts } of this.#kinds.values()) {
      parts.forEach(({ node }, i) => mesh.setMatrixAt(i, node.matrixWorld));
      mesh.instanceMatrix.needsUpdate = true;
    }
  }

  // Returns the factors that scale the unit shape of a kind; null if the proportions of the shape are its own.
  #sizeOf(kind, given) {
    switch (kind) {
      case "sphere":
      case "belt":
        return Array(3).fill(this.#number(given.radius, 1));
      case "box":
        return this.#vector(given.size, [1, 1, 1]);
      case "cylinder":
        return [this.#number(given.radius, 1), this.#number(given.radius, 1), this.#number(given.length, 1)];
      default:
        return null;
    }
  }

  #made(kind, given) {
    const three = this.#three;
    const [number, sides] = [this.#number, this.#sides];
    // Capsules and cylinders of three.js lie along y, those of a specification along z.
    const upright = (geometry) => geometry.rotateX(Math.PI / 2);
    switch (kind) {
      case "sphere":
        // The meridians of the ball are those of the belt, so that the belt lies on the ball without a gap.
        return upright(new three.SphereGeometry(1, sides, Math.round(0.6 * sides)));
      case "belt":
        return upright(new three.CylinderGeometry(1.004, 1.004, 0.16, sides, 1, true));
      case "box":
        return new three.BoxGeometry(1, 1, 1);
      case "capsule":
        return upright(new three.CapsuleGeometry(number(given.radius, 1), number(given.length, 1), Math.round(0.3 * sides), sides));
      case "cylinder":
        return upright(new three.CylinderGeometry(1, 1, 1, sides));
      case "convex_hull":
        return this.#faces(hullOf(given.points.map((point) => this.#vector(point, [0, 0, 0]))));
      default:
        return this.#faces(given.triangles.map((triangle) => triangle.map((corner) => this.#vector(given.vertices[corner], [0, 0, 0]))));
    }
  }

  #faces(triangles) {
    const geometry = new this.#three.BufferGeometry();
    geometry.setAttribute("position", new this.#three.BufferAttribute(new Float32Array(triangles.flat(2)), 3));
    geometry.computeVertexNormals();
    return geometry;
  }

  #ground(group, { normal }) {
    const three = this.#three;
    const up = new three.Vector3(...this.#vector(normal, [0, 0, 1])).normalize();
    const plane = new three.Mesh(new three.PlaneGeometry(1, 1), new three.MeshLambertMaterial({ color: matchMedia("(prefers-color-scheme: dark)").matches ? 0x2b323b : 0xe9e7e1 }));
    plane.quaternion.setFromUnitVectors(new three.Vector3(0, 0, 1), up);
    plane.receiveShadow = true;
    const grid = new three.GridHelper(1, 20, 0x8a94a0, 0xb9c0c8);
    grid.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), up);
    grid.material.transparent = true;
    grid.material.opacity = 0.4;
    group.add(plane, grid);
    this.#grounds.push({ group, plane, grid, up });
  }

  // Places the unbounded grounds: each is drawn as a square below the centre of the region of the film, larger than that
  // region, with its grid slightly above it.
  sizeGrounds(size, centre) {
    for (const { group, plane, grid, up } of this.#grounds) {
      const local = group.worldToLocal(centre.clone());
      local.addScaledVector(up, -local.dot(up));
      plane.position.copy(local);
      grid.position.copy(local).addScaledVector(up, size / 2000);
      plane.scale.setScalar(3 * size);
      grid.scale.setScalar(3 * size);
    }
  }

  // Returns the radius of a ball about the origin of the shape's frame that contains the shape.
  radius(shape) {
    const [kind, given] = Object.entries(shape)[0];
    const farthest = (points) => Math.max(...points.map((point) => Math.hypot(...this.#vector(point, [0, 0, 0]))));
    switch (kind) {
      case "sphere":
        return this.#number(given.radius, 1);
      case "box":
        return Math.hypot(...this.#vector(given.size, [1, 1, 1])) / 2;
      case "capsule":
        return this.#number(given.length, 1) / 2 + this.#number(given.radius, 1);
      case "cylinder":
        return Math.hypot(this.#number(given.length, 1) / 2, this.#number(given.radius, 1));
      case "convex_hull":
        return farthest(given.points);
      case "triangle_mesh":
        return farthest(given.vertices);
      case "compound":
        return Math.max(...given.map((part) => Math.hypot(...this.#vector(part.position, [0, 0, 0])) + this.radius(part.shape)));
      default:
        return Infinity;
    }
  }
}

// Makes a material lit at each corner of a mesh as a matt surface (Lambert) by the lights `day` and `sun`.
function litByCorners(material, day, sun) {
  const scaled = ({ color, intensity }) => color.clone().multiplyScalar(intensity / Math.PI);
  const uniforms = {
    sky: { value: scaled(day) },
    earth: { value: scaled({ color: day.groundColor, intensity: day.intensity }) },
    sunlight: { value: scaled(sun) },
    sunward: { value: sun.position.clone().sub(sun.target.position).normalize() },
  };
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    const [vertex, fragment] = [shader.vertexShader, shader.fragmentShader];
    shader.vertexShader = `uniform vec3 sky, earth, sunlight, sunward;\nvarying vec3 vLight;\n${vertex.replace("#include <project_vertex>", `#include <project_vertex>\n${LIGHT}`)}`;
    shader.fragmentShader = `varying vec3 vLight;\n${fragment.replace("#include <color_fragment>", "#include <color_fragment>\ndiffuseColor.rgb *= vLight;")}`;
  };
  return material;
}

// The shader code of the light at a corner. Scaling a body along one direction turns its normals away from that
// direction. The light of the day comes from +y, as in three.js.
const LIGHT = `
  vec3 facing = normal;
  #ifdef USE_INSTANCING
    mat3 placed = mat3(instanceMatrix);
    facing = placed * (facing / vec3(dot(placed[0], placed[0]), dot(placed[1], placed[1]), dot(placed[2], placed[2])));
  #endif
  facing = normalize(mat3(modelMatrix) * facing);
  vLight = mix(earth, sky, 0.5 * facing.y + 0.5) + sunlight * max(dot(facing, sunward), 0.0);
`;
