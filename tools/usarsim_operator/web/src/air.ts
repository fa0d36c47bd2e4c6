// What hangs in the air of the true world: sky, lights, smoke, and the beams of robots' lamps.

import * as THREE from "three";
import { quaternion, vector } from "./shapes";

interface Cloud {
  pos: number[];
  size: number[];
  radius: number;
  lifetime: number;
  places?: number[][];
  angle?: number[];
  aside?: number[];
}

export interface AirData {
  lower: number[];
  upper: number[];
  sky?: number[][];
  lights?: { type: string; pos: number[]; dir: number[]; diffuse: number[] }[];
  headlight?: { ambient?: number[]; diffuse?: number[] };
  smoke?: {
    color?: number[];
    haze?: { density: number; top?: number };
    volumes?: {
      shape: string;
      pos?: number[];
      quat?: number[];
      size: number[];
      density: number;
    }[];
    clouds?: Cloud[];
  };
}

/** How much brighter three.js must shine than MuJoCo for the same picture (it divides by pi). */
const BRIGHT = Math.PI;
const MOST_LIGHTS = 3;

export class Air {
  readonly group = new THREE.Group();
  private clouds: { cloud: Cloud; balls: THREE.InstancedMesh }[] = [];
  private time = Number.NaN;

  /** Puts sky, lights and smoke of a scene in. */
  fill(data: AirData): void {
    this.group.clear();
    this.clouds = [];
    this.time = Number.NaN;
    this.lights(data);
    if (data.sky && data.sky.length > 1) this.group.add(sky(data.sky));
    this.smoke(data);
  }

  private lights({ lights = [], headlight, lower, upper }: AirData): void {
    const grey = (colour: number[] = [0, 0, 0]): number => Math.max(...colour);
    const head = grey(headlight?.ambient) + grey(headlight?.diffuse);
    const suns = lights.filter((one) => one.type === "directional").slice(0, MOST_LIGHTS);
    const ambient = Math.max(head, suns.length > 0 ? 0.3 : 0.75);
    this.group.add(new THREE.HemisphereLight(0xffffff, 0xb9b4ab, BRIGHT * ambient));
    for (const one of suns) {
      const sun = new THREE.DirectionalLight(tint(one.diffuse), BRIGHT);
      sun.position.copy(vector(one.dir)).multiplyScalar(-20);
      this.group.add(sun);
    }
    const far = Math.hypot((upper[0] ?? 0) - (lower[0] ?? 0), (upper[1] ?? 0) - (lower[1] ?? 0));
    const lamps = lights.filter((one) => one.type !== "directional");
    for (const one of lamps.slice(0, MOST_LIGHTS - suns.length)) {
      const lamp = new THREE.PointLight(tint(one.diffuse), BRIGHT, far, 0.4);
      lamp.position.copy(vector(one.pos));
      this.group.add(lamp);
    }
  }

  private smoke({ smoke, lower, upper }: AirData): void {
    if (!smoke) return;
    const colour = tint(smoke.color ?? [0.6, 0.6, 0.6]);
    const veil = (density: number, depth: number): THREE.MeshBasicMaterial =>
      new THREE.MeshBasicMaterial({
        color: colour,
        transparent: true,
        opacity: Math.min(0.8, 1 - Math.exp(-density * depth)) / 2, // seen through two faces
        depthWrite: false,
        side: THREE.DoubleSide,
      });
    const { haze, volumes = [], clouds = [] } = smoke;
    const [x0 = 0, y0 = 0, z0 = 0] = lower;
    const [x1 = 0, y1 = 0, z1 = 0] = upper;
    if (haze) {
      const floor = Math.max(z0, -0.1);
      const top = Math.min(haze.top ?? z1, z1);
      const slab = new THREE.Mesh(
        new THREE.BoxGeometry(x1 - x0, y1 - y0, top - floor),
        veil(haze.density, Math.min(4, top - floor)),
      );
      slab.position.set((x0 + x1) / 2, (y0 + y1) / 2, (floor + top) / 2);
      this.group.add(slab);
    }
    for (const volume of volumes) {
      const [a = 1, b = 1, c = 1] = volume.size;
      const round = volume.shape === "ellipsoid";
      const shape = round ? new THREE.SphereGeometry(0.5, 24, 16) : new THREE.BoxGeometry(1, 1, 1);
      const mesh = new THREE.Mesh(shape, veil(volume.density, Math.min(a, b, c)));
      mesh.position.copy(vector(volume.pos));
      mesh.quaternion.copy(quaternion(volume.quat));
      mesh.scale.set(a, b, c);
      this.group.add(mesh);
    }
    for (const cloud of clouds) {
      const count = cloud.lifetime > 0 ? (cloud.angle?.length ?? 0) : (cloud.places?.length ?? 0);
      const balls = new THREE.InstancedMesh(
        new THREE.IcosahedronGeometry(cloud.radius, 1),
        new THREE.MeshLambertMaterial({ color: colour }),
        count,
      );
      balls.frustumCulled = false;
      this.clouds.push({ cloud, balls });
      this.group.add(balls);
    }
  }

  /** Moves the clouds to a simulated time; whether any of them moves. */
  at(time: number): boolean {
    const first = Number.isNaN(this.time);
    if (!first && Math.abs(time - this.time) < 0.2) return false;
    this.time = time;
    let drifts = false;
    for (const { cloud, balls } of this.clouds) {
      const rises = cloud.lifetime > 0;
      if (!rises && !first) continue;
      drifts ||= rises;
      for (let i = 0; i < balls.count; i++) {
        const at = rises ? ball(cloud, i, balls.count, time) : vector(cloud.places?.[i]);
        balls.setMatrixAt(i, new THREE.Matrix4().setPosition(at));
      }
      balls.instanceMatrix.needsUpdate = true;
    }
    return drifts || (first && this.clouds.length > 0);
  }

  /** The beam of a headlight that is on, along x of its matrix. */
  beam(): THREE.Object3D {
    const long = 2.4;
    const cone = new THREE.ConeGeometry(0.75, long, 24, 1, true)
      .rotateZ(Math.PI / 2)
      .translate(long / 2, 0, 0);
    const light = new THREE.MeshBasicMaterial({
      color: 0xfff2c0,
      transparent: true,
      opacity: 0.16,
      depthWrite: false,
      side: THREE.DoubleSide,
    });
    const beam = new THREE.Group().add(
      new THREE.Mesh(cone, light),
      new THREE.Mesh(
        new THREE.SphereGeometry(0.05, 12, 8),
        new THREE.MeshBasicMaterial({ color: 0xfff8dc }),
      ),
    );
    beam.matrixAutoUpdate = false;
    return beam;
  }
}

/** Where ball i of n of a cloud that rises is at a simulated time (docs/scene-port.md). */
export function ball(cloud: Cloud, i: number, n: number, time: number): THREE.Vector3 {
  const turns = i / n + time / cloud.lifetime;
  const round = Math.floor(turns);
  const age = turns - round;
  const a = (cloud.angle?.[i] ?? 0) + 2.39996323 * round;
  const r = (cloud.aside?.[i] ?? 0) * (0.25 + 0.75 * age);
  const at = [r * Math.cos(a), r * Math.sin(a), 2 * age - 1];
  const place = (k: number): number =>
    (cloud.pos[k] ?? 0) + ((at[k] ?? 0) * (cloud.size[k] ?? 0)) / 2;
  return new THREE.Vector3(place(0), place(1), place(2));
}

/** A ball around everything, coloured from straight up to straight down. */
function sky(colours: number[][]): THREE.Mesh {
  const shape = new THREE.SphereGeometry(140, 16, colours.length - 1).rotateX(Math.PI / 2);
  const place = shape.getAttribute("position");
  const tints = new Float32Array(3 * place.count);
  for (let i = 0; i < place.count; i++) {
    const down = Math.acos(Math.max(-1, Math.min(1, place.getZ(i) / 140))) / Math.PI;
    tint(colours[Math.round(down * (colours.length - 1))] ?? [0, 0, 0]).toArray(tints, 3 * i);
  }
  shape.setAttribute("color", new THREE.BufferAttribute(tints, 3));
  const paint = new THREE.MeshBasicMaterial({
    vertexColors: true,
    side: THREE.BackSide,
    depthWrite: false,
    fog: false,
  });
  const mesh = new THREE.Mesh(shape, paint);
  mesh.frustumCulled = false;
  mesh.renderOrder = -1;
  return mesh;
}

function tint([r = 0, g = 0, b = 0]: number[]): THREE.Color {
  return new THREE.Color().setRGB(r, g, b, THREE.SRGBColorSpace);
}
