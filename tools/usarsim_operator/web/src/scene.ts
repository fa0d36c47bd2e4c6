// The true world as instances: every geom of one shape and look is an instance of one draw call. What stands still
// is built once; what comes and goes is put together anew whenever it does, out of the same shapes.
// Frames are MuJoCo's (z up), as the scene port sends them.

import * as THREE from "three";
import { Air, type AirData } from "./air";
import {
  type Geom,
  type Material,
  type MeshData,
  pieces,
  quaternion,
  Shapes,
  type TextureData,
  vector,
} from "./shapes";

interface Part {
  what?: string;
  name?: string;
  geoms: Geom[];
}

interface Kind {
  materials: Material[];
  bodies: Part[];
  lamp?: { pos?: number[]; quat?: number[] };
}

export interface Thing {
  id: number;
  what: string;
  name: string;
  kind: string;
  first: number;
  lit?: boolean;
}

export interface SceneData extends AirData {
  lower: number[];
  upper: number[];
  materials: Material[];
  still: Part[];
  bodies: Part[];
  views?: { name: string; pos: number[]; quat: number[] }[];
}

/** What `GET /scene/G` gives: the messages of the scene port, by id; only what is new since the one that it names. */
export interface SceneFile {
  generation: number;
  epoch: string;
  since: string | null;
  scene: SceneData | null;
  kinds: Record<string, Kind>;
  meshes: Record<string, MeshData>;
  textures: Record<string, TextureData>;
  present: { generation: number; count: number; things: Thing[] };
}

/** One instance that moves: number of its pose, place in its group, its pose in the body. */
interface Moving {
  pose: number;
  group: THREE.InstancedMesh;
  place: number;
  local: THREE.Matrix4;
}

interface Item {
  matrix: THREE.Matrix4;
  colour: THREE.Color;
  pose: number;
}

/** Geoms that are drawn together, thrown away together. */
class Batch {
  readonly group = new THREE.Group();
  readonly moving: Moving[] = [];
  private readonly items = new Map<string, Item[]>();

  constructor(private readonly shapes: Shapes) {}

  add(geoms: Geom[], materials: Material[], pose: number): void {
    for (const geom of geoms) {
      const { colour, look, uv } = this.shapes.look(geom, materials[geom.material]);
      const place = new THREE.Matrix4().compose(
        vector(geom.pos),
        quaternion(geom.quat),
        new THREE.Vector3(1, 1, 1),
      );
      for (const [shape, offset, scale] of pieces(geom)) {
        const matrix = new THREE.Matrix4()
          .compose(offset, new THREE.Quaternion(), scale)
          .premultiply(place);
        const key = `${shape}\n${uv}\n${look}`;
        const items = this.items.get(key) ?? [];
        this.items.set(key, items);
        items.push({ matrix, colour, pose });
      }
    }
  }

  build(): void {
    for (const [key, items] of this.items) {
      const [shape = "box", uv = "", look = "1||"] = key.split("\n");
      const group = new THREE.InstancedMesh(
        this.shapes.geometry(shape, uv),
        this.shapes.material(look, shape),
        items.length,
      );
      group.frustumCulled = false;
      items.forEach((item, place) => {
        group.setMatrixAt(place, item.matrix);
        group.setColorAt(place, item.colour);
        if (item.pose >= 0) this.moving.push({ pose: item.pose, group, place, local: item.matrix });
      });
      this.group.add(group);
    }
    this.items.clear();
  }

  dispose(): void {
    this.group.removeFromParent();
    for (const child of this.group.children as THREE.InstancedMesh[]) child.dispose();
  }
}

export class World {
  readonly group = new THREE.Group();
  readonly robots = new Map<string, number>();
  readonly shapes: Shapes;
  readonly air: Air;
  /** Generation with its epoch, as `since` names it. */
  version = "";
  generation = -1;
  poses: Float32Array = new Float32Array(0);
  time = 0;
  private readonly kinds: Record<string, Kind> = {};
  private count = 0;
  private fixed: Batch | null = null;
  private things: Batch | null = null;
  private lamps: { pose: number; local: THREE.Matrix4; beam: THREE.Object3D }[] = [];

  constructor(changed: () => void) {
    this.shapes = new Shapes(changed);
    this.air = new Air();
    this.group.add(this.air.group);
  }

  /** Takes a file in: the whole world, or what has changed since the last one. */
  take(file: SceneFile): void {
    const { scene, present } = file;
    Object.assign(this.kinds, file.kinds);
    Object.assign(this.shapes.meshes, file.meshes);
    Object.assign(this.shapes.textures, file.textures);
    if (scene) {
      this.fixed?.dispose();
      this.shapes.lamps = scene.lights?.some((one) => one.type !== "directional") ?? false;
      this.fixed = new Batch(this.shapes);
      for (const part of scene.still) this.fixed.add(part.geoms, scene.materials, -1);
      scene.bodies.forEach((part, pose) => {
        this.fixed?.add(part.geoms, scene.materials, pose);
      });
      this.fixed.build();
      this.group.add(this.fixed.group);
      this.air.fill(scene);
    }
    this.things?.dispose();
    this.things = new Batch(this.shapes);
    this.robots.clear();
    for (const lamp of this.lamps) lamp.beam.removeFromParent();
    this.lamps = [];
    for (const thing of present.things) {
      if (thing.what === "robot") this.robots.set(thing.name, thing.first);
      const kind = this.kinds[thing.kind];
      kind?.bodies.forEach((part, k) => {
        this.things?.add(part.geoms, kind.materials, thing.first + k);
      });
      if (thing.lit && kind?.lamp) this.light(thing.first, kind.lamp);
    }
    this.things.build();
    this.group.add(this.things.group);
    this.generation = file.generation;
    this.version = `${file.epoch}.${file.generation}`;
    this.count = present.count;
    this.poses = new Float32Array(0);
  }

  private light(pose: number, lamp: { pos?: number[]; quat?: number[] }): void {
    const beam = this.air.beam();
    const local = new THREE.Matrix4().compose(
      vector(lamp.pos),
      quaternion(lamp.quat),
      new THREE.Vector3(1, 1, 1),
    );
    this.lamps.push({ pose, local, beam });
    this.group.add(beam);
  }

  /** Places everything that moves; 0: a frame of another generation, 1: nothing to be seen has moved, 2: drawn anew. */
  place(generation: number, poses: Float32Array, time: number): 0 | 1 | 2 {
    if (generation !== this.generation || poses.length < 7 * this.count) return 0;
    const drifts = this.air.at(time);
    this.time = time;
    if (!moved(this.poses, poses)) return drifts ? 2 : 1;
    this.poses = poses;
    const body = new THREE.Matrix4();
    const touched = new Set<THREE.InstancedMesh>();
    let last = -1;
    for (const { pose, group, place, local } of [
      ...(this.fixed?.moving ?? []),
      ...(this.things?.moving ?? []),
    ]) {
      if (pose !== last) {
        this.pose(pose, body);
        last = pose;
      }
      group.setMatrixAt(place, scratch.multiplyMatrices(body, local));
      touched.add(group);
    }
    for (const group of touched) group.instanceMatrix.needsUpdate = true;
    for (const { pose, local, beam } of this.lamps)
      beam.matrix.multiplyMatrices(this.pose(pose, body), local);
    return 2;
  }

  /** The matrix of pose number n. */
  pose(n: number, into = new THREE.Matrix4()): THREE.Matrix4 {
    const at = (i: number): number => this.poses[7 * n + i] ?? 0;
    return into.compose(
      new THREE.Vector3(at(0), at(1), at(2)),
      new THREE.Quaternion(at(4), at(5), at(6), at(3)),
      new THREE.Vector3(1, 1, 1),
    );
  }
}

const scratch = new THREE.Matrix4();
/** What nobody sees, m and rad, and what turns so far between two frames that it spins, rad. */
const UNSEEN = 5e-4;
const TURNED = 4e-3;
const SPINS = 0.35;

/** Whether anything has moved to the eye; what spins on the spot (rotors) alone is no motion. */
function moved(before: Float32Array, after: Float32Array): boolean {
  if (before.length !== after.length) return true;
  for (let n = 0; n < after.length; n += 7) {
    let same = 0;
    for (let i = n; i < n + 7; i++) {
      const [a, b] = [after[i] ?? 0, before[i] ?? 0];
      if (i < n + 3 && Math.abs(a - b) > UNSEEN) return true;
      if (i >= n + 3) same += a * b;
    }
    const turned = 2 * Math.acos(Math.min(1, Math.abs(same)));
    if (turned > TURNED && turned < SPINS) return true;
  }
  return false;
}
