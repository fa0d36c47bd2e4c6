// What robots reported, in 3D, for those who must not see the true world: the map as floor with low walls, each
// robot as a plain body of its kind, its way, and the points of its scans. MuJoCo's frame (z up).

import * as THREE from "three";
import { mergeGeometries } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import { colour } from "./dom";
import { matt } from "./gl";
import { drawMark, robotColour } from "./looks";
import { type Grid, type Kind, type Pose, SPECTATOR, scanPoints, toWorld } from "./protocol";
import type { Store } from "./store";

const WALL_M = 0.35;
const MOST_WALLS = 6000;
/** How far below its reference point a robot stands, m, where nothing better is known. */
const LEGS = 0.17;
/** What nobody sees, m. */
const UNSEEN = 3e-3;

/** Pose of a report as a matrix of MuJoCo's frame. */
export function matrixOf(pose: Pose): THREE.Matrix4 {
  const turn = new THREE.Quaternion().setFromEuler(
    new THREE.Euler(pose[3], -pose[4], -pose[5], "ZYX"),
  );
  return new THREE.Matrix4().compose(
    new THREE.Vector3(pose[0], -pose[1], -pose[2]),
    turn,
    new THREE.Vector3(1, 1, 1),
  );
}

export class Reports {
  readonly group = new THREE.Group();
  private readonly bodies = new Map<string, { body: THREE.Mesh; path: THREE.Line; seen: string }>();
  private readonly ground = new THREE.Group();
  private drawn: Grid | null = null;
  private floor = 0;

  constructor(private readonly store: Store) {
    this.group.add(this.ground, grid());
    store.on("theme", () => {
      this.drawn = null;
    });
  }

  /** Puts everything where the newest reports say; whether that looks different from before. */
  update(): boolean {
    const { store } = this;
    let changed = false;
    for (const [name, { body, path }] of this.bodies) {
      if (store.robots.some((robot) => robot.name === name)) continue;
      body.removeFromParent();
      path.removeFromParent();
      this.bodies.delete(name);
      changed = true;
    }
    const low = store.robots.flatMap((one) =>
      one.pose && one.kind !== "aerial" ? [-one.pose[2] - LEGS] : [],
    );
    const floor = low.length > 0 ? Math.min(...low) : this.floor;
    if (Math.abs(floor - this.floor) > 0.1) this.floor = floor;
    this.ground.position.z = this.floor;
    for (const robot of store.robots) {
      if (!robot.pose) continue;
      let one = this.bodies.get(robot.name);
      const seen = `${robot.kind} ${robot.index}`;
      if (!one || one.seen !== seen) {
        one?.body.removeFromParent();
        one?.path.removeFromParent();
        const tint = robotColour(robot.index);
        const path = new THREE.Line(
          new THREE.BufferGeometry(),
          new THREE.LineBasicMaterial({ color: tint }),
        );
        path.frustumCulled = false;
        one = { body: plainBody(robot.kind, tint), path, seen };
        this.bodies.set(robot.name, one);
        this.group.add(one.body, path);
      }
      const place = matrixOf(robot.pose);
      const before = one.body.matrix.elements;
      if (place.elements.some((value, i) => Math.abs(value - (before[i] ?? 0)) > UNSEEN)) {
        one.body.matrix.copy(place);
        changed = true;
      }
      if (this.way(one.path, store.slot(robot.index).path)) changed = true;
    }
    const map = store.slot(SPECTATOR).map ?? null;
    if (map && map !== this.drawn) {
      this.map(map);
      changed = true;
    }
    return changed;
  }

  private way(path: THREE.Line, places: Float32Array | undefined): boolean {
    if (!places || path.userData.places === places) return false;
    path.userData.places = places;
    const points: number[] = [];
    for (let i = 0; i + 1 < places.length; i += 2)
      points.push(places[i] ?? 0, -(places[i + 1] ?? 0), this.floor + 0.03);
    path.geometry.dispose();
    path.geometry = new THREE.BufferGeometry();
    path.geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    return true;
  }

  /** Free cells as a floor, walls as low blocks. */
  private map(map: Grid): void {
    this.drawn = map;
    for (const child of this.ground.children as (THREE.Mesh | THREE.InstancedMesh)[]) {
      child.geometry.dispose();
      if (child instanceof THREE.InstancedMesh) child.dispose();
    }
    this.ground.clear();
    const { columns, rows, cell, cells, x, y } = map;
    const tint = new THREE.Color(colour("floor"));
    const pixels = new Uint8Array(4 * columns * rows);
    const free = [tint.r, tint.g, tint.b].map((part) => Math.round(255 * part));
    const walls: [number, number][] = [];
    cells.forEach((kind, i) => {
      // Rows run to the right, which is down in y of this frame: the last row is the lowest.
      const [column, row] = [i % columns, Math.floor(i / columns)];
      if (kind === 2) walls.push([x + (column + 0.5) * cell, -(y + (row + 0.5) * cell)]);
      if (kind !== 0) pixels.set([...free, 255], 4 * ((rows - 1 - row) * columns + column));
    });
    const image = new THREE.DataTexture(pixels, columns, rows);
    image.needsUpdate = true;
    const plane = new THREE.Mesh(
      new THREE.PlaneGeometry(columns * cell, rows * cell),
      new THREE.MeshBasicMaterial({ map: image, alphaTest: 0.5 }),
    );
    plane.position.set(x + (columns * cell) / 2, -(y + (rows * cell) / 2), 0);
    this.ground.add(plane);
    const every = Math.ceil(walls.length / MOST_WALLS);
    const shown = walls.filter((_, i) => i % every === 0);
    const blocks = new THREE.InstancedMesh(
      new THREE.BoxGeometry(cell, cell, WALL_M),
      matt({ color: colour("block") }),
      shown.length,
    );
    blocks.frustumCulled = false;
    shown.forEach(([bx, by], i) => {
      blocks.setMatrixAt(i, new THREE.Matrix4().setPosition(bx, by, WALL_M / 2));
    });
    this.ground.add(blocks);
  }

  /** Points of all scans and of the chosen robot's range cameras, at their true heights. */
  cloud(dots: THREE.Points): void {
    const places: number[] = [];
    const tints: number[] = [];
    const tint = new THREE.Color();
    for (const robot of this.store.robots) {
      const slots = this.store.slot(robot.index);
      const { pose } = robot;
      if (!pose) continue;
      tint.set(robotColour(robot.index)).offsetHSL(0, 0, 0.1);
      const put = (point: [number, number, number]): void => {
        const [x, y, z] = toWorld(pose, point);
        places.push(x, -y, -z);
        tints.push(tint.r, tint.g, tint.b);
      };
      if (slots.scan) for (const end of scanPoints(slots.scan)) if (end.hit) put(end.point);
      const cloud = robot.name === this.store.selected ? slots.points?.points : undefined;
      for (let i = 0; cloud && i + 2 < cloud.length; i += 3)
        put([cloud[i] ?? 0, cloud[i + 1] ?? 0, cloud[i + 2] ?? 0]);
    }
    dots.geometry.dispose();
    dots.geometry = new THREE.BufferGeometry();
    dots.geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
    dots.geometry.setAttribute("color", new THREE.Float32BufferAttribute(tints, 3));
  }
}

function grid(): THREE.Object3D {
  const lines = new THREE.GridHelper(60, 60, 0x808890, 0x808890).rotateX(Math.PI / 2);
  lines.position.z = -0.02;
  const paint = lines.material as THREE.Material;
  paint.transparent = true;
  paint.opacity = 0.25;
  return lines;
}

/** A plain body of a kind of robot in its colour, ahead is +x, with a light nose that tells its heading. */
export function plainBody(kind: Kind, tint: string): THREE.Mesh {
  const [paint, dark, light] = [tint, "#2b3138", "#f4f6f8"].map((one) => new THREE.Color(one));
  const parts: THREE.BufferGeometry[] = [];
  const put = (shape: THREE.BufferGeometry, tone = paint, x = 0, y = 0, z = 0): void => {
    const { count } = shape.getAttribute("position");
    const tones = Array.from({ length: count }, () => tone?.toArray() ?? []).flat();
    shape.setAttribute("color", new THREE.Float32BufferAttribute(tones, 3));
    parts.push(shape.translate(x, y, z));
  };
  const wheels = (radius: number, x: number, y: number, z: number): void => {
    const wheel = new THREE.CylinderGeometry(radius, radius, 0.09, 16);
    for (const sx of [-1, 1]) for (const sy of [-1, 1]) put(wheel.clone(), dark, sx * x, sy * y, z);
  };
  const nose = (x: number, z: number, size: number): void =>
    put(new THREE.ConeGeometry(size, 1.6 * size, 3).rotateZ(-Math.PI / 2), light, x, 0, z);
  switch (kind) {
    case "aerial":
      put(new THREE.SphereGeometry(0.14, 16, 10), paint);
      for (const [x, y] of [
        [0.3, 0.3],
        [0.3, -0.3],
        [-0.3, 0.3],
        [-0.3, -0.3],
      ] as const)
        put(new THREE.CylinderGeometry(0.2, 0.2, 0.03, 20).rotateX(Math.PI / 2), dark, x, y, 0.05);
      nose(0.24, 0, 0.08);
      break;
    case "car":
      put(new THREE.BoxGeometry(2.4, 1.1, 0.5), paint, 0, 0, 0.35);
      put(new THREE.BoxGeometry(1.2, 1, 0.4), dark, -0.2, 0, 0.8);
      wheels(0.28, 0.8, 0.55, 0.1);
      nose(1.1, 0.62, 0.2);
      break;
    case "underwater":
      put(new THREE.CapsuleGeometry(0.25, 1, 6, 14).rotateZ(Math.PI / 2), paint);
      nose(0.75, 0, 0.1);
      break;
    case "legged":
      put(new THREE.CapsuleGeometry(0.12, 0.3, 6, 14).rotateX(Math.PI / 2), paint, 0, 0, 0.05);
      nose(0.14, 0.2, 0.06);
      break;
    case "fixed":
      put(new THREE.CylinderGeometry(0.2, 0.3, 0.6, 20).rotateX(Math.PI / 2), paint, 0, 0, 0.2);
      nose(0.26, 0.4, 0.08);
      break;
    default:
      put(new THREE.BoxGeometry(0.5, 0.36, 0.2), paint, 0, 0, 0.05);
      put(new THREE.BoxGeometry(0.12, 0.2, 0.12), dark, 0.12, 0, 0.21);
      wheels(0.11, 0.16, 0.22, -0.05);
      nose(0.2, 0.16, 0.09);
  }
  // One mesh, one draw call for each robot.
  const body = new THREE.Mesh(mergeGeometries(parts), matt({ vertexColors: true }));
  body.matrixAutoUpdate = false;
  return body;
}

/** Names that float above robots and keep their size on the screen. */
export class Labels {
  readonly group = new THREE.Group();
  private readonly made = new Map<string, THREE.Sprite>();

  /** Shows a name at a place; `chosen` is brighter. */
  show(places: Map<string, { at: THREE.Vector3; index: number; chosen: boolean }>): void {
    for (const [name, sprite] of this.made) {
      if (places.has(name)) continue;
      sprite.removeFromParent();
      this.made.delete(name);
    }
    for (const [name, { at, index, chosen }] of places) {
      let sprite = this.made.get(name);
      if (!sprite) {
        sprite = label(name, index);
        this.made.set(name, sprite);
        this.group.add(sprite);
      }
      sprite.position.copy(at).add(new THREE.Vector3(0, 0, 0.55));
      sprite.material.opacity = chosen ? 1 : 0.7;
    }
  }
}

function label(name: string, index: number): THREE.Sprite {
  const canvas = document.createElement("canvas");
  const g = canvas.getContext("2d");
  const text = name.length > 18 ? `${name.slice(0, 17)}…` : name;
  const font = "600 30px system-ui, sans-serif";
  if (!g) return new THREE.Sprite();
  g.font = font;
  canvas.width = Math.ceil(g.measureText(text).width) + 50;
  canvas.height = 44;
  g.font = font;
  g.fillStyle = "#0d1116cc";
  g.beginPath();
  g.roundRect(0, 0, canvas.width, 44, 10);
  g.fill();
  drawMark(g, index, { x: 21, y: 22, radius: 11, edge: "#ffffff" });
  g.fillStyle = "#ffffff";
  g.fillText(text, 40, 33);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const paint = new THREE.SpriteMaterial({ map, sizeAttenuation: false, depthTest: false });
  const sprite = new THREE.Sprite(paint);
  sprite.renderOrder = 9;
  sprite.scale.set((0.042 * canvas.width) / 44, 0.042, 1);
  return sprite;
}
